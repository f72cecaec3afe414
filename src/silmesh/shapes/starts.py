"""How well an initial mesh fits the silhouettes, before a fit starts from it."""

from dataclasses import dataclass

import numpy as np
import trimesh

from silmesh.geometry.camera import INITIAL_SCALE, Cameras
from silmesh.geometry.frame import known_pixels
from silmesh.geometry.overlap import mean_iou
from silmesh.geometry.robust_hull import RobustHull
from silmesh.geometry.thresholds import COHERENT
from silmesh.shapes.downsample import render

SPLINTER = 0.05  # share of a body's volume: if its largest piece lacks more, others are tried


@dataclass(frozen=True)
class Start:
    """What a fit would start from.

    Attributes:
        iou: with what is believed of the silhouettes, averaged over the views
        kept: share of the body's volume that is in the mesh; 1 for a mesh that is not carved
    """

    iou: float
    kept: float

    @property
    def splinter(self) -> bool:
        """Whether much of the body lies in pieces that are not in the mesh."""
        return self.kept < 1 - SPLINTER

    @property
    def poor(self) -> bool:
        """Whether another start should be looked at before this one is taken."""
        return self.iou < COHERENT or self.splinter


def measure_start(
    mesh: trimesh.Trimesh,
    lost: float,
    silhouettes: np.ndarray,
    cameras: Cameras,
    robust: RobustHull | None = None,
    frames: np.ndarray | None = None,
) -> Start:
    """Measure an initial mesh by the views and pixels that are believed.

    Args:
        mesh: at unit size
        lost: share of the body's volume in pieces that are not in the mesh
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        robust: which views and pixels are believed; all if not given
        frames: [views, 4] of the photographs within the images; the whole images if not given
    """
    shown = render_initial(mesh, cameras, silhouettes.shape[1:])
    known = known_pixels(silhouettes, frames)
    if robust is not None:
        known = robust.count(known)
        shown, silhouettes = shown[robust.trusted], silhouettes[robust.trusted]
    return Start(mean_iou(shown, silhouettes, known), 1 - lost)


def render_initial(mesh: trimesh.Trimesh, cameras: Cameras, size: tuple[int, int]) -> np.ndarray:
    """The silhouettes of a mesh at unit size where a fit puts it: [views, height, width] bool."""
    world = mesh.copy()
    world.apply_scale(1 / INITIAL_SCALE)
    return render(world, cameras, size)
