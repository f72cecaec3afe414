import os
import re
import shlex
import subprocess

import pytest
from PIL import Image

from silmesh.errors import InputError
from silmesh.intake.photographs import (
    describe_count,
    find_cameras,
    find_masks,
    find_photographs,
    find_unread,
    folders_within,
)


def save(path, size=(40, 30), camera=None):
    path.parent.mkdir(parents=True, exist_ok=True)
    exif = Image.Exif()
    if camera:
        exif[272] = camera
    Image.new("RGB", size).save(path, exif=exif)
    return path


def save_series(folder, name, count=3, **kind):
    return [save(folder / f"{name}_{i}.png", **kind) for i in range(count)]


def refusal(*paths):
    with pytest.raises(InputError) as refused:
        find_photographs(paths)
    return str(refused.value)


def test_a_folder_in_natural_order(tmp_path):
    for i in (10, 2, 1):
        save(tmp_path / f"r{i}.png")
    files, notes = find_photographs([tmp_path])
    assert [file.name for file in files] == ["r1.png", "r2.png", "r10.png"]
    assert notes == []


def test_photographs_of_words_and_turned_ones_are_one_object(tmp_path):
    for name, size in (("front", (40, 30)), ("left", (30, 40)), ("back", (40, 30))):
        save(tmp_path / f"{name}.png", size)
    assert len(find_photographs([tmp_path])[0]) == 3


@pytest.mark.parametrize("name", ["turn.mp4", "TURN.MOV"])
def test_a_video_is_named_alone(tmp_path, name):
    video = tmp_path / name
    video.touch()
    assert refusal(video, video).startswith(f"{video}: is a video; one alone is cut")
    assert f"`silmesh {video} -o mesh.glb` cuts it" in refusal(tmp_path)
    save_series(tmp_path, "a")
    assert find_photographs([tmp_path])[1] == [
        f"not used: {name}: a video is cut into photographs where it alone is named"
    ]


def test_what_a_folder_without_photographs_has_instead(tmp_path):
    assert refusal(tmp_path).startswith(f"{tmp_path}: has no photograph (.png, ")
    (tmp_path / "IMG_1.CR2").touch()
    assert "has no photograph, but IMG_1.CR2: not read; save them as JPEG" in refusal(tmp_path)
    assert refusal(tmp_path / "IMG_1.CR2").startswith("IMG_1.CR2: not read; save them as JPEG")
    save_series(tmp_path / "jug", "jug")
    save_series(tmp_path / "cup", "cup")
    save_series(tmp_path / "masks", "cup")
    said = refusal(tmp_path)
    assert "has no photographs itself, but 2 folders that do (cup, jug)" in said
    assert f"`silmesh {tmp_path}/cup -o mesh.glb`" in said
    assert f"`silmesh init {tmp_path}`" in said
    assert [path.name for path in folders_within(tmp_path)] == ["cup", "jug"]


@pytest.mark.parametrize("names", [("IMG", "IMG"), ("a", "b")])
def test_several_folders_are_sets_or_rounds_of_one_object(tmp_path, names):
    folders = [tmp_path / "first", tmp_path / "second"]
    files = [save_series(folder, name) for folder, name in zip(folders, names, strict=True)]
    save(folders[0] / "masks/IMG_1.png")
    found, (said,) = find_photographs(folders)
    assert found == [*files[0], *files[1]]
    alike = f"3 in {folders[0]}, 3 in {folders[1]}"
    differ = "3 a_# (as a_0.png), 3 b_# (as b_0.png)"
    assert said == f"these are taken for one object: {alike if len(set(names)) == 1 else differ}"


def test_a_folder_named_twice_is_one(tmp_path):
    files = save_series(tmp_path, "a")
    found, notes = find_photographs([tmp_path, tmp_path / "../" / tmp_path.name])
    assert ([file.resolve() for file in found], notes) == (files, [])


def test_folders_beside_files_and_an_empty_one_are_refused(tmp_path):
    files = save_series(tmp_path / "a", "a")
    (tmp_path / "b").mkdir()
    assert "folders are named beside files" in refusal(tmp_path / "a", files[0])
    assert refusal(tmp_path / "a", tmp_path / "b").startswith(f"{tmp_path}/b: has no photograph")


def test_a_folder_of_two_series_that_are_said_to_be_sets_is_one_object(tmp_path):
    save_series(tmp_path, "down")
    save_series(tmp_path, "up")
    assert "say so by --sets" in refusal(tmp_path)
    files, (said,) = find_photographs([tmp_path], several=True)
    assert len(files) == 6
    assert said.startswith("these are taken for one object: 3 down_#")


