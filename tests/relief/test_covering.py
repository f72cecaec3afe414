"""What silhouettes miss of a field: made-up blocks that a camera sees through, or does not."""

import numpy as np
import pytest
import torch
import trimesh

from silmesh.cameras.turntable import orbit_cameras
from silmesh.geometry.camera import Cameras
from silmesh.relief.covering import count_seers, cover
from silmesh.relief.free_space import Grid, measure
from silmesh.shapes.downsample import render

SIZE, DISTANCE, RADIUS = 64, 2.5, 0.1


@pytest.fixture(scope="module")
def camera() -> Cameras:
    level = torch.zeros(1, dtype=torch.float64)
    return orbit_cameras(["front"], SIZE, level + DISTANCE, level, level)


@pytest.fixture(scope="module")
def block(camera) -> tuple[Grid, np.ndarray, np.ndarray]:
    """A grid about a block, the block on it, and what the camera sees of it."""
    box = trimesh.creation.box((0.8, 0.8, 0.8)).subdivide_to_size(0.05)
    grid = Grid.over(box, 60)
    return grid, measure(box, grid), render(box, camera, (SIZE, SIZE))


def bore(camera: Cameras, grid: Grid, field: np.ndarray) -> np.ndarray:
    """The same field with a round hole along the way the camera looks."""
    points = grid.points(np.argwhere(np.ones(grid.shape, bool)))
    eye = camera.centres[0].numpy()
    off = np.linalg.norm(np.cross(points, eye), axis=1) / np.linalg.norm(eye)
    return np.where(off.reshape(grid.shape) < RADIUS, np.float32(-0.5), field)


def test_a_whole_block_misses_nothing(camera, block):
    grid, field, shown = block
    missing, filled = cover(field, field, grid, shown, camera)
    assert not missing.any()
    assert filled.sum() == pytest.approx(shown.sum(), rel=0.07)  # but along its outline
    assert not (filled & ~shown).any()


def test_what_is_seen_through_is_missing(camera, block):
    grid, field, shown = block
    missing, filled = cover(bore(camera, grid, field), field, grid, shown, camera)
    r, c = np.indices((SIZE, SIZE)) + 0.5 - SIZE / 2
    out = np.hypot(r, c) / float(camera.K[0, 0, 0])  # of a depth of 1
    near, far = DISTANCE - 0.4, DISTANCE + 0.4  # sides of the block
    assert not filled[0][out < 0.95 * RADIUS / far].any()
    assert filled[0][(out > 1.05 * RADIUS / near) & (out < 0.3 / far)].all()
    points = grid.points(np.argwhere(missing))
    assert len(points)
    assert (np.linalg.norm(points[:, :2], axis=1) < RADIUS + grid.spacing).all()


def test_rays_see_what_they_come_squarely_on(camera, block):
    """The front of the block, and no sample of its top or sides, along which rays pass."""
    grid, field, shown = block
    seen = np.argwhere(count_seers(field, grid, shown, camera))
    towards = camera.centres[0].numpy() / DISTANCE
    ahead = grid.points(seen) @ towards
    assert len(seen) > 1_000
    assert np.all(np.abs(ahead - 0.4) < 3 * grid.spacing)
    assert count_seers(field, grid, shown, camera).max() == 1


def test_rays_do_not_see_what_they_graze(block):
    """From beside the block, half a degree above its top: the near side alone."""
    grid, field, _ = block
    flat = torch.zeros(1, dtype=torch.float64)
    beside = orbit_cameras(["beside"], SIZE, flat + DISTANCE, flat + 9.7, flat)  # the top is at 0.4
    seen = np.argwhere(count_seers(field, grid, np.ones((1, SIZE, SIZE), bool), beside))
    eye = beside.centres[0].numpy()
    level = np.array([eye[0], 0, eye[2]]) / np.hypot(eye[0], eye[2])
    assert len(seen) > 500
    assert np.all(np.abs(grid.points(seen) @ level - 0.4) < 4 * grid.spacing)
