import math

import pytest
import torch
from scenes import names, turntable
from scipy.spatial.transform import Rotation

from silmesh.cameras.turntable import orbit_cameras
from silmesh.cameras.upright import azimuths, find_up, turn_upright

TURN = torch.as_tensor(Rotation.from_euler("xyz", [70, -40, 130], degrees=True).as_matrix())


def turned(cameras, roll: float = 0.0):
    """R and centres of cameras in a world that is turned by TURN, each rolled about its axis."""
    a = math.radians(roll)
    lean = torch.tensor([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
    return lean.double() @ cameras.R @ TURN.T, cameras.centres @ TURN.T


def orbit(elevation, azimuth):
    azimuth = torch.as_tensor(azimuth, dtype=torch.float64)
    elevation = torch.as_tensor(elevation, dtype=torch.float64).expand_as(azimuth)
    return orbit_cameras(names(len(azimuth)), 64, torch.full_like(azimuth, 2.7), elevation, azimuth)


@pytest.mark.parametrize("elevation", [-20, 0, 30])
@pytest.mark.parametrize("roll", [0, 12])
def test_a_ring_gives_its_normal_whatever_the_roll(elevation, roll):
    up = find_up(*turned(turntable(12, 64, elevation), roll))
    assert up.found_by == "ring"
    torch.testing.assert_close(up.direction, TURN[:, 1])


def test_an_arc_on_the_wrong_side_of_the_plane_keeps_its_sign():
    up = find_up(*turned(orbit(25.0, torch.arange(0, 120, 10))))
    assert up.found_by == "ring"
    torch.testing.assert_close(up.direction, TURN[:, 1])


def test_a_stray_centre_does_not_tilt_the_ring():
    R, centres = turned(turntable(24, 64, 20))
    centres[5] += 0.8 * TURN[:, 1]
    up = find_up(R, centres)
    assert up.found_by == "ring"
    torch.testing.assert_close(up.direction, TURN[:, 1])


def test_cameras_at_several_heights_are_levelled_by_their_horizons():
    elevation = torch.tensor([10.0, 50, 70, 30]).repeat(5).double()
    up = find_up(*turned(orbit(elevation, torch.arange(0, 200, 10))))
    assert up.found_by == "horizons"
    torch.testing.assert_close(up.direction, TURN[:, 1])


def test_a_walk_over_the_top_has_no_ring_in_its_own_plane():
    up = find_up(*turned(orbit(torch.arange(10, 70, 10.0), torch.zeros(6))))
    assert up.found_by == "ups"
    assert up.direction @ TURN[:, 1] > math.cos(math.radians(45))


def test_the_first_camera_stands_over_z_and_the_world_is_not_mirrored():
    R, centres = turned(orbit(20.0, 40 + 30 * torch.arange(12)))
    Q = turn_upright(R, find_up(R, centres).direction)
    torch.testing.assert_close(Q @ Q.T, torch.eye(3).double())
    assert Q.det() == pytest.approx(1)
    moved = centres @ Q.T
    torch.testing.assert_close(moved[0, 0], torch.tensor(0.0).double())
    assert moved[0, 2] > 0
    upright = R @ Q.T
    assert (-upright[:, 1, 1]).min() > 0.9  # every image's up has a positive y
    off = azimuths(upright) - 30 * torch.arange(12)
    off = (off + 180).remainder(360) - 180  # -0 and 360 are the same direction
    torch.testing.assert_close(off, torch.zeros(12).double())


def test_a_first_camera_that_looks_straight_down_takes_what_is_below_in_its_image_as_near():
    R, _ = turned(orbit(90.0, [0.0, 90, 180]))
    Q = turn_upright(R, TURN[:, 1])
    torch.testing.assert_close(Q, TURN.T, atol=1e-6, rtol=0)
