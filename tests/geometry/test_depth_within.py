"""Depths within silhouettes against a distance transform of the whole image."""

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from silmesh.geometry.depth_within import TILE, depth_within

REACH = 7


def measure_all(silhouette):
    """Of every pixel, the image going on beyond its border as it ends."""
    padded = np.pad(silhouette, REACH, mode="edge")
    return np.minimum(distance_transform_edt(padded)[REACH:-REACH, REACH:-REACH], REACH)


def test_depths_are_those_of_the_whole_image():
    noise = np.random.default_rng(0).standard_normal((2 * TILE + 37, 3 * TILE - 11))
    silhouette = gaussian_filter(noise, 12) > 0
    np.testing.assert_allclose(depth_within(silhouette, REACH), measure_all(silhouette), rtol=1e-6)


def test_a_hole_in_the_next_tile_counts():
    silhouette = np.ones((2 * TILE, 2 * TILE), bool)
    silhouette[TILE + 1, TILE + 2] = False
    found = depth_within(silhouette, REACH)
    assert found[TILE - 1, TILE - 1] == np.float32(np.hypot(2, 3))
    assert found[0, 0] == REACH


def test_the_border_of_the_image_is_no_outline():
    assert (depth_within(np.ones((40, 30), bool), REACH) == REACH).all()
    assert (depth_within(np.zeros((40, 30), bool), REACH) == 0).all()
