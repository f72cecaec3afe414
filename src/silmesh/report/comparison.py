"""The fits of one object beside one another: the same two views, one scale, one light."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from silmesh.geometry.camera import Cameras
from silmesh.report.pictures import (
    CELL,
    FINE,
    camera_of,
    frame,
    read_on_ground,
    shade,
    to_image,
    trace,
)

Square = tuple[float, float, float]  # left, top and side, as shares of an image's side


@dataclass(frozen=True)
class Fit:
    """A fitted mesh and the views that it is looked at from.

    Attributes:
        mesh: in the cameras' world
        cameras: of the views to show
        photographs: their working images
        silhouettes: [views, size, size] bool, theirs
    """

    mesh: trimesh.Trimesh
    cameras: Cameras
    photographs: Sequence[Path]
    silhouettes: np.ndarray


def draw_comparison(fits: Sequence[Fit]) -> list[list[Image.Image]]:
    """The photographs of the first fit, then each fit's mesh: a list of pictures, one a view.

    A view is cut by one square for all, which holds the silhouettes and what the photographs' frame
    lets see of the meshes; the squares of the views are of one size.
    """
    views = range(len(fits[0].cameras))
    framed = [_frame_all(fits, i) for i in views]
    side = max(side for _, _, side in framed)
    squares = [_widen(square, side) for square in framed]
    photographs = [_cut(fits[0].photographs[i], squares[i]) for i in views]
    return [photographs] + [[_draw(fit, i, squares[i]) for i in views] for fit in fits]


def _frame_all(fits: Sequence[Fit], i: int) -> Square:
    """The square that holds the silhouette and the mesh of each fit."""
    seen = [trace(f.mesh, camera_of(f.cameras, i)).mask | f.silhouettes[i] for f in fits]
    corners = np.array([np.array(frame(mask)) / len(mask) for mask in seen])
    low = corners[:, :2].min(axis=0)
    high = (corners[:, :2] + corners[:, 2:]).max(axis=0)
    side = float((high - low).max())
    return _widen((*((low + high) / 2), 0.0), side)


def _widen(square: Square, side: float) -> Square:
    """The square of that side about the middle of another, within the image."""
    left, top, was = square
    left, top = np.clip(np.array([left, top]) + (was - side) / 2, 0, 1 - side)
    return float(left), float(top), side


def _cut(photograph: Path, square: Square) -> Image.Image:
    image = read_on_ground(photograph)
    left, top, side = (part * image.width for part in square)
    box = (left, top, left + side, top + side)
    return image.resize((CELL, CELL), Image.Resampling.BICUBIC, box=box)


def _draw(fit: Fit, i: int, square: Square) -> Image.Image:
    camera = camera_of(fit.cameras, i)
    near = camera.cropped(*(part * camera.size for part in square), FINE * CELL)
    shaded = shade(fit.mesh, near, trace(fit.mesh, near), smooth=True)
    return to_image(shaded).resize((CELL, CELL), Image.Resampling.BOX)
