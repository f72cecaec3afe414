"""Tables of ALOI, COIL and ShapeNet: of small files laid out as their archives lay them out."""

import shutil

import numpy as np
import pytest
from PIL import Image
from support.shapenet import write_class

from silmesh.cli.init import write_project
from silmesh.errors import InputError
from silmesh.planning.datasets import read_datasets

ANGLES = range(0, 360, 5)


def draw(folder, names, size=(12, 9), mode="RGB"):
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        Image.new(mode, size).save(folder / name)


def unpack_aloi(folder, objects, size=2, pixels=(12, 9), masks=True):
    digit = "" if size == 1 else str(size)
    for number in objects:
        names = [f"{number}_r{angle}.png" for angle in ANGLES]
        draw(folder / f"png{digit}" / str(number), names, pixels)
        if masks:
            draw(folder / f"mask{digit}" / str(number), names, pixels, "1")


def said_of(folder, *args):
    return list(write_project(folder, True, *args))


def refusal_of(folder):
    with pytest.raises(InputError) as caught:
        said_of(folder)
    return str(caught.value)


@pytest.mark.parametrize("size", [1, 2, 4])
@pytest.mark.parametrize("within", [("", ""), ("aloi_view", "aloi_mask")])
def test_aloi_of_every_size_and_place(tmp_path, size, within):
    unpack_aloi(tmp_path, [1, 2, 11], size)
    digit = "" if size == 1 else str(size)
    for kind, place in zip(("png", "mask"), within, strict=True):
        if place:
            (tmp_path / place).mkdir()
            (tmp_path / f"{kind}{digit}").rename(tmp_path / place / f"{kind}{digit}")
    said = said_of(tmp_path, "aloi", "1-2,11")
    assert said[0] == "3 rows: silhouettes mask, cameras calibrate"
    found = read_datasets(tmp_path / "datasets.tsv")
    assert [dataset.object for dataset in found] == ["aloi_1", "aloi_2", "aloi_11"]
    for dataset in found:
        number = dataset.object.removeprefix("aloi_")
        assert [p.name for p in dataset.images] == [f"{number}_r{a}.png" for a in ANGLES]
        assert [p.name for p in dataset.masks] == [p.name for p in dataset.images]
        assert dataset.turntable.text == ",,5.0"


def test_aloi_without_numbers_is_all_that_is_there(tmp_path):
    unpack_aloi(tmp_path, [10, 9], masks=False)
    draw(tmp_path / "png2/9", ["9_l1c1.png", "9_i110.png", "9_c.png"])  # of other archives
    said = said_of(tmp_path, "aloi")
    assert said[0] == (
        "no folder mask2: silhouettes are found by 'threshold'; to use ALOI's masks, unpack "
        f"aloi_mask2.tar in {tmp_path}"
    )
    found = read_datasets(tmp_path / "datasets.tsv")
    assert [dataset.object for dataset in found] == ["aloi_9", "aloi_10"]
    assert {len(dataset.images) for dataset in found} == {72}
    assert {dataset.silhouettes for dataset in found} == {"threshold"}


def test_aloi_of_two_sizes_takes_the_one_with_masks(tmp_path):
    unpack_aloi(tmp_path, [1], size=1, masks=False)
    unpack_aloi(tmp_path, [1], size=4)
    said = said_of(tmp_path, "aloi")
    assert said[0] == f"not used: {tmp_path / 'png'}: the same at another size"
    (dataset,) = read_datasets(tmp_path / "datasets.tsv")
    assert dataset.images[0].parent == tmp_path / "png4/1"


def test_aloi_half_unpacked_is_left_out_object_by_object(tmp_path):
    unpack_aloi(tmp_path, [1, 2, 3, 4, 5, 6])
    (tmp_path / "png2/2/2_r10.png").unlink()
    (tmp_path / "png2/2/2_r355.png").unlink()
    (tmp_path / "png2/3/3_r10.png").unlink()
    (tmp_path / "png2/3/3_r355.png").unlink()
    whole = (tmp_path / "png2/4/4_r90.png").read_bytes()
    (tmp_path / "png2/4/4_r90.png").write_bytes(whole[:-5])
    draw(tmp_path / "mask2/5", [f"5_r{angle}.png" for angle in ANGLES], (6, 4), "1")
    shutil.rmtree(tmp_path / "mask2/6")
    said = said_of(tmp_path, "aloi", "1-1000")
    assert said[:6] == [
        "left out: 2-3: lacks 2 of 72 photographs: _r10.png, _r355.png",
        "left out: 4: 1 of 72 photographs are cut short: _r90.png",
        "left out: 5: masks are 6x4, photographs 12x9; should be of one size, those of "
        "aloi_mask2.tar",
        "left out: 6: has no masks",
        "left out: 7-1000: has no photographs",
        "1 row: silhouettes mask, cameras calibrate",
    ]
    assert [d.object for d in read_datasets(tmp_path / "datasets.tsv")] == ["aloi_1"]
    with pytest.raises(InputError, match="no object is there whole\nleft out: 2: lacks 2 of 72"):
        said_of(tmp_path, "aloi", "2")


