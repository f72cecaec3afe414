"""A long ellipsoid of which most photographs show one end: the formula is the truth."""

import numpy as np
import pytest
import torch
from scenes import dome, silhouettes

from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import is_cut
from silmesh.geometry.whereabouts import FEWEST_POINTS, find_body, find_on_object

SIZE, VIEWS = 64, 36
AXES, CENTRE = np.array([0.6, 0.12, 0.15]), np.array([0.05, -0.1, 0.08])
END = CENTRE + np.array([0.4, 0, 0])
ZOOM = 2.2


def walk() -> tuple[Cameras, np.ndarray]:
    """Close-ups from all around: three of four of the one end, the others of the other one."""
    cameras = dome(VIEWS, SIZE)
    aims = np.where(np.arange(VIEWS)[:, None] % 4 > 0, END, 2 * CENTRE - END)
    at = torch.stack([cameras.project(torch.tensor(aims))[i, i] for i in range(VIEWS)])
    maps = torch.eye(3, dtype=torch.float64).repeat(VIEWS, 1, 1)
    maps[:, :2, :2] *= ZOOM
    maps[:, :2, 2] = SIZE / 2 - ZOOM * at
    cameras = cameras.in_pixels_of(maps, cameras.sizes)
    seen = silhouettes(cameras, AXES, CENTRE)
    kept = np.flatnonzero(is_cut(seen))
    return cameras.select(kept), seen[kept]


def points(count: int = 400, wrong: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Points on the ellipsoid, of which some are far off it, and others on a floor beneath it."""
    rng = np.random.default_rng(3)
    sphere = rng.normal(size=(count, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    on = CENTRE + AXES * sphere + rng.normal(0, 0.003, (count, 3))
    off = rng.random(count) < wrong
    on[off] += rng.normal(0, 0.7, (off.sum(), 3))
    floor = rng.uniform(-2, 2, (count, 3))
    floor[:, 1] = CENTRE[1] - AXES[1] - 0.02
    return on, floor


def test_points_place_what_most_photographs_show_one_end_of():
    cameras, seen = walk()
    assert len(seen) >= 30
    carved = find_body(cameras, seen, None)
    placed = find_body(cameras, seen, None, np.concatenate(points()))
    assert abs(carved.centre[0] - CENTRE[0]) > 0.15  # it is drawn to the end that most show
    assert np.linalg.norm(placed.centre.numpy() - CENTRE) < 0.06
    assert 0.75 < placed.scale * AXES.max() / 0.5 < 1
    assert carved.scale > 1.3 * placed.scale


def test_what_lies_beside_the_object_is_not_on_it():
    cameras, seen = walk()
    on, floor = points()
    found = find_on_object(np.concatenate([on, floor]), cameras, seen, None)
    assert 0.8 * len(on) < len(found) < 1.05 * len(on)
    distance = np.linalg.norm((found - CENTRE) / AXES, axis=1)
    assert np.percentile(distance, 95) < 1.15


def test_few_points_tell_nothing():
    cameras, seen = walk()
    on, _ = points(FEWEST_POINTS - 1, wrong=0)
    assert len(find_on_object(on, cameras, seen, None)) == 0
    alone, told = find_body(cameras, seen, None), find_body(cameras, seen, None, on)
    assert told.scale == pytest.approx(alone.scale)
