"""Whose camera is whose: names, order, sizes; and which format a file or a folder has."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from scenes import dome
from shots import NAMES, SIZE, cameras, views

from silmesh.cameras.formats import attempt_from_file
from silmesh.cameras.formats.assignment import is_scaled
from silmesh.cameras.locate import locate
from silmesh.errors import InputError
from silmesh.geometry.camera import write_cameras

GIVEN = cameras()


def write(tmp_path, names=NAMES, **change):
    """Our own file, its cameras under other names."""
    path = tmp_path / "cameras.json"
    write_cameras(path, GIVEN.select(range(len(names))).named(names))
    rows = [row | change for row in json.loads(path.read_text())]
    path.write_text(json.dumps(rows))
    return path


@pytest.mark.parametrize("resize", ["pad", "stretch"])
def test_cameras_of_photographs_become_those_of_working_images(tmp_path, resize):
    file = write(tmp_path)
    order = [2, 0, 3, 1]
    placed = views(tuple(NAMES[i] for i in order), resize=resize)
    found = attempt_from_file(file, placed).cameras
    verts = torch.tensor([[1.0, 2, -3]], dtype=torch.float64)
    scale, shift = ([0.1, 0.1], [0, 8]) if resize == "pad" else ([0.1, 64 / 480], [0, 0])
    expected = GIVEN.project(verts)[order] * torch.tensor(scale) + torch.tensor(shift)
    torch.testing.assert_close(found.project(verts), expected)
    assert found.views == tuple(NAMES[i] for i in order)
    assert found.sizes.tolist() == [[SIZE, SIZE]] * 4


def test_cameras_of_working_images_stay(tmp_path):
    write_cameras(tmp_path / "cameras.json", dome(4, SIZE).named(NAMES))
    attempt = attempt_from_file(tmp_path / "cameras.json", views())
    torch.testing.assert_close(attempt.cameras.K, dome(4, SIZE).K)
    assert attempt.warnings == ()


def test_a_lens_under_another_name_is_not_left_out(tmp_path):
    file = write(tmp_path, distortion=[0.1, 0, 0, 0])
    with pytest.raises(InputError, match=r"camera 0 \(shot_1\): distortion = .* is not read"):
        attempt_from_file(file, views())
    assert len(attempt_from_file(write(tmp_path, distortion=[0, 0]), views()).cameras) == 4


@pytest.mark.parametrize("name", ["x" * 300, "x\0y", "no/where"])
def test_a_path_that_cannot_be(tmp_path, name):
    with pytest.raises(InputError):
        locate(tmp_path / name)


def test_softras_npy_is_by_order(tmp_path):
    np.save(tmp_path / "camera.npy", np.array([[2.732, 0, 0], [2.732, 0, 90]]))
    found = attempt_from_file(tmp_path, views()[:2]).cameras
    torch.testing.assert_close(found.centres[1, 0], torch.tensor(2.732, dtype=torch.float64))
    assert found.views == NAMES[:2]
    with pytest.raises(InputError, match="has 2 cameras, but there are 4 views"):
        attempt_from_file(tmp_path, views())


@pytest.mark.parametrize("form", ["{}", "{}.JPG", "a/b/{}.png", "D:\\x\\{}.tif", "./{}"])
def test_names_have_any_folder_and_ending(tmp_path, form):
    file = write(tmp_path, [form.format(name) for name in NAMES])
    assert attempt_from_file(file, views()).cameras.views == NAMES


def test_a_photograph_whose_name_has_a_dot(tmp_path):
    names = tuple(f"shot.{i}" for i in range(4))
    file = write(tmp_path, names)
    assert attempt_from_file(file, views(names)).cameras.views == names


def test_cameras_of_more_photographs_are_let_be(tmp_path):
    attempt = attempt_from_file(write(tmp_path), views()[1:])
    assert attempt.cameras.views == NAMES[1:]
    assert attempt.dropped == {}


def test_half_of_the_views_and_three_are_enough(tmp_path):
    file = write(tmp_path, NAMES[:3])
    six = (*NAMES[:3], "x", "y", "z")
    attempt = attempt_from_file(file, views(six))
    assert attempt.cameras.views == NAMES[:3]
    assert set(attempt.dropped) == {"x", "y", "z"}
    with pytest.raises(InputError, match=r"its 3 cameras .* fit 3 of the 7 views"):
        attempt_from_file(file, views((*six, "w")))
    with pytest.raises(InputError, match="fit 2 of the 3 views"):
        attempt_from_file(write(tmp_path, NAMES[:2]), views()[:3])


def test_a_file_for_other_pictures(tmp_path):
    file = write(tmp_path, ["a.png", "b.png", "c.png", "d.png"])
    with pytest.raises(InputError) as error:
        attempt_from_file(file, views())
    assert str(error.value) == (
        f"{file}: its 4 cameras ('a.png', 'b.png', 'c.png' and 1 more) fit 0 of the 4 views "
        "('shot_1', 'shot_2', 'shot_10' and 1 more) by name; at least 3, and 50% of the views, "
        "should have one. A camera's name should be that of its photograph, whatever its folder "
        "and ending; perhaps the file is for other pictures"
    )


def test_two_cameras_for_one_photograph(tmp_path):
    file = write(tmp_path, ["l/shot_1.png", "r/shot_1.png", "shot_2", "shot_10"])
    with pytest.raises(InputError, match=r"2 cameras for the view 'shot_1': 'l/shot_1.png', 'r/sh"):
        attempt_from_file(file, views()[:3])


@pytest.mark.parametrize("linked", [False, True])
def test_folders_tell_equal_names_apart(tmp_path, linked):
    """However the views are called; links to the photographs lead to their folders."""
    names = ["x/ring1/a.png", "C:\\x\\ring2\\a.png", "x/ring1/b.png", "x/ring2/b.png"]
    file = write(tmp_path, names)
    places = [tmp_path / "x" / ring / f"{name}.jpg" for name in "ab" for ring in ("ring1", "ring2")]
    placed = views(("ring1_a", "ring2_a", "ring1_b", "ring2_b"))
    for i, place in enumerate(places):
        place.parent.mkdir(parents=True, exist_ok=True)
        place.touch()
        if linked:
            (tmp_path / f"{i}.jpg").symlink_to(place)
    sources = [tmp_path / f"{i}.jpg" for i in range(4)] if linked else places
    placed = [replace(v, source=str(s)) for v, s in zip(placed, sources, strict=True)]
    found = attempt_from_file(file, placed).cameras
    torch.testing.assert_close(found.R, GIVEN.R)
    assert found.views == ("ring1_a", "ring2_a", "ring1_b", "ring2_b")


@pytest.mark.parametrize(
    ("size", "photograph", "scaled"),
    [
        ((5184, 3456), (1000, 667), True),
        ((5184, 3456), (1000, 666), True),
        ((4032, 3024), (1001, 750), True),  # by 0.2482: 1000.8 and 750.6
        ((640, 480), (640, 480), True),
        ((640, 480), (640, 478), False),
        ((5184, 3456), (1000, 664), False),
        ((640, 480), (480, 640), False),
        ((640, 0), (640, 480), False),
    ],
)
def test_the_same_aspect_up_to_rounding_of_both_sides(size, photograph, scaled):
    assert is_scaled(size, photograph) == scaled
    assert is_scaled(photograph, size) == scaled


@pytest.mark.parametrize(
    ("size", "photograph"), [((1280, 960), (640, 480)), ((640, 480), (321, 241))]
)
def test_a_camera_is_scaled_with_its_photograph(tmp_path, size, photograph):
    """321x241 is 640x480 halved, up to rounding."""
    file = write(tmp_path, width=size[0], height=size[1])
    placed = views(NAMES, *photograph)
    attempt = attempt_from_file(file, placed)
    expected = np.array([photograph[0] / size[0], photograph[1] / size[1]]) * [700, 690]
    scale = placed[0].pixel_map[[0, 1], [0, 1]]
    np.testing.assert_allclose(attempt.cameras.K[0, [0, 1], [0, 1]], expected * scale)
    assert f"are scaled to the photographs' {photograph[0]}x{photograph[1]}" in attempt.warnings[0]


def test_another_aspect_is_refused(tmp_path):
    with pytest.raises(InputError, match="is for 640x480 pixels, but its photograph has 640x640"):
        attempt_from_file(write(tmp_path), views(NAMES, 640, 640))
    with pytest.raises(InputError, match="turned as their EXIF orientation says"):
        attempt_from_file(write(tmp_path), views(NAMES, 480, 640))


def test_matrices_of_larger_photographs_are_doubted(tmp_path):
    """The silhouettes decide: the photographs may also be parts of larger ones."""
    for name, matrix in zip(NAMES, GIVEN.projections.numpy(), strict=True):
        np.savetxt(tmp_path / f"{name}.txt", matrix)
    doubt = attempt_from_file(tmp_path, views(NAMES, 320, 240)).doubt
    assert "pass their photographs by, at (331, 228) where 'shot_" in doubt
    assert attempt_from_file(tmp_path, views()).doubt is None


@pytest.mark.parametrize("name", ["cameras.tex", "images.jpg"])
def test_an_unknown_format_is_refused(tmp_path, name):
    (tmp_path / name).touch()
    with pytest.raises(InputError, match="unknown camera format; known are a COLMAP model"):
        attempt_from_file(tmp_path / name, views())
    with pytest.raises(InputError, match=r"holds no cameras; known are a COLMAP model"):
        attempt_from_file(tmp_path, views())
    with pytest.raises(InputError, match="no: is not there"):
        attempt_from_file(tmp_path / "no", views())


def test_a_folder_stands_for_what_is_read_of_it(tmp_path):
    for name in ("sparse/0/cameras.txt", "sparse/0/images.txt", "sparse/0/points3D.txt", "a.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    model = tmp_path / "sparse/0"
    found = locate(tmp_path)
    assert (found.kind, found.path) == ("colmap", model)
    assert found.files == (model / "cameras.txt", model / "images.txt")
    for stem in ("cameras", "images"):
        (model / f"{stem}.bin").touch()
    assert [file.suffix for file in locate(model).files] == [".bin", ".bin"]
    (tmp_path / "transforms.json").touch()
    assert locate(tmp_path).kind == "colmap"
