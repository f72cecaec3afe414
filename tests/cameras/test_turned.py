"""How a body was turned over, where that is known."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from turned_over import SCALE, SHIFT, Q, ring, show, turn_over

from silmesh.cameras.turned import Half, Turning, find_turnings, spread_rotations

NONE = np.zeros(4)


def test_a_point_is_seen_where_it_was_before_its_world_was_turned():
    turning = Turning(Q, SCALE, np.full(3, SHIFT), NONE)
    cameras, point = ring("a", 20.0), torch.tensor([[0.1, -0.2, 0.3]], dtype=torch.float64)
    there = SCALE * torch.as_tensor(Q) @ point[0] + SHIFT
    brought = turning.bring(cameras)
    torch.testing.assert_close(brought.project(there[None]), cameras.project(point))
    torch.testing.assert_close(brought.t, turn_over(cameras).t)


def test_a_turn_about_an_axis_is_found_again():
    one = Turning(Q, SCALE, np.full(3, SHIFT), NONE)
    axis, point = np.array([0.0, 0.6, 0.8]), np.array([0.2, 0.0, 0.0])
    other = one.turned_about(axis, point, 70.0)
    assert one.angle_to(other) == pytest.approx(70.0)
    found, through = one.axis_to(other)
    np.testing.assert_allclose(found, axis, atol=1e-9)
    np.testing.assert_allclose(through, point, atol=1e-9)
    # A point of the axis stays: X = s Q Y + c is the same for both.
    on_axis = one.Q.T @ (point + 0.3 * axis - one.c) / one.s
    np.testing.assert_allclose(other.s * other.Q @ on_axis + other.c, point + 0.3 * axis)


def test_one_explains_as_well_what_differs_by_less_than_its_spread():
    squares = np.array([1.0, 2, 1, 2])
    best = Turning(Q, 1.0, np.zeros(3), squares)
    assert best.explains_as_well(Turning(Q, 1.0, np.zeros(3), squares + np.array([1, -1, 1, -1])))
    assert not best.explains_as_well(
        Turning(Q, 1.0, np.zeros(3), squares + np.array([1, 1, 1, 1.5]))
    )


def test_every_rotation_is_near_one_of_those_that_are_tried():
    tried = spread_rotations(20.0)
    some = Rotation.random(200, random_state=0).as_matrix()
    nearest = np.einsum("nij,mij->nm", some, tried).max(axis=1)  # trace of the turn between
    assert np.degrees(np.arccos((nearest - 1) / 2)).max() < 20


@pytest.mark.slow
def test_how_a_body_was_turned_over_is_found():
    first, second = ring("a", 20.0), ring("b", 35.0)
    halves = [
        Half.prepare(show(first), first),
        Half.prepare(show(turn_over(second)), second),
    ]
    best, *others = find_turnings(*halves, apart=20.0)
    off = Turning(Q, SCALE, np.full(3, SHIFT), NONE).angle_to(best)
    assert off < 1.5
    assert best.s == pytest.approx(SCALE, rel=0.02)
    np.testing.assert_allclose(best.c, np.full(3, SHIFT), atol=0.02)
    assert not any(best.explains_as_well(other) for other in others)
