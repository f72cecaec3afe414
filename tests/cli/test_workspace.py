import json
import os

import pytest
from PIL import Image
from surroundings import look_around

from silmesh.cli.workspace import (
    Workspace,
    claim,
    find_snakefile,
    name_links,
    place_of,
    to_name,
    try_workspace,
)
from silmesh.errors import InputError
from silmesh.naming import natural_key
from silmesh.settings.section import NAME

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


def test_a_part_that_a_kill_left_makes_no_folder_someone_elses(work):
    work.folder.mkdir(parents=True)
    (work.folder / ".part-silmesh.json").touch()
    work.prepare()
    assert (work.folder / "silmesh.json").is_file()


def test_links_are_made_anew_only_when_the_photographs_change(work):
    work.prepare()
    links = work.folder / "photographs"
    assert [os.readlink(links / f"p{i}.png") for i in (1, 2)] == list(map(str, work.photographs))
    before = links.stat().st_mtime_ns, links.stat().st_ino
    work.prepare()
    assert (links.stat().st_mtime_ns, links.stat().st_ino) == before
    Workspace(work.folder, "cup", work.photographs[:1], ()).prepare()
    assert [path.name for path in links.iterdir()] == ["p1.png"]


def link(tmp_path, *names: str, masks=()) -> dict[str, str]:
    """The links that are made to files of these names, and what they lead to; the masks' too."""
    files = [tmp_path / name for name in names]
    work = Workspace(tmp_path / "cache", "cup", tuple(files), tuple(tmp_path / m for m in masks))
    for file in (*files, *work.masks):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    work.prepare()
    return {
        str(path.relative_to(work.folder)): os.path.relpath(os.readlink(path), tmp_path)
        for path in sorted(work.folder.rglob("*/*"), key=lambda path: natural_key(path.name))
        if path.is_symlink()
    }


NOT_UTF8 = b"K\xf6nig".decode("utf-8", "surrogateescape")


@pytest.mark.parametrize(
    ("names", "links"),
    [
        (["a/x 1.JPG", "a/x [2].jpg"], ["x 1.JPG", "x [2].jpg"]),
        (["ring1/x.jpg", "ring2/x.jpg"], ["ring1_x.jpg", "ring2_x.jpg"]),
        (["{a}/{1}.jpg", "{a}/{2}.heic"], ["_1_.jpg", "_2_.heic"]),
        ([f"{NOT_UTF8}/1.jpg", f"{NOT_UTF8}/{NOT_UTF8}.jpg"], ["1.jpg", "K_nig.jpg"]),
        (["a\n1.jpg", "a\t1.jpg"], ["0000_a_1.jpg", "0001_a_1.jpg"]),
        ([".1.jpg", ".2.jpg"], ["0000_.1.jpg", "0001_.2.jpg"]),
        (["IMG_1", "IMG_2"], ["IMG_1.png", "IMG_2.png"]),
        (
            ["b" * 240 + "/x.jpg", "c" * 240 + "/x.jpg"],
            ["b" * 198 + "_x.jpg", "c" * 198 + "_x.jpg"],
        ),
        (["z|.jpg", "z}.jpg"], ["0000_z|.jpg", "0001_z_.jpg"]),
    ],
)
def test_links_have_names_that_rules_take_and_keep_the_order(tmp_path, names, links):
    assert link(tmp_path, *names) == {
        f"photographs/{made}": name for made, name in zip(links, names, strict=True)
    }


def test_a_mask_is_linked_by_the_name_of_its_view(tmp_path):
    shots, masks = ["r1/x.jpg", "r2/x.jpg"], ["r1/x_mask.png", "r2/x.jpg.png"]
    made = link(tmp_path, *shots, masks=masks)
    assert made == {
        "photographs/r1_x.jpg": shots[0],
        "photographs/r2_x.jpg": shots[1],
        "masks/r1_x.png": masks[0],
        "masks/r2_x.png": masks[1],
    }


def test_messages_name_files_that_are_linked_by_other_names(tmp_path):
    files = tuple(tmp_path / name for name in (r"r1\g<0>/x.jpg", f"{NOT_UTF8}/x.jpg"))
    work = Workspace(tmp_path / "cache", "cup", files, ())
    first, second = name_links(files)
    said = f"photographs/{first}.jpg is as {work.folder}/photographs/{second}.jpg"
    assert work.restore(said) == f"{files[0]} is as {files[1]}"


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


def test_nothing_is_written_before_the_options_are_checked(work):
    row = {"silhouettes": "threshold", "cameras": "calibrate"}
    with pytest.raises(InputError, match=r"^turntable: should be distance"):
        work.check(row | {"turntable": "1;2"}, VALUES)
    assert not work.folder.exists()
    work.check(row, VALUES)
    assert not work.folder.exists()


PERSONS = {"datasets.tsv": "mine", "config.yaml": "mine", "photographs/p1.png": "mine", "a": "b"}


