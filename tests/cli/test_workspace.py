import json
import os

import pytest
from PIL import Image

from silmesh.cli.workspace import Workspace, find_snakefile, place_of, to_name
from silmesh.config import NAME
from silmesh.errors import InputError

VALUES = {"variants": {"mesh": {}}}


@pytest.fixture
def work(tmp_path):
    files = []
    for i in (1, 2):
        path = tmp_path / f"a folder/p{i}.png"
        path.parent.mkdir(exist_ok=True)
        Image.new("RGB", (4, 3)).save(path)
        files.append(path)
    return Workspace(tmp_path / "cache/cup", "cup", tuple(files), ())


def test_links_are_made_anew_only_when_the_photographs_change(work):
    work.prepare()
    links = work.folder / "photographs"
    assert [os.readlink(links / f"p{i}.png") for i in (1, 2)] == list(map(str, work.photographs))
    before = links.stat().st_mtime_ns, links.stat().st_ino
    work.prepare()
    assert (links.stat().st_mtime_ns, links.stat().st_ino) == before
    Workspace(work.folder, "cup", work.photographs[:1], ()).prepare()
    assert [path.name for path in links.iterdir()] == ["p1.png"]


def test_results_of_another_version_are_told_of_once(work):
    assert work.prepare() is None
    (work.folder / "silmesh.json").write_text(json.dumps({"version": "0.0.9"}))
    assert work.prepare() == "0.0.9"
    assert work.prepare() is None


def test_the_table_and_the_configuration(work):
    work.prepare()
    work.configure({"silhouettes": "threshold", "cameras": "calibrate"}, VALUES)
    header, row = (work.folder / "datasets.tsv").read_text().splitlines()
    cells = dict(zip(header.split("\t"), row.split("\t"), strict=True))
    assert cells["object"] == "cup"
    assert cells["images"] == "photographs"
    assert cells["silhouettes"] == "threshold"
    assert (work.folder / "config.yaml").read_text().startswith("datasets: datasets.tsv\n")


def test_a_wrong_option_is_told_of_by_its_key(work):
    work.prepare()
    row = {"silhouettes": "threshold", "cameras": "calibrate"}
    with pytest.raises(InputError, match=r"^the options: views.size: should be a whole number"):
        work.configure(row, {"views": {"size": 3}, **VALUES})
    with pytest.raises(InputError) as refused:
        work.configure(row | {"turntable": "1;2"}, VALUES)
    assert work.restore(str(refused.value)).startswith("turntable: should be distance,elevation")
    assert not (work.folder / "config.yaml").exists()


def test_messages_name_the_persons_own_files(work):
    first, second = work.photographs
    said = f"photographs/p1.png: is bad, as {work.folder}/photographs/p2.png; not my_photographs/p1"
    assert work.restore(said) == f"{first}: is bad, as {second}; not my_photographs/p1"


def test_a_place_for_each_set_of_photographs(tmp_path, monkeypatch):
    monkeypatch.setenv("SILMESH_CACHE", str(tmp_path / "cache"))
    cup, jug = (tmp_path / name for name in ("my cup", "jug"))
    cup.mkdir()
    folder, name = place_of([cup])
    assert name == "my_cup"
    assert folder.parent == tmp_path / "cache/objects"
    monkeypatch.chdir(cup)
    assert place_of([tmp_path / "my cup/."]) == (folder, name)
    assert place_of([cup / "a.png"])[1] == name
    assert len({place_of(p)[0] for p in ([cup], [jug], [cup / "a.png"], [cup / "b.png"])}) == 4


@pytest.mark.parametrize(
    ("folder", "name"),
    [("Täßchen (2)", "T_chen_2"), ("report", "object"), ("...", "object"), ("-a-", "a")],
)
def test_names_of_folders_become_names_of_objects(folder, name):
    assert to_name(folder) == name


def test_long_names_are_cut():
    assert to_name("a" * 200) == "a" * 80
    assert NAME.endswith("{0,79}")


def test_the_workflow_is_found():
    assert find_snakefile().is_file()
    assert (find_snakefile().parent / "workflow/profiles/default/config.yaml").is_file()
