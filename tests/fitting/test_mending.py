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


def see(size: int) -> Cameras:
    turn = torch.arange(12, dtype=torch.float64)
    around = torch.full_like(turn, 27.32), torch.full_like(turn, 10.0), 30 * turn
    return orbit_cameras([f"v{i}" for i in range(12)], size, *around)


def fit_to(mesh: trimesh.Trimesh, cameras: Cameras, silhouettes: np.ndarray) -> float:
    sigma = FastFit().sigma_at(silhouettes.shape[-1])
    return float(silhouette_iou(*to_tensors(mesh), cameras, silhouettes, sigma).mean())


@pytest.mark.parametrize(
    ("size", "share", "lost", "left"),
    [
        (64, 0.98, 0.04, 0.01),
        pytest.param(512, 0.995, 0.009, -0.004, marks=pytest.mark.slow),
    ],
)
def test_the_outline_comes_back_and_the_hollow_stays(size, share, lost, left):
    """Also in images that are larger than those that a fit looks at as a whole."""
    cameras, truth, small = see(size), make_bowl(RADIUS), make_bowl(share * RADIUS)
    silhouettes = render(truth, cameras, (size, size))
    best = fit_to(truth, cameras, silhouettes)  # rays and the renderer differ: it can be beaten
    assert fit_to(small, cameras, silhouettes) < best - lost
    mended = follow_outlines(small, cameras, silhouettes, FastFit())
    assert fit_to(mended, cameras, silhouettes) > best - left
    assert np.array_equal(mended.faces, small.faces)
    floor = np.linalg.norm(small.vertices, axis=1).argmin()
    moved = np.linalg.norm(mended.vertices[floor] - small.vertices[floor])
    assert moved < 0.05 * RADIUS


def test_the_same_mesh_comes_again(monkeypatch):
    monkeypatch.setattr("silmesh.fitting.mending.STEPS", 8)
    cameras = see(SIZE)
    silhouettes = render(make_bowl(RADIUS), cameras, (SIZE, SIZE))
    one, other = (
        follow_outlines(make_bowl(0.98 * RADIUS), cameras, silhouettes, FastFit()) for _ in range(2)
    )
    assert np.array_equal(one.vertices, other.vertices)
