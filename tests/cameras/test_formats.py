import numpy as np
import pytest
import torch
from scenes import dome

from silmesh.cameras.camera import write_cameras
from silmesh.cameras.formats import cameras_from_file
from silmesh.errors import InputError
from silmesh.views import place_view

SIZE = 32


def views(width=64, height=48, resize="pad", order=(0, 1, 2)):
    return [place_view(f"v{i}", f"v{i}.png", width, height, SIZE, resize) for i in order]


@pytest.fixture
def file(tmp_path):
    """Cameras v0 to v2 for photographs of 64x48."""
    cameras = dome(3, 64)
    sizes = torch.tensor([[64, 48]] * 3)
    write_cameras(
        tmp_path / "cameras.json", cameras.in_pixels_of(torch.eye(3).expand(3, 3, 3), sizes)
    )
    return tmp_path / "cameras.json"


@pytest.mark.parametrize("resize", ["pad", "stretch"])
def test_cameras_of_photographs_become_those_of_working_images(file, resize):
    verts = torch.tensor([[0.1, 0.2, -0.3]], dtype=torch.float64)
    before = dome(3, 64).project(verts)
    read = cameras_from_file(file, views(resize=resize, order=(2, 0, 1)))
    scale = [0.5, 0.5] if resize == "pad" else [0.5, 2 / 3]
    shift = [0, 4] if resize == "pad" else [0, 0]  # 64x48 becomes 32x24, centred
    expected = before[[2, 0, 1]] * torch.tensor(scale) + torch.tensor(shift)
    torch.testing.assert_close(read.project(verts), expected)
    assert read.views == ("v2", "v0", "v1")
    assert read.sizes.tolist() == [[SIZE, SIZE]] * 3


def test_cameras_of_working_images_stay(file):
    write_cameras(file, dome(3, SIZE))
    torch.testing.assert_close(cameras_from_file(file, views()).K, dome(3, SIZE).K)


def test_softras_npy_is_recognised(tmp_path):
    np.save(tmp_path / "camera.npy", np.array([[2.732, 0, 0], [2.732, 0, 90]]))
    read = cameras_from_file(tmp_path / "camera.npy", views()[:2])
    torch.testing.assert_close(read.centres[1, 0], torch.tensor(2.732, dtype=torch.float64))


def test_another_number_of_views_is_refused(file):
    with pytest.raises(InputError, match="has 3 cameras, but there are 2 views"):
        cameras_from_file(file, views()[:2])


def test_a_view_without_a_camera_is_named(file):
    with pytest.raises(InputError, match="no camera for the view 'v7'"):
        cameras_from_file(file, views(order=(0, 1, 7)))


def test_cameras_of_other_pixels_are_refused(file):
    with pytest.raises(InputError, match="is for 64x48 pixels, but its photograph has 50x40"):
        cameras_from_file(file, views(50, 40))


def test_an_unknown_format_is_refused(tmp_path):
    with pytest.raises(InputError, match="unknown camera format; known are"):
        cameras_from_file(tmp_path / "cameras.xml", views())
