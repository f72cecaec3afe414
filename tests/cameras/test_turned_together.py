"""What the cameras of two sets have in common is found where it is known."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from turned_over import SCALE, SHIFT, Q, ring, show, turn_over

from silmesh.cameras.turned import Half, Turning
from silmesh.cameras.turned_together import PARAMETERS, Correction, Together, solve_together

TURNING = Turning(Q, SCALE, np.full(3, SHIFT), np.zeros(4))


def tilt(degrees: float) -> np.ndarray:
    """A rotation about the camera's x, by which one that stands higher sees the object."""
    return Rotation.from_euler("x", degrees, degrees=True).as_matrix()


def test_a_turn_about_the_camera_s_x_is_a_ring_s_elevation():
    corrected = Correction(tilt(5.0), np.zeros(3), 1.0).correct(ring("a", 20.0))
    torch.testing.assert_close(corrected.R, ring("a", 25.0).R)
    torch.testing.assert_close(corrected.t, ring("a", 25.0).t)


def test_a_shift_and_a_focal_length_move_the_object_in_the_image():
    cameras = ring("a", 20.0)
    corrected = Correction(np.eye(3), np.array([0.1, 0.0, 0.0]), 2.0).correct(cameras)
    origin = torch.zeros(1, 3, dtype=torch.float64)
    focal, middle = cameras.K[0, 0, 0], cameras.K[0, 0, 2]
    seen = corrected.project(origin)[:, 0]
    torch.testing.assert_close(seen[:, 0], (middle + 0.2 * focal).expand(len(cameras)))
    torch.testing.assert_close(seen[:, 1], middle.expand(len(cameras)))


def test_nothing_is_corrected_by_parameters_of_zero():
    first, second = ring("a", 20.0), ring("b", 35.0)
    together = Together.of(np.zeros(PARAMETERS), TURNING).join(first, second)
    expected = TURNING.join(first, second)
    assert together.views == (*first.views, *second.views)
    for name in ("K", "R", "t"):
        torch.testing.assert_close(getattr(together, name), getattr(expected, name))


def test_elevations_that_each_set_has_wrong_are_found_by_both():
    first, second = ring("a", 20.0), ring("b", 35.0)
    seen = show(first), show(turn_over(second))
    wrong = ring("a", 23.0), ring("b", 33.0)
    found = solve_together([Half.prepare(*both) for both in zip(seen, wrong, strict=True)], TURNING)
    for correction, degrees in zip(found.corrections, (-3.0, 2.0), strict=True):
        left = correction.E @ tilt(degrees).T
        assert np.degrees(Rotation.from_matrix(left).magnitude()) < 1.0
        assert correction.g == pytest.approx(1, abs=0.05)
    assert TURNING.angle_to(found.turning) < 1.0
