import itertools

import numpy as np

from silmesh.scene.graph_cut import NEIGHBOURS, SMOOTH, cut

WIDTH = 4


def test_no_labelling_is_cheaper():
    """Of all 512 labellings of the free pixels, three rows of three in an image of 5 x 4."""
    rng = np.random.default_rng(3)
    pixels = rng.integers(0, 256, (5, WIDTH, 3)).astype(np.uint8)
    odds, fixed = rng.normal(0, 2, (5, WIDTH)), rng.random((5, WIDTH)) < 0.5
    free = np.zeros((5, WIDTH), bool)
    free[1:4, :3] = True

    def cost(labels):
        total = odds[free & ~labels].sum()
        for (v, u), (down, across) in itertools.product(np.ndindex(5, WIDTH), NEIGHBOURS):
            if (
                v + down < 5
                and 0 <= u + across < WIDTH
                and labels[v, u] != labels[v + down, u + across]
            ):
                apart = pixels[v, u].astype(float) - pixels[v + down, u + across]
                weight = SMOOTH / np.hypot(down, across) * np.exp(-(apart @ apart) / (2 * mean))
                total += weight * (free[v, u] or free[v + down, u + across])
        return total

    mean = mean_square(pixels)
    costs = []
    for choice in itertools.product((False, True), repeat=9):
        labels = fixed.copy()
        labels[free] = choice
        costs.append(cost(labels))
    found = cut(odds, pixels, free, fixed)
    np.testing.assert_array_equal(found[~free], fixed[~free])
    assert cost(found) <= min(costs) + 0.2  # capacities are whole hundredths


def mean_square(pixels):
    """Of the differences of neighbours: the mean of the four directions' means."""
    c = pixels.astype(float)
    parts = [c[:, 1:] - c[:, :-1], c[1:] - c[:-1], c[1:, 1:] - c[:-1, :-1], c[1:, :-1] - c[:-1, 1:]]
    return np.mean([(part**2).sum(axis=-1).mean() for part in parts])


def test_nothing_free_is_what_was_fixed():
    fixed = np.eye(3, dtype=bool)
    nothing = np.zeros((3, 3), bool)
    found = cut(np.zeros((3, 3)), np.zeros((3, 3, 3), np.uint8), nothing, fixed)
    np.testing.assert_array_equal(found, fixed)


def test_a_speck_costs_more_than_it_gains_unless_its_colour_differs():
    odds = np.full((9, 9), -3.0)
    odds[4, 4] = 5  # its eight neighbours cost 4 SMOOTH + 4 SMOOTH / sqrt(2), 13.7
    every = np.ones((9, 9), bool)
    pixels = np.zeros((9, 9, 3), np.uint8)
    assert not cut(odds, pixels, every, ~every).any()
    pixels[4, 4] = 255
    assert np.argwhere(cut(odds, pixels, every, ~every)).tolist() == [[4, 4]]
