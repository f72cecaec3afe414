"""The dataset list: what is found by it, and how a wrong one is refused."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from silmesh.errors import InputError
from silmesh.planning.datasets import COLUMNS, read_datasets
from silmesh.settings.turntable import Turntable, parse_turntable

HEADER = "object\timages\tmasks\tsilhouettes\tcameras\tturntable\ttruth\tvariants\n"
GOOD = {
    "object": "cup",
    "images": "photos",
    "masks": "masks",
    "silhouettes": "mask",
    "cameras": "turntable",
    "turntable": "2.732,0,5",
    "truth": "",
    "variants": "",
}
STEMS = ["cup_r0", "cup_r5", "cup_r10"]  # in natural order, which is not that of letters


def draw(folder: Path, stems=STEMS) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for stem in stems:
        Image.new("L", (4, 4)).save(folder / f"{stem}.png")


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """Where the list lies; beside it are photographs and masks of a cup."""
    draw(tmp_path / "photos")
    draw(tmp_path / "masks")
    return tmp_path / "list.tsv"


def line(**cells: str) -> str:
    return "\t".join((GOOD | cells).values()) + "\n"


def read_one(table: Path, **cells: str):
    table.write_text(HEADER + line(**cells))
    (dataset,) = read_datasets(table)
    return dataset


def refusal(table: Path, text: str | bytes) -> str:
    table.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(InputError) as caught:
        read_datasets(table)
    message = str(caught.value)
    assert message.startswith(str(table))
    assert "\n" not in message
    return message.removeprefix(str(table))


def test_a_row(table):
    dataset = read_one(table, variants=" a, b,a,")
    assert dataset.object == "cup"
    assert dataset.where == f"{table}, line 2 (cup)"
    assert [path.stem for path in dataset.images] == STEMS
    assert [path.parent.name for path in dataset.images] == ["photos"] * 3
    assert [path.stem for path in dataset.masks] == STEMS
    assert [path.parent.name for path in dataset.masks] == ["masks"] * 3
    assert dataset.turntable == Turntable(2.732, 0.0, 5.0)
    assert dataset.truth is None
    assert dataset.variants == ("a", "b")


def test_paths_are_relative_to_the_table(table, monkeypatch):
    read_one(table)
    monkeypatch.chdir(table.parents[1])
    (dataset,) = read_datasets(Path(table.parent.name) / table.name)
    assert dataset.images[0] == Path(table.parent.name) / "photos" / "cup_r0.png"


@pytest.mark.parametrize(
    ("folder", "cell"),
    [
        ("photos", "photos/*.png"),
        ("my photos", "my photos"),
        ("my photos", "my photos/*_r*.png"),
        ("photos [old]", "photos [old]"),
        ("deep/er", "**/er/*.png"),
        ("photos", "./photos/"),
        ("photos", '"photos"'),
    ],
)
def test_images_by_folder_and_glob(table, folder, cell):
    draw(table.parent / folder)
    assert [path.stem for path in read_one(table, images=cell).images] == STEMS


@pytest.mark.parametrize("name", ["cup [new]", "cup*", "what?", "a[0-9]", "[!a]"])
def test_a_path_that_exists_is_no_glob(table, name):
    draw(table.parent / name, [f"{stem} [edited]*" for stem in STEMS])
    draw(table.parent / f"{name} masks", [f"{stem} [edited]*" for stem in STEMS])
    (table.parent / f"{name}.npy").touch()
    row = read_one(table, images=name, masks=f"{name} masks", cameras=f"file:{name}.npy")
    assert [path.parent.name for path in row.images] == [name] * 3
    assert [path.stem for path in row.masks] == [f"{stem} [edited]*" for stem in STEMS]
    assert row.cameras == f"file:{table.parent}/{name}.npy"


@pytest.mark.parametrize("cell", ["ring*/x*.png", "ring[12]/*", "**/x*.png"])
@pytest.mark.parametrize("masks", ["masks", "masks/*/*.png", "m*/**/*_mask.png"])
def test_equal_names_in_several_folders_are_different_photographs(table, cell, masks):
    for ring in ("ring2", "ring1"):
        draw(table.parent / ring, ["x10", "x9"])
        draw(table.parent / "masks" / ring, ["x10_mask", "x9_mask"])
    for file in (table.parent / "masks").glob("*.png"):
        file.unlink()
    row = read_one(table, images=cell, masks=masks)
    places = [f"{path.parent.name}/{path.stem}" for path in row.images]
    assert places == ["ring1/x9", "ring1/x10", "ring2/x9", "ring2/x10"]
    assert [f"{p.parent.name}/{p.stem}" for p in row.masks] == [f"{p}_mask" for p in places]


@pytest.mark.parametrize("manner", ["{}.jpg.png", "{}_mask.png", "{}.mask.png", "{}-MASK.png"])
@pytest.mark.parametrize("place", ["photos", "white"])
def test_masks_by_every_naming_and_beside_the_photographs(table, manner, place):
    draw(table.parent / place, [Path(manner.format(stem)).stem for stem in STEMS])
    row = read_one(table, masks=place)
    assert [path.stem for path in row.images] == STEMS
    assert [path.name for path in row.masks] == [manner.format(stem) for stem in STEMS]
    assert read_one(table, masks="").masks == (row.masks if place == "photos" else ())
    assert row.notes == ()


def test_what_is_not_used_is_told_of(table):
    draw(table.parent / "masks", ["jug_0"])
    (note,) = read_one(table).notes
    assert note.startswith(f"{table}, line 2 (cup): not used: {table.parent}/masks/jug_0.png: no ")
    draw(table.parent / "photos", ["cup_r0_mask"])
    row = read_one(table, masks="", silhouettes="alpha")
    assert row.masks == ()
    assert row.notes[0].endswith(
        f"photos/cup_r0_mask.png: {table.parent}/photos/cup_r5.png has no mask"
    )


def test_an_absolute_path_and_a_home(table, monkeypatch):
    assert len(read_one(table, images=str(table.parent / "photos")).images) == 3
    monkeypatch.setenv("HOME", str(table.parent))
    assert len(read_one(table, images="~/photos").images) == 3


def test_an_array_of_softras(table):
    np.save(table.parent / "source.npy", np.zeros((3, 4, 8, 8), np.uint8))
    dataset = read_one(table, images="source.npy", masks="", silhouettes="alpha")
    assert dataset.images == (table.parent / "source.npy",)


def test_a_camera_file_and_a_truth(table):
    (table.parent / "camera.npy").touch()
    (table.parent / "true.ply").touch()
    dataset = read_one(table, cameras="file:camera.npy", truth="true.ply", turntable="")
    assert dataset.cameras == f"file:{table.parent / 'camera.npy'}"
    assert dataset.truth == table.parent / "true.ply"
    assert dataset.turntable == Turntable(None, None, None)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text + "\n\t\t\n\n",
        lambda text: text.replace("variants\n", "variants\tnotes\n").replace(
            "5\t\t\n", "5\t\t\thi\n"
        ),
        lambda text: text.replace("2.732,0,5\t\t", "2.732, 0, 5"),
        lambda text: text.replace("cup\t", " cup \t"),
        lambda text: text.replace("\n", "\t\t\n"),
        lambda text: text.replace("variants\n", "variants\t \t\n"),
        lambda text: text.replace("5\t\t\n", "5\t\t\t\t\t \n"),
        lambda text: text.replace("images", "\timages").replace("photos", "\tphotos"),
        lambda text: text.replace("photos", '"photos"').replace("\n", "\t\r\n"),
    ],
    ids=[
        *("BOM", "CRLF", "blank lines", "another column", "a short row", "spaces"),
        *("columns without names", "a header's tabs", "a row's tabs", "an empty column", "quotes"),
    ],
)
def test_what_spreadsheets_write(table, change):
    expected = read_one(table)
    table.write_text(change(HEADER + line()), newline="")
    assert read_datasets(table) == [expected]


@pytest.mark.parametrize("column", COLUMNS)
def test_a_missing_column(table, column):
    names = [name for name in COLUMNS if name != column]
    text = "\t".join(names) + "\n" + "\t".join(GOOD.get(name, "") for name in names) + "\n"
    if column in ("truth", "variants"):
        table.write_text(text)
        assert read_datasets(table)[0].object == "cup"
    elif column in (
        "masks",
        "turntable",
        "sets",
    ):  # the plan refuses what a variant needs
        table.write_text(text)
        assert getattr(read_datasets(table)[0], column) in ((), Turntable(None, None, None))
    else:
        assert refusal(table, text).startswith(f": column {column!r} is missing; the columns are ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "column 'object' is missing"),
        ("\n\n", "column 'object' is missing"),
        (HEADER, "has no row"),
        ((HEADER + line()).replace("\t", ","), "(separated by tabs)"),
        ((HEADER + line()).replace("\t", "  "), "(separated by tabs)"),
        (HEADER.replace("turntable", "turntabel") + line(), "did you mean 'turntable'?"),
        (HEADER.replace("truth", "masks") + line(), "column 'masks' comes twice"),
        (HEADER + line() + line(), "line 3: object 'cup' is also on line 2"),
        (HEADER + "\n" + line() + "\n" + line(), "line 5: object 'cup' is also on line 3"),
        (HEADER + line(variants="\t\tb"), "line 2: has 10 cells under 8 columns"),
        (HEADER + line(variants="\t\tb"), "The first too many is 'b'"),
        (
            HEADER.replace("truth", "") + line(truth="a.ply"),
            "line 2: column 7 has no name, but the cell 'a.ply'",
        ),
        ((HEADER + line()).encode("utf-16"), "is not in UTF-8; should be saved as that"),
        (HEADER + line(images='"photos') + line(object="b"), "line 2: a cell opens with '\"' that"),
    ],
)
def test_a_wrong_table(table, text, message):
    assert message in refusal(table, text)


def test_a_table_that_is_not_there(tmp_path):
    with pytest.raises(InputError) as caught:
        read_datasets(tmp_path / "no.tsv")
    assert str(caught.value) == (
        f"{tmp_path}/no.tsv: cannot be read as a tab-separated table: No such file or directory"
    )


@pytest.mark.parametrize("name", ["", "a" * 81, "a b", "a/b", "..", "ä", "report", "# note", "a.b"])
def test_a_wrong_name(table, name):
    message = refusal(table, HEADER + line(object=name))
    assert message.startswith(
        f", line 2: object {name!r} should be made of at most 80 letters, digits"
    )


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ({"images": ""}, "images: is empty; should be a folder, a glob or a SoftRas .npy"),
        ({"images": "no"}, "no: is not there"),
        ({"images": "photos/*.xyz"}, "photos/*.xyz: matches no file"),
        ({"images": "empty"}, "empty: has no image (.png, .jpg, "),
        ({"images": "one"}, "one: holds 1 photograph; a fit needs at least 2"),
        ({"images": "photos/cup_r0.png"}, "cup_r0.png: is 1 photograph; a fit needs at least 2"),
        ({"images": "no.npy", "masks": ""}, "no.npy: is not there"),
        ({"images": "~nobody-of-this-name/photos"}, "~nobody-of-this-name/photos: is not there"),
        ({"images": "newline"}, "newline/\\nb.png': a path with '\\n' cannot be used; rename it"),
        ({"masks": "photos"}, "photos/cup_r0.png: is a photograph and its own mask"),
        ({"cameras": "file:photos"}, "photos: holds no cameras; known are a COLMAP model"),
        ({"turntable": "600,10,5"}, "a distance of 600 is too far; its unit is the object's size"),
        ({"images": "same"}, "same/a.png: has the same name, 'a', as "),
        ({"images": "**/cup_r0.png"}, "one/cup_r0.png: has no mask of the same name in "),
        ({"images": "x**"}, "x**: cannot be read: "),
        ({"images": "a" * 300}, "with a name of 300; should be at most"),
        ({"images": "a" * 300 + "*"}, "with a name of 301; should be at most"),
        ({"masks": "a" * 300}, "with a name of 300; should be at most"),
        ({"truth": "a" * 300}, "with a name of 300; should be at most"),
        ({"cameras": "file:" + "a" * 300}, "with a name of 300; should be at most"),
        ({"images": "a {cup}"}, "a {cup}: a path with '{' or '}' cannot be used"),
        ({"images": "braces"}, "braces/{0}.png: a path with '{' or '}' cannot be used"),
        ({"masks": "no"}, "no: is not there"),
        ({"masks": "one"}, "photos/cup_r5.png: has no mask of the same name in "),
        ({"masks": "one"}, "one (2 photographs without a mask)"),
        ({"masks": "twice"}, "cup_r0.png: has 2 masks, "),
        (
            {"silhouettes": ""},
            "silhouettes: should be one of mask, alpha, threshold, deeplab, matting, not ''",
        ),
        (
            {"silhouettes": "Mask"},
            "silhouettes: should be one of mask, alpha, threshold, deeplab, matting, not 'Mask'",
        ),
        (
            {"cameras": ""},
            "cameras: should be 'turntable', 'calibrate', 'colmap', 'auto' or 'file:<path>', "
            "not ''",
        ),
        (
            {"cameras": "file:"},
            "cameras: should be 'turntable', 'calibrate', 'colmap', 'auto' or 'file:<path>', "
            "not 'file:'",
        ),
        (
            {"cameras": "sfm"},
            "cameras: should be 'turntable', 'calibrate', 'colmap', 'auto' or 'file:<path>', "
            "not 'sfm'",
        ),
        ({"cameras": "file:no.npy"}, "no.npy: is not there"),
        ({"truth": "no.ply"}, "no.ply: is not there"),
        ({"truth": "photos"}, "photos: is not there"),
    ],
)
def test_a_wrong_cell(table, cells, message):
    (table.parent / "empty").mkdir()
    draw(table.parent / "one", STEMS[:1])
    draw(table.parent / "two", STEMS[:2])
    draw(table.parent / "braces", ["{0}", "{1}"])
    draw(table.parent / "twice", [*STEMS, "cup_r0_mask"])
    draw(table.parent / "same", ["a", "b"])
    (table.parent / "same/a.jpg").touch()
    draw(table.parent / "newline", ["a", "\nb"])
    found = refusal(table, HEADER + line(**cells))
    assert found.startswith(", line 2 (cup): ")
    assert message in found


@pytest.mark.parametrize("cell", ["2.732", "2.732,0", "2.732,0,5,6", "a,0,5", ",5", "2.732;0;5"])
def test_a_turntable_of_another_form(table, cell):
    message = refusal(table, HEADER + line(turntable=cell))
    assert f"should be distance,elevation,step, for example 2.732,0,5, not {cell!r}" in message


@pytest.mark.parametrize("cell", ["2,0,\u0665", "2,\u0663\u0660,5", ",5,20;,40,\uff12\uff10"])
def test_a_turntable_in_digits_of_another_script(table, cell):
    message = refusal(table, HEADER + line(turntable=cell))
    digits = "".join(c for c in cell if not c.isascii())
    assert f"({digits!r} should be digits from 0 to 9)" in message


def test_underscores_are_no_part_of_a_number():
    with pytest.raises(InputError, match="should be distance,elevation,step"):
        parse_turntable(",1_0,5")


@pytest.mark.parametrize(
    "cell",
    ["0,0,5", "-1,0,5", "nan,0,5", "2,91,5", "2,nan,5", "2,0,0", "2,0,nan", "2,0,361"],
)
def test_a_turntable_of_wrong_numbers(table, cell):
    message = refusal(table, HEADER + line(turntable=cell))
    assert f"turntable: {cell!r}: should have a positive distance, an elevation of" in message


def test_rounds_of_more_photographs_than_there_are(table):
    message = refusal(table, HEADER + line(cameras="calibrate", turntable=",5,20;,40,20"))
    assert "turntable: names 2 rounds of 3 photographs; each round should have 5 or" in message


def test_rounds_beside_sets(table):
    for name in ("up", "down"):
        draw(table.parent / "over", [f"{name}_{i}" for i in range(5)])
    columns = {"object": "cup", "images": "over", "silhouettes": "threshold", "cameras": "auto"}
    columns |= {"sets": "up_*;down_*", "turntable": ",5,72;,40,72"}
    rows = ("\t".join(columns), "\t".join(columns.values()))
    message = refusal(table, "\n".join(rows) + "\n")
    assert "turntable: names 2 rounds about one axis, and sets 2 sets, between which" in message


def test_a_turntable_may_turn_the_other_way(table):
    assert read_one(table, turntable="2.732,30,-5").turntable == Turntable(2.732, 30, -5)


def test_a_turntable_of_several_rounds(table):
    draw(table.parent / "many", [f"r{i}" for i in range(36)])
    cells = {"images": "many", "masks": "many_masks", "cameras": "calibrate"}
    draw(table.parent / "many_masks", [f"r{i}" for i in range(36)])
    known = read_one(table, **cells, turntable=",5,20,18; ,40, ").turntable
    assert known.rounds == (Turntable(None, 5, 20, 18), Turntable(None, 40, None))
    assert not known.complete
    assert parse_turntable(known.text) == known


@pytest.mark.parametrize("cell", [",5,20;", ",5,20;,40", ",5,20,x;,40,20", ",5,20,18.5;,40,20"])
def test_rounds_of_another_form(table, cell):
    message = refusal(table, HEADER + line(turntable=cell))
    assert "several rounds are separated by ';', as in ',5,20;,40,20'" in message


def test_a_round_of_three_photographs_is_refused(table):
    message = refusal(table, HEADER + line(turntable=",5,20,18;,40,20,3"))
    assert "a round of 3 photographs is too short" in message


@pytest.mark.parametrize(
    ("cell", "known"),
    [
        ("", (None, None, None)),
        (",,5", (None, None, 5)),
        (",10,5", (None, 10, 5)),
        (" , 10 , ", (None, 10, None)),
    ],
)
def test_a_turntable_whose_geometry_is_to_be_found(table, cell, known):
    dataset = read_one(table, cameras="calibrate", turntable=cell)
    assert dataset.cameras == "calibrate"
    assert dataset.turntable == Turntable(*known)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((3, 8, 8), np.uint8), "not [3, 8, 8] of uint8"),
        (np.zeros((3, 8, 8, 4), np.uint8), "not [3, 8, 8, 4] of uint8"),
        (np.zeros((3, 4, 8, 8)), "not [3, 4, 8, 8] of float64"),
        (np.zeros((1, 4, 8, 8), np.uint8), "holds 1 photograph; a fit needs at least 2"),
        (np.array([{}], dtype=object), "cannot be read as a .npy array"),
    ],
)
def test_an_array_of_another_shape(table, array, message):
    np.save(table.parent / "source.npy", array)
    cells = {"images": "source.npy", "masks": "", "silhouettes": "alpha"}
    assert message in refusal(table, HEADER + line(**cells))


def archive(table: Path, images: np.ndarray | None = None, voxels: np.ndarray | None = None):
    """Write the two files of a class, of four objects if nothing else is given."""
    images = np.zeros((4, 24, 4, 64, 64), np.uint8) if images is None else images
    voxels = np.ones((4, 32, 32, 32), np.uint8) if voxels is None else voxels
    np.savez_compressed(table.parent / "a_test_images.npz", images)
    np.savez_compressed(table.parent / "a_test_voxels.npz", voxels)
    return {"masks": "", "silhouettes": "alpha", "turntable": "", "truth": "a_test_voxels.npz"}


def test_an_object_of_an_archive(table):
    dataset = read_one(table, **archive(table), images="a_test_images.npz#3")
    assert dataset.object == "cup"
    assert dataset.images == (table.parent / "a_test_images.npz#3",)
    assert dataset.truth == table.parent / "a_test_voxels.npz#3"
    assert dataset.turntable == Turntable(2.732, 30, -15)


def test_a_row_of_several_objects_is_a_row_of_each(table):
    cells = archive(table) | {"images": "a_test_images.npz#0-1,3"}
    table.write_text(HEADER + line(**cells) + line(object="jug"), encoding="utf-8")
    *cups, jug = read_datasets(table)
    assert [cup.object for cup in cups] == ["cup_0", "cup_1", "cup_3"]
    assert [cup.truth.name for cup in cups] == [f"a_test_voxels.npz#{i}" for i in (0, 1, 3)]
    assert cups[2].where == f"{table}, line 2 (cup_3)"
    assert jug.object == "jug"
    table.write_text(HEADER + line(**cells) + line(object="cup_3"), encoding="utf-8")
    with pytest.raises(InputError, match="line 3: object 'cup_3' is also on line 2"):
        read_datasets(table)


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("a_test_images.npz", "holds 4 objects; should say which: 'a_test_images.npz#3' one, "),
        ("a_test_images.npz#", "holds 4 objects; should say which"),
        ("a_test_images.npz#0-4", "images: '0-4': 0-4 should rise within 0 to 3"),
        ("a_test_images.npz#x", "should be numbers and ranges of them, as '1-10,17', not 'x'"),
        ("b_test_images.npz#0", "b_test_images.npz: is not there"),
        ("a_test_voxels.npz#0", "should hold [objects, 24, 4, 64, 64] of uint8, not [4, 32, 32, "),
    ],
)
def test_other_objects_of_an_archive(table, cell, said):
    cells = archive(table)
    assert said in refusal(table, HEADER + line(**cells | {"images": cell}))


@pytest.mark.parametrize(
    ("images", "voxels", "said"),
    [
        (np.zeros((2, 20, 4, 64, 64), np.uint8), None, "not [2, 20, 4, 64, 64] of uint8"),
        (np.zeros((2, 24, 3, 64, 64), np.uint8), None, "not [2, 24, 3, 64, 64] of uint8"),
        (np.zeros((2, 24, 4, 64, 64), np.float32), None, "not [2, 24, 4, 64, 64] of float32"),
        (np.zeros((48, 4, 64, 64), np.uint8), None, "not [48, 4, 64, 64] of uint8"),
        (np.zeros(3, np.uint8), None, "not [3] of uint8"),
        (np.array([{}], dtype=object), None, "should hold numbers row by row"),
        (None, np.ones((4, 64, 64, 64), bool), "should hold [objects, 32, 32, 32] of 0 and 1, not"),
        (None, np.ones((3, 32, 32, 32), bool), "a_test_voxels.npz: holds 3 objects, but "),
    ],
)
def test_an_archive_of_another_shape(table, images, voxels, said):
    cells = archive(table, images, voxels)
    assert said in refusal(table, HEADER + line(**cells, images="a_test_images.npz#0"))


def test_an_archive_takes_no_masks(table):
    cells = archive(table) | {"masks": "masks", "images": "a_test_images.npz#0"}
    assert "has its masks in its alpha channel" in refusal(table, HEADER + line(**cells))


@pytest.mark.parametrize("size", [0, 5, 40, -1])
def test_a_truncated_array(table, size):
    file = table.parent / "source.npy"
    np.save(file, np.zeros((3, 4, 8, 8), np.uint8))
    os.truncate(file, size if size >= 0 else file.stat().st_size + size)
    cells = {"images": "source.npy", "masks": "", "silhouettes": "alpha"}
    assert "source.npy: cannot be read as a .npy array" in refusal(table, HEADER + line(**cells))


def test_a_folder_that_may_not_be_read(table, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(os, "scandir", refuse)
    assert "photos: cannot be read: Permission denied" in refusal(table, HEADER + line())


def test_an_array_takes_no_masks(table):
    np.save(table.parent / "source.npy", np.zeros((3, 4, 8, 8), np.uint8))
    message = refusal(table, HEADER + line(images="source.npy"))
    assert "an array of images has its masks in its alpha channel" in message


@pytest.mark.parametrize("column", ["images", "masks", "cameras", "truth"])
@pytest.mark.parametrize("path", ["a" * 256, "ä" * 200, "a/" * 3000])
def test_a_path_that_no_file_can_have(table, column, path):
    cell = f"file:{path}.npy" if column == "cameras" else f"{path}.ply"
    message = refusal(table, HEADER + line(**{column: cell}))
    assert "is a path of" in message
    assert len(message) < 1000


@pytest.mark.parametrize("pattern", ["x**", "photos/**.png", "**x/*.png"])
def test_a_glob_that_is_none(table, pattern):
    assert "cannot be read: Invalid pattern: '**'" in refusal(table, HEADER + line(images=pattern))


def test_a_cell_of_too_many_letters(table):
    assert "field larger than field limit" in refusal(table, HEADER + line(object="a" * 200_000))


def test_a_table_whose_name_the_locale_cannot_hold(tmp_path):
    with pytest.raises(InputError, match="cannot be read as a tab-separated table: 'utf-8' codec"):
        read_datasets(tmp_path / "d\ud800.tsv")


def test_sets_are_views_by_their_names_or_folders(table):
    for folder in ("up", "down"):
        draw(table.parent / "both" / folder, [f"r{i}" for i in range(5)])
    row = {"images": "both/*/*.png", "masks": "", "silhouettes": "threshold"}
    header = HEADER.replace("\n", "\tsets\n")

    def sets(cell: str):
        table.write_text(header + line(**row, sets=cell))
        return read_datasets(table)[0].sets

    found = tuple(tuple(f"{folder}_r{i}" for i in range(5)) for folder in ("up", "down"))
    assert sets("up;down") == found
    assert sets("up_*,down_r?") == found
    assert sets("") == ()
    said = refusal(table, header + line(**row, sets="up;aside"))
    assert said.startswith(", line 2 (cup): sets: 'aside' matches no view and no folder")