def test_one_photograph_is_too_few(tmp_path):
    assert "1 photograph; a mesh needs at least 2" in refusal(save(tmp_path / "a.png"))


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ({"size": (50, 30)}, "4 of 40x30 (as cup_0.png), 3 of 50x30 (as jug_0.png)"),
        ({"camera": "X100"}, "4 of 40x30 (as cup_0.png), 3 of 40x30 by X100 (as jug_0.png)"),
        ({}, "4 cup_# (as cup_0.png), 3 jug_# (as jug_0.png)"),
    ],
)
def test_a_folder_of_two_objects_is_refused_and_one_by_its_files_is_not(tmp_path, kind, expected):
    cups = save_series(tmp_path, "cup", 4)
    jugs = save_series(tmp_path, "jug", **kind)
    said = refusal(tmp_path)
    assert f"holds photographs that differ: {expected}." in said
    assert f"`silmesh {tmp_path}/cup_*.png -o mesh.glb`" in said
    assert find_photographs(cups) == (cups, [])
    assert find_photographs([tmp_path], several=True)[0] == cups + jugs
    assert find_photographs(jugs + cups) == (
        cups + jugs,
        [f"these are taken for one object: {expected}"],
    )


def test_a_folder_of_one_series_of_many_sizes_is_of_crops(tmp_path):
    for i in range(10):
        save(tmp_path / f"a_{i}.png", size=(40 + i // 2, 30))
    files, (said,) = find_photographs([tmp_path])
    assert len(files) == 10
    assert said.startswith("these are taken for one object: 2 of 40x30 (as a_0.png)")
    save(tmp_path / "b_1.png", size=(40, 30))  # of another series
    assert "holds photographs that differ" in refusal(tmp_path)


def test_a_file_that_is_no_image_is_left_to_the_policy_and_told_of(tmp_path):
    files = save_series(tmp_path, "a")
    assert describe_count(files) == "3 photographs"
    files[1].write_text("nonsense")
    assert find_photographs([tmp_path]) == (files, [])
    said = describe_count(files)
    assert said.startswith("2 photographs; 1 more cannot be read: a_1.png, cannot identify image")
    assert said.endswith(f"`magick mogrify -format jpg {tmp_path}/*.png`")


OTHERS = {
    "IMG_1.CR2": "2 .cr2 (as IMG_1.CR2), IMG_3.gif: not read; save them as JPEG or PNG, ",
    "IMG_2.cr2": "",
    "IMG_3.gif": "",
    "a_1.dng": "a_1.dng: each beside a photograph of its name",
    "a_0.xmp": "2 .xmp (as a_0.xmp), a_1.AAE: sidecars",
    "a_2.XMP": "",
    "a_1.AAE": "",
    "live.mov": "live.mov: a video is cut into photographs where it alone is named",
    "notes.txt": "notes.txt: no photographs",
    "._a_0.png": None,
    ".DS_Store": None,
    "Thumbs.db": None,
}


def test_what_lies_beside_photographs_and_is_not_used_is_told_by_kind(tmp_path):
    files = save_series(tmp_path / "photos", "a")
    for name in OTHERS:
        (tmp_path / "photos" / name).write_text("nonsense")
    save_series(tmp_path / "photos" / "old", "a")
    (tmp_path / "photos" / "empty").mkdir()
    expected = ["not used: old: folders with images"]
    expected += [f"not used: {said}" for said in OTHERS.values() if said]
    found, notes = find_photographs([tmp_path / "photos"])
    assert found == files
    assert len(notes) == len(expected)
    assert all(any(note.startswith(said) for note in notes) for said in expected), notes
    named = [path for path in (tmp_path / "photos").glob("[!.]*") if path.is_file()]
    assert find_photographs(named)[0] == files
    assert set(notes) - set(find_photographs(named)[1]) <= {
        "not used: old: folders with images",
        "not used: notes.txt: no photographs",
    }


def test_photographs_in_formats_that_are_not_read_are_counted_but_not_twins(tmp_path):
    files = save_series(tmp_path, "a")
    lost = [tmp_path / name for name in ("IMG_1.CR2", "IMG_2.gif")]
    for path in [*lost, *(tmp_path / name for name in ("a_1.dng", "a_1.xmp", "notes.txt"))]:
        path.touch()
    assert find_unread([tmp_path], files) == lost
    (said,) = [note for note in find_photographs([tmp_path])[1] if "not read" in note]
    assert said.endswith(f"`magick mogrify -format jpg {tmp_path}/*.CR2 {tmp_path}/*.gif`")
    assert set(find_unread(list(tmp_path.iterdir()), files)) == set(lost)


def test_what_is_used_otherwise_is_not_told_of(tmp_path, monkeypatch):
    save_series(tmp_path, "a")
    used = [tmp_path / name for name in ("mine.json", "mesh.glb")]
    for path in used:
        path.touch()
    save_series(tmp_path / "white", "a")
    assert len(find_photographs([tmp_path])[1]) == 2
    monkeypatch.chdir(tmp_path)
    assert find_photographs([tmp_path], [*used, type(tmp_path)("white")])[1] == []


@pytest.mark.parametrize("name", ["transforms.json", "cameras.xml", "poses_bounds.npy", "sparse/0"])
@pytest.mark.parametrize("place", ["", "photos"])
def test_cameras_beside_photographs_are_told_of_with_their_option(tmp_path, name, place):
    files = save_series(tmp_path / "photos", "a")
    assert find_cameras(files) == []
    cameras = tmp_path / place / name
    cameras.mkdir(parents=True) if name == "sparse/0" else cameras.touch()
    cameras = tmp_path / place / name.partition("/")[0]
    (said,) = find_cameras(files)
    assert said.startswith(f"found, not used: {cameras}; `--cameras file:{cameras}` takes")
    assert find_photographs([tmp_path / "photos"])[1] == []


def test_cameras_beside_the_folder_that_one_is_in(tmp_path, monkeypatch):
    files = save_series(tmp_path / "photos", "a")
    (tmp_path / "cameras.json").touch()
    monkeypatch.chdir(tmp_path / "photos")
    files, _ = find_photographs([type(tmp_path)()])
    assert find_cameras(files)[0].startswith("found, not used: ../cameras.json; ")


@pytest.mark.parametrize("turned", ["by EXIF", "without"])
def test_some_upright_photographs_among_lying_ones_are_told_of(tmp_path, turned):
    exif = Image.Exif()
    exif[274] = 6
    for i in range(12):
        upright = i % 3 == 1
        image = Image.new("RGB", (30, 40) if upright else (40, 30))
        kept = {}
        if upright and turned == "by EXIF":
            image, kept = image.transpose(Image.Transpose.ROTATE_90), {"exif": exif}
        image.save(tmp_path / f"{i}.jpg", **kept)
    (said,) = find_photographs([tmp_path])[1]
    assert said.startswith(
        "8 photographs are 40x30 and 4 are 30x40: was their EXIF orientation lost?"
    )


@pytest.mark.parametrize("name", ["photos", "my photos", "it's", "K\u00f6ln [1]"])
def test_advised_commands_can_be_run(tmp_path, name):
    """What stands between backticks is what the shell takes for these files."""
    folder = tmp_path / name
    cups = save_series(folder, "2nd cup", 4)
    save_series(folder, "jug", size=(50, 30))
    said = refusal(folder)
    assert _files_of(_advised(said)) == {path.name for path in cups}
    for path in folder.iterdir():
        path.unlink()
    (folder / "a 1.CR2").touch()
    assert _files_of(_advised(refusal(folder))) == {"a 1.CR2"}
    (folder / "a 1.CR2").rename(folder / "turn it.mov")
    assert shlex.split(_advised(refusal(folder)))[1] == f"{folder}/turn it.mov"
    save_series(folder / "in it", "a")
    one, table = re.findall("`(.*?)`", refusal(folder))
    assert len(find_photographs([type(tmp_path)(shlex.split(one)[1])])[0]) == 3
    assert shlex.split(table) == ["silmesh", "init", str(folder)]
    (folder / "cameras.json").touch()
    (cameras,) = find_cameras(save_series(folder, "b"))
    option = shlex.split(_advised(cameras))[1]
    assert option == f"file:{folder}/cameras.json"


def _advised(said: str) -> str:
    (command,) = re.findall("`(.*?)`", said)
    return command


def _files_of(command: str) -> set[str]:
    """The names of the files that the shell makes of a command's words."""
    words = f"printf '%s\\n' {command}"
    done = subprocess.run(["bash", "-c", words], capture_output=True, encoding="utf-8", check=True)
    return {os.path.basename(word) for word in done.stdout.splitlines() if os.path.exists(word)}


@pytest.mark.parametrize("place", ["photos/masks", "masks", "photos/Mask", "photos"])
@pytest.mark.parametrize("manner", ["{}.png", "{}.png.png", "{}_mask.png", "{}.mask.png"])
def test_masks_are_found_if_each_photograph_has_one(tmp_path, place, manner):
    if (place, manner) == ("photos", "{}.png"):
        return  # those would be the photographs themselves
    files = save_series(tmp_path / "photos", "cup")
    names = [manner.format(file.stem) for file in files]
    masks = [save(tmp_path / place / name) for name in names[:2]]
    assert find_masks(files) == (
        [],
        [
            f"not used: {tmp_path / place}: has no mask of cup_2.png (1 of 3 photographs lack "
            "one); draw the rest, or leave those photographs out, to have masks used",
        ],
    )
    masks.append(save(tmp_path / place / names[2]))
    assert find_masks(files) == (masks, [])
    assert find_masks(files, tmp_path / place) == (masks, [])
    assert find_photographs([tmp_path / "photos"])[0] == files
    spare = save(tmp_path / place / manner.format("jug_0"))
    told = [f"not used: {spare}: no photograph has the name of that mask"]
    assert find_masks(files) == find_masks(files, tmp_path / place) == (masks, told)


def test_masks_that_are_named_with_the_photographs_are_none(tmp_path):
    files = save_series(tmp_path / "photos", "cup")
    masks = [save(tmp_path / "photos" / f"{file.stem}_MASK.png") for file in files]
    said = "named as masks, not as photographs: 3 .png (as cup_0_MASK.png)"
    assert find_photographs(files + masks) == (files, [said])
    assert find_masks(files) == (masks, [])


def test_a_folder_of_masks_that_the_shell_names_with_the_photographs_is_none_of_them(tmp_path):
    files = save_series(tmp_path / "photos", "cup")
    save_series(tmp_path / "photos/masks", "cup")
    assert find_photographs(list((tmp_path / "photos").iterdir())) == (files, [])


def test_masks_of_names_that_say_nothing_are_told_of(tmp_path):
    files = save_series(tmp_path / "photos", "cup")
    save_series(tmp_path / "masks", "white")
    (said,) = find_masks(files)[1]
    assert said.startswith(f"not used: {tmp_path}/masks: none of its 3 images is named as the mask")


@pytest.mark.parametrize("places", ["{}/masks", "masks/{}", "{}"])
def test_masks_of_equal_names_are_found_folder_by_folder(tmp_path, places):
    rings = [tmp_path / name for name in ("ring1", "ring2")]
    shots = [path for ring in rings for path in save_series(ring, "x")]
    masks = [
        save(tmp_path / places.format(path.parent.name) / f"{path.stem}_mask.png") for path in shots
    ]
    files, _ = find_photographs(shots[::-1])
    assert files == shots
    assert find_masks(files) == (masks, [])


def test_masks_that_are_given_must_be_there(tmp_path):
    files = save_series(tmp_path / "photos", "cup")
    save_series(tmp_path / "white", "cup", 2)
    with pytest.raises(InputError, match=r"cup_2.png: has no mask of the same name in .*white"):
        find_masks(files, tmp_path / "white")


def test_a_mask_folder_is_not_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = save_series(tmp_path / "masks", "cup")
    assert find_masks(files) == ([], [])
    assert find_photographs([tmp_path / "masks"])[0] == files
    assert os.listdir(tmp_path) == ["masks"]


def test_links_that_lead_nowhere_are_told_of(tmp_path):
    files = save_series(tmp_path, "a")
    (tmp_path / "a_9.jpg").symlink_to("elsewhere.jpg")
    assert find_photographs([tmp_path]) == (files, ["not used: a_9.jpg: links that lead nowhere"])


def test_no_advice_would_write_over_photographs(tmp_path):
    files = [save(tmp_path / f"a_{i}.jpg") for i in range(3)]
    files[1].write_bytes(b"no image")
    said = describe_count(files)
    assert "2 photographs; 1 more cannot be read: a_1.jpg" in said
    assert said.endswith("Get them anew")


def test_photographs_that_are_not_read_are_counted_but_for_twins(tmp_path):
    files = save_series(tmp_path, "a")
    for name in ("a_0.dng", "a_1.xmp", "b_1.CR2", "b_2.jxl", "notes.txt", "film.mov", ".b.cr2"):
        (tmp_path / name).touch()
    (tmp_path / "a_9.jpg").symlink_to("elsewhere.jpg")
    unread = ["a_9.jpg", "b_1.CR2", "b_2.jxl"]
    assert [path.name for path in find_unread([tmp_path], files)] == unread
    named = [*files, tmp_path / "b_1.CR2", tmp_path / "notes.txt"]
    assert [path.name for path in find_unread(named, files)] == ["b_1.CR2"]
