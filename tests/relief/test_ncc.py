"""The kernel of cross-correlation against its plain twin, and depths of a plane that is known."""

import numpy as np
import pytest

from silmesh.relief.depths import WINDOW
from silmesh.relief.ncc import RADIUS, carry, correlate, find_detail, gather


@pytest.fixture
def images() -> np.ndarray:
    rng = np.random.default_rng(4)
    return rng.uniform(20, 220, (2, 24, 26)).astype(np.float32)


def offsets() -> np.ndarray:
    """The pixels of a window, every second as on a chess board: [n, 2] across and down."""
    around = range(-RADIUS, RADIUS + 1)
    return np.array([(i, j) for j in around for i in around if (i + j) % 2 == 0])


def bilinear(image: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    c, r = np.floor(u).astype(int), np.floor(v).astype(int)
    a, b = u - c, v - r
    above = image[r, c] * (1 - a) + image[r, c + 1] * a
    below = image[r + 1, c] * (1 - a) + image[r + 1, c + 1] * a
    return above * (1 - b) + below * b


@pytest.mark.parametrize("half_known", [False, True])
def test_correlation_is_that_of_plain_numpy(images, half_known):
    mask = np.ones(images.shape[1:], bool)
    mask[:, 11:] = not half_known
    values, weights = np.empty(WINDOW, np.float32), np.empty(WINDOW, np.float32)
    total, deviation = gather(images[0], mask, 10, 12, values, weights)
    du, dv = np.array([0.9, 0.2]), np.array([-0.1, 1.1])
    got = correlate(values, weights, total, deviation, images[1], 12.3, 11.6, du, dv)
    i, j = offsets().T
    known = mask[12 + j, 10 + i]
    one = images[0][12 + j, 10 + i][known]
    other = bilinear(images[1], 12.3 + du[0] * i + du[1] * j, 11.6 + dv[0] * i + dv[1] * j)[known]
    assert got == pytest.approx(np.corrcoef(one, other)[0, 1], abs=1e-5)


def test_a_window_correlates_with_itself_brighter(images):
    values, weights = np.empty(WINDOW, np.float32), np.empty(WINDOW, np.float32)
    total, deviation = gather(images[0], np.ones((24, 26), bool), 10, 12, values, weights)
    brighter = 0.5 * images[0] + 60
    own = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    assert correlate(values, weights, total, deviation, brighter, 10, 12, *own) == pytest.approx(1)


def test_nothing_correlates_with_what_is_flat_or_beyond_the_image(images):
    values, weights = np.empty(WINDOW, np.float32), np.empty(WINDOW, np.float32)
    total, deviation = gather(images[0], np.ones((24, 26), bool), 10, 12, values, weights)
    own = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    flat = np.full_like(images[0], 80)
    assert correlate(values, weights, total, deviation, flat, 10, 12, *own) == -1
    assert correlate(values, weights, total, deviation, images[1], 1, 12, *own) == -1


def test_a_slope_has_no_detail_and_a_pattern_its_own(images):
    rows, columns = np.mgrid[:24, :26].astype(np.float32)
    values, weights = np.empty(WINDOW, np.float32), np.empty(WINDOW, np.float32)
    everywhere = np.ones((24, 26), bool)
    total, deviation = gather(3 * columns - 2 * rows, everywhere, 10, 12, values, weights)
    assert deviation > 5
    assert find_detail(values, weights, total) < 0.01
    total, _ = gather(images[0], everywhere, 10, 12, values, weights)
    i, j = offsets().T
    window = images[0][12 + j, 10 + i]
    slopes = np.stack([i, j, np.ones(len(i))], axis=1)
    left = window - slopes @ np.linalg.lstsq(slopes, window, rcond=None)[0]
    assert find_detail(values, weights, total) == pytest.approx(left.std(), rel=1e-3)


def test_a_plane_carries_a_pixel_and_its_neighbours_where_their_points_project():
    """Each neighbour's point is found by cutting its ray with the plane, at full length."""
    K = np.array([[100.0, 3, 50], [0, 110, 40], [0, 0, 1]])
    back, angle = np.linalg.inv(K), 0.3
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    A, b = K @ turn, K @ np.array([-0.6, 0.05, 0.1])
    normal, depth = np.array([0.3, -0.2, -0.93]), 2.0
    du, dv = np.empty(2), np.empty(2)
    u, v = carry(back, A, b, 44, 51, depth, normal, du, dv)
    middle = depth * back @ [44, 51, 1]

    def project(column, row):
        ray = back @ [column, row, 1]
        seen = A @ (ray * (normal @ middle) / (normal @ ray)) + b
        return seen[:2] / seen[2]

    step = 1e-5
    np.testing.assert_allclose([u, v], project(44, 51), atol=1e-9)
    slopes = [(project(44 + step, 51) - [u, v]) / step, (project(44, 51 + step) - [u, v]) / step]
    np.testing.assert_allclose(np.stack([du, dv], axis=1), slopes, atol=1e-4)
