"""One object fails: the others are made and shown, and the next run makes what is missing alone."""

import re

import pytest

pytestmark = pytest.mark.slow


def test_the_others_are_finished_and_the_reason_is_told(fresh):
    fresh.add_object("jar")
    fresh.add_object("pot")
    mask = fresh / "photos/mask2/jar/jar_r90.png"
    whole = mask.read_bytes()
    mask.write_bytes(whole[:40])
    status, said = fresh.snakemake()
    assert status != 0
    assert "results/report/unfinished.html shows the 4 meshes that are whole" in said
    assert all((fresh / f"results/{o}/round/mesh.glb").is_file() for o in ("cup", "pot"))
    assert not (fresh / "results/report/report.html").exists()
    page = (fresh / "results/report/unfinished.html").read_text(encoding="utf-8")
    rows = re.findall(r"<tr><th scope=\"row\">(jar, \w+)</th>.*?>(\w+)</td>.*?>(.*?)</td>", page)
    stages = {run: stage for run, stage, _ in rows}
    assert stages == {"jar, round": "silhouettes", "jar, boxed": "silhouettes"}
    assert "jar_r90.png" in rows[0][2]

    mask.write_bytes(whole)
    fresh.run()
    jobs = fresh.outdated()
    assert jobs == set()
    assert not (fresh / "results/report/unfinished.html").exists()
    assert 'id="object-jar"' in (fresh / "results/report/report.html").read_text(encoding="utf-8")


def test_only_what_is_missing_is_made_again(fresh):
    fresh.add_object("jar")
    mask = fresh / "photos/mask2/jar/jar_r90.png"
    whole = mask.read_bytes()
    mask.write_bytes(whole[:40])
    assert fresh.snakemake()[0] != 0
    mask.write_bytes(whole)
    made = {job.split()[1].split("/")[0] for job in fresh.outdated()}
    assert "cup" not in made
    assert "jar" in made


def test_more_objects_than_one_page_holds(fresh):
    fresh.edit("src/silmesh/report/parts.py", "LISTED = 50", "LISTED = 1")
    fresh.add_object("jar")
    fresh.run()
    report = fresh / "results/report"
    assert 'href="objects/jar.html"' in (report / "report.html").read_text(encoding="utf-8")
    assert (report / "objects/jar.html").is_file()
    assert (report / "objects/jar/round.webp").is_file()
    assert fresh.outdated() == set()
    (report / "report.html").unlink()
    fresh.run()
    assert (report / "objects/cup.html").is_file()