@pytest.mark.parametrize("name", [*PERSONS, "silmesh.json"])
def test_a_folder_of_a_persons_is_left_alone(work, name):
    file = work.folder / name
    file.parent.mkdir(parents=True)
    file.write_text(PERSONS.get(name, '["version"]'))
    before = look_around(work.folder)
    remedy = "--keep should name another folder"
    for act in (work.prepare, lambda: try_workspace(work.folder, remedy)):
        with pytest.raises(InputError, match="should be a new or an empty one"):
            act()
    assert look_around(work.folder) == before


def test_photographs_are_not_linked_to_themselves(work):
    inside = work.photographs[0].parent
    itself = Workspace(inside, "cup", work.photographs, ())
    with pytest.raises(InputError, match=r"holds p1.png"):
        itself.prepare()
    assert [path.is_symlink() for path in work.photographs] == [False, False]


@pytest.mark.parametrize("name", ["datasets.tsv", "config.yaml"])
def test_what_a_person_changed_is_not_overwritten(work, name):
    row = {"silhouettes": "threshold", "cameras": "calibrate"}
    work.prepare()
    for size in (32, 64, 32):
        work.configure(row, VALUES | {"views": {"size": size}})
    (work.folder / name).write_text("edited")
    with pytest.raises(InputError, match=f"{name}: was changed since silmesh wrote it"):
        work.configure(row, VALUES)
    assert (work.folder / name).read_text() == "edited"
    (work.folder / name).unlink()
    work.configure(row, VALUES)


def test_a_kill_between_the_note_and_the_file_stops_nobody(work, monkeypatch):
    row = {"silhouettes": "threshold", "cameras": "calibrate"}
    work.prepare()
    work.configure(row, VALUES)
    before = (work.folder / "config.yaml").read_text()
    work.configure(row, VALUES | {"views": {"size": 64}})
    (work.folder / "config.yaml").write_text(before)  # noted, and not yet written
    work.configure(row, VALUES)


def test_only_links_of_ours_are_removed(work):
    work.prepare()
    links = work.folder / "photographs"
    fewer = Workspace(work.folder, "cup", work.photographs[:1], ())
    (links / "mine.png").symlink_to(work.photographs[1])
    for _ in range(2):
        with pytest.raises(InputError, match=r"mine.png: was not put there by silmesh"):
            fewer.prepare()
        assert {path.name for path in links.iterdir()} == {"p1.png", "p2.png", "mine.png"}
    (links / "mine.png").unlink()
    fewer.prepare()
    assert [path.name for path in links.iterdir()] == ["p1.png"]


def test_what_a_silmesh_that_noted_nothing_left_is_its_own(work):
    row = {"silhouettes": "threshold", "cameras": "calibrate"}
    work.prepare()
    work.configure(row, VALUES)
    (work.folder / "silmesh.json").write_text(json.dumps({"version": "0.1.0"}))
    (work.folder / "config.yaml").write_text("of another version")
    fewer = Workspace(work.folder, "cup", work.photographs[1:], ())
    try_workspace(work.folder, "")
    fewer.prepare()
    assert [path.name for path in (work.folder / "photographs").iterdir()] == ["p2.png"]


def test_a_folder_of_photographs_that_is_a_link_is_left_alone(work):
    work.prepare()
    links = work.folder / "photographs"
    links.rename(work.folder.parent / "elsewhere")
    links.symlink_to(work.folder.parent / "elsewhere")
    with pytest.raises(InputError, match="photographs: is not of silmesh"):
        Workspace(work.folder, "cup", work.photographs[:1], ()).prepare()
    assert len(list(links.iterdir())) == 2


def test_a_cache_that_cannot_be_written_is_said_only_where_it_is_needed(work, monkeypatch):
    monkeypatch.setenv("SILMESH_CACHE", "/proc/cache")
    row = {"cameras": "calibrate"}
    work.check(row | {"silhouettes": "threshold"}, VALUES)
    with pytest.raises(InputError, match=r"/proc/cache/isnet.onnx: .*SILMESH_CACHE may name"):
        work.check(row | {"silhouettes": "matting"}, VALUES)


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
    monkeypatch.setenv("SILMESH_CACHE", "../cache")
    assert place_of([cup])[0].resolve() == folder
    assert place_of([cup])[0].is_absolute()
    monkeypatch.setenv("SILMESH_CACHE", str(tmp_path / "cache"))
    assert place_of([cup], tmp_path / "kept") == (tmp_path / "kept", name)
    assert place_of([cup / "a.png"])[1] == name
    (tmp_path / NOT_UTF8).mkdir()
    assert place_of([tmp_path / NOT_UTF8])[1] == "K_nig"
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


@pytest.mark.parametrize(
    "noted",
    [
        {"version": ["0.1.0"]},
        {"version": "0.1.0", "photographs": 5},
        {"version": "0.1.0", "photographs": [["a.png", "a.png"], 3]},
        {"version": "0.1.0", "photographs": [["a.png", ["b.png"]]]},
        {"version": "0.1.0", "datasets.tsv": 7},
    ],
)
def test_a_note_that_is_not_of_silmesh_makes_no_folder_its_own(tmp_path, noted):
    (tmp_path / "silmesh.json").write_text(json.dumps(noted))
    before = look_around(tmp_path)
    with pytest.raises(InputError, match=r"holds silmesh\.json, and is no folder that silmesh"):
        claim(tmp_path)
    assert look_around(tmp_path) == before
