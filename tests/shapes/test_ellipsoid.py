from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from scenes import dome, silhouettes, turntable

from silmesh.geometry.frame import is_cut
from silmesh.shapes.ellipsoid import find_ellipsoid

SIZE = 128
PIXEL = 2.732 * np.tan(np.radians(15)) * 2 / SIZE  # a pixel's size at the origin
AXES, CENTRE = (0.2, 0.4, 0.12), (0.08, -0.05, 0.1)


@pytest.mark.parametrize("cameras", [dome(12, SIZE), turntable(8, SIZE, elevation=15)])
def test_an_ellipsoid_is_found_in_all_three_axes(cameras):
    found = find_ellipsoid(silhouettes(cameras, AXES, CENTRE), cameras)
    np.testing.assert_allclose(found.centre, CENTRE, atol=0.2 * PIXEL)
    np.testing.assert_allclose(found.lengths(np.eye(3)), AXES, atol=0.5 * PIXEL)
    np.testing.assert_allclose(found.lengths(found.axes()), sorted(AXES)[::-1], atol=0.5 * PIXEL)
    np.testing.assert_allclose(np.abs(found.axes()[:, 0]), [0, 1, 0], atol=0.05)
    assert np.linalg.det(found.axes()) == pytest.approx(1)


def test_the_third_axis_is_from_the_view_at_a_right_angle():
    """The first view of two alone would leave the depth of an ellipsoid open."""
    cameras = turntable(4, SIZE).select([0, 1])
    found = find_ellipsoid(silhouettes(cameras, AXES, CENTRE), cameras)
    np.testing.assert_allclose(found.lengths(np.eye(3)), AXES, rtol=0.1)


def test_what_no_view_shows_is_as_long_as_the_rest():
    cameras = turntable(4, SIZE).select([0])
    seen = silhouettes(cameras, (0.2, 0.2, 0.05))
    assert 0.1 < find_ellipsoid(seen, cameras).lengths(np.eye(3))[2] < 0.4


def test_one_view_that_disagrees_hardly_moves_it():
    cameras = turntable(12, SIZE, elevation=15)
    seen = silhouettes(cameras, AXES, CENTRE)
    seen[5] = False
    seen[5, 10:25, 10:25] = True
    found = find_ellipsoid(seen, cameras)
    np.testing.assert_allclose(found.centre, CENTRE, atol=2 * PIXEL)
    np.testing.assert_allclose(found.lengths(np.eye(3)), AXES, atol=2 * PIXEL)


def test_views_that_the_frame_cuts_are_left_out():
    cameras = turntable(8, SIZE)
    aside = cameras.K.clone()
    aside[:2, 0, 2] += SIZE / 2 - 10
    shifted = cameras.in_pixels_of(aside @ cameras.K.inverse(), cameras.sizes)
    seen = silhouettes(shifted, AXES, CENTRE)
    assert is_cut(seen).tolist() == [True, True] + 6 * [False]
    found = find_ellipsoid(seen, shifted)
    np.testing.assert_allclose(found.lengths(np.eye(3)), AXES, atol=0.5 * PIXEL)
    assert find_ellipsoid(seen[:2], shifted.select([0, 1])).centre.shape == (3,)


def test_a_turned_ellipsoid_is_found():
    cameras = dome(12, SIZE)
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])[:3, :3]
    # Seen by cameras turned the other way it lies along the axes.
    turned = replace(cameras, R=cameras.R @ torch.tensor(turn))
    seen = silhouettes(turned, AXES)
    found = find_ellipsoid(seen, cameras)
    np.testing.assert_allclose(found.lengths(turn), AXES, atol=0.5 * PIXEL)
