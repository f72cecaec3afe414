import math

import numpy as np
import pytest
import torch
from scenes import names, turntable

from silmesh.cameras.turntable import orbit_cameras, softras_cameras, turntable_cameras
from silmesh.errors import InputError


def softras_pixels(verts, size, distance, elevation, azimuth):
    """SoftRas's own look_at and perspective, for a left-handed world: x right, y up, z in."""
    e, a = math.radians(elevation), math.radians(azimuth)
    up = np.array([0, 1.0, 0])
    eye = distance * np.array([math.cos(e) * math.sin(a), math.sin(e), -math.cos(e) * math.cos(a)])
    z = -eye / np.linalg.norm(eye)
    x = np.cross(up, z) / np.linalg.norm(np.cross(up, z))
    y = np.cross(z, x)
    seen = (verts - eye) @ np.stack([x, y, z]).T
    plane = seen[:, :2] / seen[:, 2:] / math.tan(math.radians(15))
    return (np.stack([plane[:, 0], -plane[:, 1]], axis=1) + 1) * size / 2


@pytest.mark.parametrize("elevation", [0, 30, -50])
@pytest.mark.parametrize("azimuth", [0, 5, 90, 200, -75])
def test_our_picture_is_softras_picture_of_the_mirrored_world(elevation, azimuth):
    verts = np.random.default_rng(0).uniform(-0.5, 0.5, (30, 3))
    angles = torch.tensor([[2.732], [elevation], [azimuth]], dtype=torch.float64)
    ours = orbit_cameras(["a"], 64, *angles).project(torch.tensor(verts))[0]
    theirs = softras_pixels(verts * [1, 1, -1], 64, 2.732, elevation, azimuth)
    np.testing.assert_allclose(ours.numpy(), theirs, atol=1e-10)


def test_the_first_camera_stands_on_z_and_the_next_towards_x():
    cameras = turntable_cameras(names(2), 32, 2.0, 0.0, 90.0)
    expected = torch.tensor([[0.0, 0, 2], [2, 0, 0]], dtype=torch.float64)
    torch.testing.assert_close(cameras.centres, expected)


def test_the_half_angle_of_view_is_15_degrees():
    edge = 2.732 * math.tan(math.radians(15))
    seen = turntable(2, 64).project(torch.tensor([[edge, 0, 0], [0, edge, 0]]))[0]
    torch.testing.assert_close(seen, torch.tensor([[64.0, 32], [32, 0]]))


def test_rotations_are_rotations():
    R = turntable(9, 32, elevation=-33).R
    torch.testing.assert_close(R @ R.mT, torch.eye(3, dtype=R.dtype).expand(9, 3, 3))
    torch.testing.assert_close(torch.linalg.det(R), torch.ones(9, dtype=R.dtype))


def test_a_turntable_is_softras_npy(tmp_path):
    rows = np.stack([np.full(6, 2.732), np.full(6, 20), 60.0 * np.arange(6)], axis=1)
    np.save(tmp_path / "camera.npy", rows.astype(np.float32))
    read, made = softras_cameras(tmp_path / "camera.npy", names(6), 32), turntable(6, 32, 20)
    torch.testing.assert_close(read.R, made.R)
    torch.testing.assert_close(read.t, made.t, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("kind", [">f4", ">i2", "u2", "f2", "longdouble"])
def test_an_npy_of_any_kind_of_number(tmp_path, kind):
    np.save(tmp_path / "camera.npy", np.array([[3, 0, 0], [3, 0, 90]], kind))
    read = softras_cameras(tmp_path / "camera.npy", names(2), 32)
    torch.testing.assert_close(read.centres[1], torch.tensor([3.0, 0, 0], dtype=torch.float64))


@pytest.mark.parametrize("distance", [0.5, 0.1, -2, math.nan])
def test_a_camera_inside_the_object_is_refused(distance):
    with pytest.raises(InputError, match=r"'v0' stands at distance .* inside"):
        turntable_cameras(names(3), 32, distance, 0, 5)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((4, 2)), r"should hold \[views, 3\] numbers.*not \[4, 2\] of float64"),
        (np.zeros(3), r"not \[3\]"),
        (np.array([["a", "b", "c"]]), "should hold"),
        (np.full((4, 3), 2j), "should hold .* not .* of complex128"),
        (np.array([[None] * 3]), "cannot be read"),
        (np.ones((2, 3)), "has 2 cameras, but there are 4 views"),
        (np.full((4, 3), np.nan), "row 0 is not finite"),
        (np.full((4, 3), 0.2), "inside the sphere"),
        (b"nonsense", "cannot be read"),
        (b"", "cannot be read"),
        (b"PK\x03\x04zip", "cannot be read"),
    ],
)
def test_a_wrong_npy_is_named(tmp_path, array, message):
    path = tmp_path / "camera.npy"
    if isinstance(array, bytes):
        path.write_bytes(array)
    else:
        np.save(path, array)
    with pytest.raises(InputError, match=message) as error:
        softras_cameras(path, names(4), 32)
    assert str(path) in str(error.value)