@pytest.mark.parametrize("views", [ANGLES, range(72)])
@pytest.mark.parametrize("place", ["", "obj{}"])
def test_coil_in_one_folder_or_in_one_each(tmp_path, views, place):
    for number in (1, 2, 12):
        names = [f"obj{number}__{view}.png" for view in views]
        draw(tmp_path / place.format(number), names, (8, 8))
    (tmp_path / place.format(2) / f"obj2__{views[3]}.png").unlink()
    said = said_of(tmp_path, "coil")
    assert said[:2] == [
        f"left out: 2: lacks 1 of 72 photographs: {views[3]}.png",
        "2 rows: silhouettes threshold, cameras calibrate",
    ]
    one, twelve = read_datasets(tmp_path / "datasets.tsv")
    assert (one.object, twelve.object) == ("coil_1", "coil_12")
    assert [path.name for path in one.images] == [f"obj1__{view}.png" for view in views]
    assert "size: 128" in (tmp_path / "config.yaml").read_text(encoding="utf-8")


def test_coil_is_recognised(tmp_path):
    draw(tmp_path, ["obj1__0.png"])
    assert "`silmesh init --coil" in refusal_of(tmp_path)


def test_aloi_is_recognised(tmp_path):
    unpack_aloi(tmp_path / "aloi_red2_view", [1])
    assert "`silmesh init --aloi" in refusal_of(tmp_path)


def test_shapenet_is_recognised(tmp_path):
    write_class(tmp_path, "02691156", (1.0,))
    assert "`silmesh init --shapenet" in refusal_of(tmp_path)


def test_shapenet_is_a_row_a_class(tmp_path):
    write_class(tmp_path, "02691156", (1.0, 0.9, 0.8))
    write_class(tmp_path, "03001627", (1.0,))
    (tmp_path / "03001627_test_voxels.npz").unlink()
    assert said_of(tmp_path, "shapenet")[:4] == [
        "02691156_test: 3 objects",
        "03001627_test: 1 object",
        "03001627_test: no truth: 03001627_test_voxels.npz is not there",
        "2 rows: silhouettes alpha, cameras turntable",
    ]
    found = read_datasets(tmp_path / "datasets.tsv")
    assert [d.object for d in found] == [*(f"02691156_test_{i}" for i in range(3)), "03001627_test"]
    assert str(found[2].images[0]) == f"{tmp_path}/02691156_test_images.npz#2"
    assert str(found[2].truth) == f"{tmp_path}/02691156_test_voxels.npz#2"
    assert found[3].truth is None
    assert found[0].turntable.text == "2.732,30.0,-15.0"
    with pytest.raises(InputError, match=r"--objects: .*'0-5': 0-5 should rise within 0 to 2"):
        said_of(tmp_path, "shapenet", "0-5")


@pytest.mark.parametrize(
    ("layout", "said"),
    [
        ("aloi", "has no folder png, png2 or png4"),
        ("coil", "has no photograph named obj1__0.png"),
        ("shapenet", "has no file named <class>_<split>_images.npz"),
    ],
)
def test_a_folder_of_another_kind_is_refused(tmp_path, layout, said):
    (tmp_path / "photos").mkdir()
    np.save(tmp_path / "photos/a.npy", np.zeros(3))
    with pytest.raises(InputError, match=said):
        said_of(tmp_path, layout)
    assert not (tmp_path / "datasets.tsv").exists()


def test_numbers_need_a_layout(tmp_path):
    with pytest.raises(InputError, match="needs one of --aloi, --coil, --shapenet"):
        said_of(tmp_path, None, "1-3")


@pytest.mark.data
def test_a_real_object_of_aloi(tmp_path, data):
    (tmp_path / "aloi").symlink_to(data / "aloi_moisturiser")
    assert said_of(tmp_path, "aloi")[0] == "1 row: silhouettes mask, cameras calibrate"
    (dataset,) = read_datasets(tmp_path / "datasets.tsv")
    assert (dataset.object, len(dataset.images), len(dataset.masks)) == ("moisturiser", 72, 72)
