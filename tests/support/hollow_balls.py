"""A ball with a hollow that no outline shows, its photographs, silhouettes and hull."""

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from skimage.measure import marching_cubes

from silmesh.geometry.camera import Cameras, concatenate
from silmesh.geometry.originals import Originals
from silmesh.geometry.visual_hull import carve
from silmesh.relief.surface import simplify
from silmesh.synthetic.orbit import photograph_cameras
from silmesh.synthetic.paints import coat, rgb, speckle
from silmesh.synthetic.photograph import Paint, photograph
from silmesh.views import View

SIZE, WORKING = 192, 96
RADIUS, HOLLOW, CENTRE = 0.42, 0.26, np.array([0, 0.3, 0.1])
FLOOR = CENTRE - [0, HOLLOW, 0]  # the hollow's lowest point


def patterned(points: np.ndarray) -> np.ndarray:
    value = 0.5 + 0.2 * speckle(points, 0.06, 3) + 0.25 * speckle(points, 0.03, 4)
    return np.column_stack([value, 0.9 * value, 0.8 * value, 0.1 + 0 * value]).astype(np.float32)


def plain(points: np.ndarray) -> np.ndarray:
    return coat(points, rgb("b0a090"), 0.05)


def glossy(points: np.ndarray) -> np.ndarray:
    return coat(points, rgb("803030"), 1.0)


def hollow_ball() -> trimesh.Trimesh:
    """A ball out of whose top a smaller one is cut."""
    grid = np.linspace(-0.5, 0.5, 81)
    points = np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1)
    ball = np.linalg.norm(points, axis=-1) - RADIUS
    cut = HOLLOW - np.linalg.norm(points - CENTRE, axis=-1)
    spacing = (grid[1] - grid[0],) * 3
    verts, faces, _, _ = marching_cubes(
        np.maximum(ball, cut), 0, spacing=spacing, gradient_direction="ascent"
    )
    mesh = trimesh.Trimesh(verts - 0.5, faces, process=False)
    mesh.fix_normals()
    return mesh


def stand_about(size: int) -> Cameras:
    """Two rings of 16 cameras, of which one looks into the hollow."""
    rings = [
        photograph_cameras([f"{up}-{i:02d}" for i in range(16)], (size, size), elevation=up)
        for up in (10, 55)
    ]
    return concatenate(*rings)


class HollowBall:
    """A hollow ball's photographs, its silhouettes and its hull."""

    def __init__(self, folder: Path, paint: Paint):
        self.truth, cameras = hollow_ball(), stand_about(SIZE)
        self.cameras, self.views, masks = stand_about(WORKING), [], []
        shots = photograph(self.truth, cameras, paint, seed=7)
        for name, (image, mask) in zip(cameras.views, shots, strict=True):
            path = folder / f"{name}.png"
            Image.fromarray(image).save(path)
            frame = (WORKING, 0, 0, WORKING, WORKING)
            self.views.append(View(name, str(path), SIZE, SIZE, *frame))
            masks.append(mask.reshape(WORKING, 2, WORKING, 2).mean(axis=(1, 3)) >= 0.5)
        self.silhouettes = np.stack(masks)
        self.originals = Originals(self.cameras, self.views)
        hull = trimesh.Trimesh(*carve(self.silhouettes, self.cameras, 64).surface(), process=False)
        self.hull = simplify(hull, 3000)
