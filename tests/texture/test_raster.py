"""Triangles whose pixels, depths and weights are known by hand."""

import numpy as np
import pytest

from silmesh.texture.raster import draw, weigh_corners

#     0   1   2   3   4
#   0 a---+---+---+---b      the square's lower left half is a triangle, a c d,
#   1 | \             |      its upper right half a d b
#   2 |     \         |
#   4 c-------------- d
SQUARE = np.array([[0, 0], [4, 0], [0, 4], [4, 4.0]])
HALVES = np.array([[0, 2, 3], [0, 3, 1]])


def test_each_pixel_shows_the_triangle_that_its_centre_lies_in():
    shown, depth = draw(SQUARE, np.full(4, 2.0), HALVES, (5, 4))
    expected = [
        [0, 1, 1, 1, -1],
        [0, 0, 1, 1, -1],
        [0, 0, 0, 1, -1],
        [0, 0, 0, 0, -1],
    ]
    off = ~np.eye(4, 5, dtype=bool)  # the diagonal belongs to either
    assert (shown == expected)[off].all()
    assert (shown >= 0).sum() == 16
    assert depth[:, :4] == pytest.approx(2)
    assert np.isinf(depth[:, 4]).all()


def test_the_nearer_triangle_is_shown():
    points, faces = np.concatenate([SQUARE, SQUARE]), np.array([[0, 1, 3], [4, 5, 7]])
    shown, depth = draw(points, np.repeat([3.0, 2.0], 4), faces, (4, 4))
    assert set(shown[shown >= 0]) == {1}
    assert depth[0, 3] == pytest.approx(2)


def test_what_is_not_in_front_is_left_out():
    shown, _ = draw(SQUARE, np.array([1.0, 1, -1, 1]), HALVES, (4, 4))
    assert set(shown.ravel()) == {-1, 1}


def test_weights_are_right_for_the_perspective():
    """Half way between pixels of corners at depths 1 and 3 lies a quarter of the way to the far.

    With 1/z linear in the image the mean of 1 and 1/3 is 2/3, so z = 1.5 = 1 + (3 - 1) / 4.
    """
    points, depths = np.array([[0, 0], [2, 0], [0, 2.0]]), np.array([1.0, 3, 1])
    (weights,) = weigh_corners(points, depths, np.array([[0, 1, 2]]), np.array([[1.0, 0]]))
    assert weights == pytest.approx([0.75, 0.25, 0], abs=1e-6)
