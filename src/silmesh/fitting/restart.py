"""A fit that was led astray by its start begins again from an ellipsoid; the better one is taken.

A visual hull of wrong silhouettes or cameras can be a splinter, from which no fit recovers. An
ellipsoid knows less and misleads less.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import trimesh

from silmesh.fitting.checkpoint import Checkpoint
from silmesh.fitting.fit import Fitted, fit_mesh
from silmesh.fitting.loop import Record
from silmesh.geometry.thresholds import COHERENT
from silmesh.scene.scene import Scene
from silmesh.settings.fit import FastFit, Fit
from silmesh.settings.init import Init
from silmesh.shapes.initial import FALLBACK, make_initial_mesh

LESS = 0.01  # of IoU: a fit that ends by more below its start was led astray
SAME = 1e-5  # of the world: two starts whose vertices are no further apart are one
MISLEADING = ("hull", "auto")  # shapes that wrong silhouettes spoil, and that nobody compares


def may_restart(shape: str, settings: Fit) -> bool:
    """Whether another start may be tried than the shape that is asked for."""
    return shape in MISLEADING and isinstance(settings, FastFit)


def fit_or_restart(
    mesh: trimesh.Trimesh,
    scene: Scene,
    settings: Fit,
    watch: Callable[[Record], None] = lambda record: None,
    go_on: Callable[[Sequence[Any]], Checkpoint] | None = None,
    go_on_again: Callable[[Sequence[Any]], Checkpoint] | None = None,
) -> Fitted:
    """Fit a mesh, and an ellipsoid if the fit ends badly: below its start, or incoherent.

    The ellipsoid has as many vertices as the mesh. A mesh that is this ellipsoid already has no
    other start. Otherwise a warning in the result's ``notes`` says how both did.

    Arguments, result and errors are those of ``fit_mesh``.

    Args:
        go_on_again: as ``go_on``, of the ellipsoid's fit: it needs a file of its own, since a fit
            that was killed in it resumes from both
    """
    fitted = fit_mesh(mesh, scene, settings, watch, go_on)
    start, end = fitted.notes["iou_start"], fitted.notes["iou_end"]
    if end >= max(COHERENT, start - LESS):
        return fitted
    init = Init(shape=FALLBACK, vertices=len(mesh.vertices), align="bbox", genus="keep")
    other = make_initial_mesh(init, scene.silhouettes, scene.cameras, frames=scene.frames).mesh
    if _is_same(mesh, other):
        return fitted
    again = fit_mesh(other, scene, settings, watch, go_on_again)
    other_end = again.notes["iou_end"]
    if other_end > end:
        return again.warning(_describe(other_end, end, restarted=True))
    return fitted.warning(_describe(end, other_end, restarted=False))


def _is_same(mesh: trimesh.Trimesh, other: trimesh.Trimesh) -> bool:
    """Whether two starts are one, apart from how their files round them."""
    if mesh.vertices.shape != other.vertices.shape:
        return False
    return bool(np.allclose(mesh.vertices, other.vertices, rtol=0, atol=SAME))


def _describe(end: float, other: float, restarted: bool) -> str:
    """What became of two starts, for a person."""
    if restarted:
        return f"the fit began again from an {FALLBACK}: IoU {end:.2f} in place of {other:.2f}"
    return f"an {FALLBACK} was tried as another start: IoU {other:.2f}, no better than {end:.2f}"
