import os

import pytest
from PIL import Image

from silmesh.cli.photographs import find_masks, find_photographs, folders_within
from silmesh.errors import InputError


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


def test_what_a_folder_without_photographs_has_instead(tmp_path):
    assert refusal(tmp_path).startswith(f"{tmp_path}: has no photograph (.png, ")
    (tmp_path / "IMG_1.HEIC").touch()
    assert "IMG_1.HEIC: .HEIC is not read; save the photographs as JPEG" in refusal(tmp_path)
    save_series(tmp_path / "jug", "jug")
    save_series(tmp_path / "cup", "cup")
    save_series(tmp_path / "masks", "cup")
    said = refusal(tmp_path)
    assert "has no photographs itself, but 2 folders that do (cup, jug)" in said
    assert f"`silmesh {tmp_path}/cup -o mesh.glb`" in said
    assert f"`silmesh init {tmp_path}`" in said
    assert [path.name for path in folders_within(tmp_path)] == ["cup", "jug"]


def test_several_folders_are_several_objects(tmp_path):
    save_series(tmp_path / "a", "a")
    save_series(tmp_path / "b", "b")
    assert "silmesh makes one object" in refusal(tmp_path / "a", tmp_path / "b")


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
    assert find_photographs(jugs + cups) == (
        cups + jugs,
        [f"these are taken for one object: {expected}"],
    )


def test_a_file_that_is_no_image_is_left_to_the_policy(tmp_path):
    files = save_series(tmp_path, "a")
    files[1].write_text("nonsense")
    assert find_photographs([tmp_path]) == (files, [])


@pytest.mark.parametrize("place", ["photos/masks", "masks"])
def test_masks_in_the_folder_or_beside_it_are_found_if_each_has_one(tmp_path, place):
    files = save_series(tmp_path / "photos", "cup")
    masks = save_series(tmp_path / place, "cup", 2)
    assert find_masks(files) == []
    masks.append(save(tmp_path / place / "cup_2.png"))
    save(tmp_path / place / "jug_0.png")  # another object's
    assert find_masks(files) == masks


def test_masks_that_are_given_must_be_there(tmp_path):
    files = save_series(tmp_path / "photos", "cup")
    save_series(tmp_path / "white", "cup", 2)
    with pytest.raises(InputError, match=r"cup_2.png: has no mask of the same name in .*white"):
        find_masks(files, tmp_path / "white")


def test_a_mask_folder_is_not_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = save_series(tmp_path / "masks", "cup")
    assert find_masks(files) == []
    assert os.listdir(tmp_path) == ["masks"]
