"""A surface is led back to its silhouettes; what no outline shows stays where it is."""

import numpy as np
import pytest
import torch
import trimesh

from silmesh.cameras.turntable import orbit_cameras
from silmesh.fitting.mending import follow_outlines
from silmesh.geometry.camera import Cameras
from silmesh.geometry.mesh_files import to_tensors
from silmesh.geometry.silhouette_iou import silhouette_iou
from silmesh.settings.fit import FastFit
from silmesh.shapes.downsample import render

SIZE, RADIUS = 64, 4.0  # the world is ten times as large as the procedure's


def make_bowl(radius: float) -> trimesh.Trimesh:
    """A ball whose top is pressed in to its middle, its rim where the ball's was."""
    ball = trimesh.creation.icosphere(5, radius)
    up = ball.vertices[:, 1] / radius
    verts = ball.vertices * np.where(up > 0.8, 0.3 + 0.7 * (1 - up.clip(0.8, 1)) / 0.2, 1)[:, None]
    return trimesh.Trimesh(verts, ball.faces, process=False)


@pytest.fixture(scope="module")
def cameras() -> Cameras:
    turn = torch.arange(12, dtype=torch.float64)
    around = torch.full_like(turn, 27.32), torch.full_like(turn, 10.0), 30 * turn
    return orbit_cameras([f"v{i}" for i in range(12)], SIZE, *around)


def fit_to(mesh: trimesh.Trimesh, cameras: Cameras, silhouettes: np.ndarray) -> float:
    sigma = FastFit().sigma_at(SIZE)
    return float(silhouette_iou(*to_tensors(mesh), cameras, silhouettes, sigma).mean())


def test_the_outline_comes_back_and_the_hollow_stays(cameras):
    truth, small = make_bowl(RADIUS), make_bowl(0.98 * RADIUS)
    silhouettes = render(truth, cameras, (SIZE, SIZE))
    best = fit_to(truth, cameras, silhouettes)  # rays and the renderer differ by parts of pixels
    assert fit_to(small, cameras, silhouettes) < best - 0.04
    mended = follow_outlines(small, cameras, silhouettes, FastFit())
    assert fit_to(mended, cameras, silhouettes) > best - 0.01
    assert np.array_equal(mended.faces, small.faces)
    floor = np.linalg.norm(small.vertices, axis=1).argmin()
    moved = np.linalg.norm(mended.vertices[floor] - small.vertices[floor])
    assert moved < 0.05 * RADIUS


def test_the_same_mesh_comes_again(cameras):
    silhouettes = render(make_bowl(RADIUS), cameras, (SIZE, SIZE))
    one, other = (
        follow_outlines(make_bowl(0.98 * RADIUS), cameras, silhouettes, FastFit()) for _ in range(2)
    )
    assert np.array_equal(one.vertices, other.vertices)
