"""What the photographs made of a mesh, side by side from two cameras, as a picture."""

import numpy as np
import trimesh
from PIL import Image
from rendered import Fitted

from silmesh.report.exhibit import STANDING
from silmesh.report.pictures import FINE, camera_of, relight, shade, trace

CELL = 240  # pixels of a side


def draw_sheet(
    fitted: Fitted, mesh: trimesh.Trimesh, standing: np.ndarray, views: tuple[int, ...] = (1, 10)
) -> Image.Image:
    """A row a view: the photograph; fit, refined mesh, what that stands on, and truth."""
    return Image.fromarray(np.vstack([_draw_row(fitted, mesh, standing, v) for v in views]))


def _draw_row(fitted: Fitted, mesh: trimesh.Trimesh, standing: np.ndarray, view: int) -> np.ndarray:
    whole = camera_of(fitted.placed, view)
    camera = whole.cropped(0, 0, whole.size, FINE * CELL)
    photograph = Image.fromarray(fitted.originals.read(view)).resize((CELL, CELL))
    cells = [shade(body, camera, trace(body, camera), False) for body in (fitted.mesh, mesh)]
    hits = trace(mesh, camera)
    tinted = shade(mesh, camera, hits, False)
    tinted[hits.mask] = STANDING[standing][mesh.faces[hits.faces, 0]] / 255
    cells.append(relight(tinted, mesh, camera, hits))
    cells.append(shade(fitted.truth, camera, trace(fitted.truth, camera), True))
    return np.hstack([np.asarray(photograph), *map(shrink, cells)])


def shrink(cell: np.ndarray) -> np.ndarray:
    """What was drawn FINE times as large, [side, side, 3] in [0, 1], as pixels."""
    side = len(cell) // FINE
    small = cell.reshape(side, FINE, side, FINE, 3).mean(axis=(1, 3))
    return (255 * small.clip(0, 1)).round().astype(np.uint8)
