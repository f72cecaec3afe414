"""What files are called: views of photographs, and the photograph that a mask is of."""

import os
import subprocess
from pathlib import Path

import pytest

from silmesh.errors import InputError
from silmesh.naming import (
    match_masks,
    name_views,
    natural_key,
    order_photographs,
    pair_masks,
    photograph_stems,
    quote,
    split_masks,
    tell_spare,
)


def paths(*names: str) -> list[Path]:
    return [Path("shots") / name for name in names]


def test_names_are_ordered_as_numbers():
    names = ["b1", "r10", "r5", "r100", "r05", "a"]
    assert sorted(names, key=natural_key)[:2] == ["a", "b1"]
    assert sorted(["r10.png", "r9.png", "r100.png"], key=natural_key)[0] == "r9.png"


def test_views_have_the_stems_of_their_photographs():
    assert name_views(paths("ring1/a 1.jpg", "ring2/a.2.HEIC")) == ["a 1", "a.2"]


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["ring1/a.jpg", "ring2/a.jpg"], ["ring1_a", "ring2_a"]),
        (["ring1/a.jpg", "ring2/a.png", "ring2/b.jpg"], ["ring1_a", "ring2_a", "ring2_b"]),
        (["x/left/a.jpg", "y/left/a.jpg"], ["x_left_a", "y_left_a"]),
        (["a.jpg", "more/a.jpg"], ["a", "more_a"]),
    ],
)
def test_equal_stems_are_told_apart_by_their_folders(files, names):
    assert name_views(paths(*files)) == names


