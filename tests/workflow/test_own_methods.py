"""A person's own silhouettes, procedure and renderer by the workflow, and what a change reruns."""

import csv

import pytest

OWN = """\
  own:
    silhouettes: code/find.py:find
    init: {shape: sphere, vertices: 60}
    fit: {preset: "code/fit.py:Mine", iterations: 3, renderer: "code/draw.py:draw"}
  boxed:
"""
FIND = "def find(photograph):\n    return photograph[..., 0] > 100\n"
FIT = "from silmesh.fitting.softras import SoftRas as Mine\n\n\nclass Mine(Mine):\n    pass\n"
DRAW = """\
from silmesh.softras import soft_silhouettes


def draw(points, faces, size, sigma):
    return soft_silhouettes(points, faces, size, sigma)
"""


def add_own(project):
    (project / "code").mkdir()
    for name, text in {"find": FIND, "fit": FIT, "draw": DRAW}.items():
        (project / f"code/{name}.py").write_text(text)
    project.edit("config/config.yaml", "  boxed:\n", OWN)


def steps(outdated):
    return {job.partition(" ")[0] for job in outdated if "cup" in job}


@pytest.mark.slow
def test_a_change_of_ones_own_code_reruns_what_depends_on_it(project):
    add_own(project)
    project.run()
    with open(project / "results/cup/own/loss.csv") as file:
        assert len(list(csv.DictReader(file))) == 3
    assert project.outdated() == set()
    with open(project / "code/draw.py", "a") as file:
        file.write("# another\n")
    assert {"fit", "evaluate"} <= steps(project.outdated())
    assert not {"silhouettes", "scene", "initial"} & steps(project.outdated())
    (project / "code/draw.py").write_text(DRAW)
    with open(project / "code/fit.py", "a") as file:
        file.write("# another\n")
    assert {"fit", "evaluate"} <= steps(project.outdated())
    (project / "code/fit.py").write_text(FIT)
    with open(project / "code/find.py", "a") as file:
        file.write("# another\n")
    assert {"silhouettes", "scene", "initial", "fit"} <= steps(project.outdated())


def test_a_function_in_the_table_lies_relative_to_it(fresh):
    (fresh / "config/find.py").write_text(FIND)
    fresh.edit("config/datasets.tsv", "\tmask\tturntable", "\tfind.py:find\tturntable")
    said = fresh.run("--dry-run", "--printshellcmds")
    assert "--source config/find.py:find" in said


@pytest.mark.parametrize(
    ("key", "name", "message"),
    [
        ("silhouettes", "find.py:other", "code/find.py: defines no function 'other'"),
        ("fit.renderer", "nowhere.py:draw", "code/nowhere.py: is not there"),
        ("fit.preset", "fit.py:Yours", "code/fit.py: defines no function 'Yours'"),
    ],
)
def test_what_is_not_there_is_refused_before_any_work(fresh, key, name, message):
    add_own(fresh)
    was = {
        "silhouettes": "find.py:find",
        "fit.renderer": "draw.py:draw",
        "fit.preset": "fit.py:Mine",
    }
    fresh.edit("config/config.yaml", was[key], name)
    status, said = fresh.snakemake("--dry-run")
    assert status
    assert f"variants.own.{key}: {message}" in said
