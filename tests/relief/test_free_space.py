"""The field on the grid: the sum that it minimises, and what it leaves of thin things."""

import numpy as np
import pytest
import trimesh
from scipy.optimize import lsq_linear

from silmesh.relief.depths import MARGIN
from silmesh.relief.free_space import (
    BAND,
    ENOUGH,
    KEPT,
    MESH,
    SMOOTH,
    Grid,
    measure,
    settle,
)

SPACING = 0.01


def minimise(bound: np.ndarray, weight: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """The exact minimum of the sum in the module's description, by bounded least squares."""
    own = MESH * np.maximum(0, 1 - weight / ENOUGH)
    rows, wanted = [], []
    number = np.arange(bound.size).reshape(bound.shape)
    for place in np.ndindex(bound.shape):
        for trust, says in ((weight, mean), (own, bound)):
            rows.append({number[place]: np.sqrt(trust[place])})
            wanted.append(np.sqrt(trust[place]) * says[place])
        for axis in range(3):
            if place[axis] + 1 < bound.shape[axis]:
                other = tuple(np.array(place) + np.eye(3, dtype=int)[axis])
                root = np.sqrt(SMOOTH)
                rows.append({number[place]: root, number[other]: -root})
                wanted.append(root * KEPT * (bound[place] - bound[other]))
    matrix = np.zeros((len(rows), bound.size))
    for r, row in enumerate(rows):
        matrix[r, list(row)] = list(row.values())
    most = (bound + MARGIN / (BAND * SPACING)).ravel()
    return lsq_linear(matrix, np.array(wanted), (-np.inf, most)).x.reshape(bound.shape)


def test_the_field_minimises_its_sum():
    rng = np.random.default_rng(0)
    shape = 4, 5, 6
    bound = rng.uniform(-1, 1, shape).astype(np.float32)
    weight = (4 * rng.random(shape) * (rng.random(shape) > 0.4)).astype(np.float32)
    mean = rng.uniform(-1, 1, shape).astype(np.float32)
    found = settle(bound, weight, mean, SPACING)
    assert found.dtype == np.float32
    assert np.abs(found - minimise(bound, weight, mean)).max() < 0.02


def test_a_thin_wing_keeps_its_edges():
    wing = trimesh.creation.box((0.6, 0.4, 0.03)).subdivide_to_size(0.02)
    grid = Grid.over(wing, 60)  # three voxels thick
    bound = measure(wing, grid)
    silent = np.zeros_like(bound)
    field = settle(bound, silent, silent, grid.spacing)
    assert (field > 0).sum() == pytest.approx((bound > 0).sum(), rel=0.1)