def test_a_series_follows_the_other_and_each_photograph_counts_once(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = [Path(f"ring{i}/x{j}.jpg") for i in (10, 2) for j in (10, 9)]
    found = order_photographs([*files, files[0].absolute()])
    assert [os.path.relpath(file) for file in found] == [
        "ring2/x9.jpg",
        "ring2/x10.jpg",
        "ring10/x9.jpg",
        "ring10/x10.jpg",
    ]


def test_equal_stems_of_one_folder_are_refused_with_what_to_do():
    with pytest.raises(InputError) as refused:
        order_photographs(paths("a.png", "b.jpg", "a.jpg"))
    said = str(refused.value)
    assert said.startswith("shots/a.png: has the same name, 'a', as shots/a.jpg")
    assert "if it is a mask, call it a_mask.png" in said


NAMED = {
    "its own": "{}.png",
    "COLMAP": "{}.JPG.png",
    "OpenMVS": "{}.mask.png",
    "_mask": "{}_mask.png",
    "_MASK": "{}_MASK.PNG",
    "-mask": "{}-mask.tif",
    "_masks": "{}_masks.png",
    "mask_": "mask_{}.png",
    "both": "{}.jpg.mask.png",
    "both, the other way": "{}_mask.jpg.png",
}


@pytest.mark.parametrize("manner", NAMED)
def test_masks_are_told_by_their_names(manner):
    images = paths("IMG_1.jpg", "IMG_10.jpg", "IMG_2 [b].JPG")
    masks = [Path("elsewhere") / NAMED[manner].format(image.stem) for image in images]
    assert match_masks(images, masks[::-1]) == (masks, [])
    assert photograph_stems(masks[0])[-1].startswith("IMG_1")


@pytest.mark.parametrize("manner", [manner for manner in NAMED if manner != "its own"])
def test_masks_beside_photographs_are_no_photographs(manner):
    images = paths("IMG_1.jpg", "IMG_10.jpg")
    masks = paths(*(NAMED[manner].format(image.stem) for image in images))
    assert split_masks(masks + images) == (images, masks)
    spare = paths(NAMED[manner].format("IMG_9"))
    assert split_masks(images + masks + spare) == (images, masks + spare)


@pytest.mark.parametrize("name", ["{}_mask.jpg", "mask_{}.jpg", "{}.mask.jpg", "{}.jpg.jpg"])
def test_photographs_that_are_all_named_as_masks_are_photographs(name):
    files = paths(*(name.format(i) for i in range(3)))
    assert split_masks(files) == (files, [])


def test_photographs_named_as_masks_may_have_masks():
    images = paths("mask_1.jpg", "mask_2.jpg")
    masks = paths("mask_1_mask.png")
    assert split_masks(images + masks) == (images, masks)
    apart = [Path("masks/mask_2.png"), Path("masks/mask_1.png")]
    assert match_masks(images, apart) == (apart[::-1], [])


def test_a_folder_named_so_holds_masks_beside_another():
    images, masks = paths("images/a.jpg", "images/b.jpg"), paths("Masks/a.jpg", "Masks/b.jpg")
    assert split_masks(images + masks) == (images, masks)
    assert split_masks(masks) == (masks, [])


def test_masks_are_matched_by_stem():
    images = [Path("png2") / name for name in ("a.jpg", "b.png")]
    masks = [Path("mask2") / name for name in ("b.png", "a.png")]
    assert match_masks(images, masks) == ([masks[1], masks[0]], [])
    with pytest.raises(
        InputError, match=r"b\.png: has no mask of the same name in .*mask2; .* there is a\.png"
    ):
        match_masks(images, masks[1:])
    with pytest.raises(InputError, match=r"b\.png: is a photograph and its own mask"):
        match_masks(images, [masks[1], images[1]])
    with pytest.raises(InputError, match=r"2 photographs without a mask"):
        match_masks(images, [Path("other.png")])


def test_spare_masks_are_given_back_and_told_of():
    masks = [Path("mask2") / name for name in ("a.png", "b.png", "c.png")]
    assert match_masks([Path("a.jpg")], masks) == (masks[:1], masks[1:])
    assert tell_spare(masks[1:]) == [
        "not used: mask2/b.png and 1 more: no photograph has the name of that mask"
    ]
    assert tell_spare([]) == []


def test_photographs_among_the_masks_are_none():
    images = paths("a.jpg", "b.jpg")
    masks = paths("a_mask.png", "b_mask.png")
    assert match_masks(images, sorted(images + masks)) == (masks, [])


def test_two_masks_of_a_photograph_are_refused_by_name():
    with pytest.raises(InputError, match=r"a\.jpg: has 2 masks, m/a\.png, m/a_mask\.png; should"):
        pair_masks([Path("a.jpg")], [Path("m/a.png"), Path("m/a_mask.png")])


@pytest.mark.parametrize(
    "masks",
    [
        ["masks/ring1/a.png", "masks/ring2/a.png"],
        ["ring1/masks/a.jpg.png", "ring2/masks/a.jpg.png"],
        ["ring1/a_mask.png", "ring2/a_mask.png"],
        ["masks/ring1_a.png", "masks/ring2_a.png"],
    ],
)
def test_masks_of_equal_names_are_matched_folder_by_folder(masks):
    images = paths("ring1/a.jpg", "ring2/a.jpg")
    assert match_masks(images, paths(*masks[::-1])) == (paths(*masks), [])


@pytest.mark.parametrize(
    "name",
    [
        "plain",
        "my photos",
        "it's",
        "[1]*?",
        "-o",
        "a\nb\\'",
        b"K\xf6nig '1".decode("utf-8", "surrogateescape"),
        "Köln $(x)",
    ],
)
def test_a_quoted_path_is_that_path_to_the_shell(tmp_path, name):
    (tmp_path / name).touch()
    command = f"ls -U --quoting-style=literal {quote(name)} && test -e {quote(name)}".encode(
        "utf-8", "surrogateescape"
    )
    done = subprocess.run(["bash", "-c", command], cwd=tmp_path, capture_output=True)
    assert done.returncode == 0, done.stderr
    assert Path(os.fsdecode(done.stdout[:-1])) == Path(name)
    quote(name).encode("utf-8")  # can be printed
