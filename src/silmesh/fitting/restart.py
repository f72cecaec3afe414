"""A fit that was led astray by its start begins again from an ellipsoid; the better one is taken.

A visual hull of wrong silhouettes or cameras can be a splinter, from which no fit recovers. An
ellipsoid knows less and misleads less.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import trimesh

from silmesh.errors import InputError
from silmesh.fitting.checkpoint import Checkpoint
from silmesh.fitting.fit import Fitted, fit_mesh
from silmesh.fitting.loop import Record
from silmesh.geometry.thresholds import COHERENT
from silmesh.scene.scene import Scene
from silmesh.settings.fit import FastFit, Fit
from silmesh.settings.init import Init
from silmesh.shapes.initial import FALLBACK, make_initial_mesh

LESS = 0.01  # of IoU: a fit that ends by more below its start was led astray
ROUNDED = 1e-6  # most by which a file of single precision moves a vertex at unit size
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
) -> Fitted:
    """Fit a mesh, and an ellipsoid if the fit ends badly: below its start, or incoherent.

    Arguments, result and errors are those of ``fit_mesh``. A warning in its ``notes`` says how both
    did.
    """
    fitted = fit_mesh(mesh, scene, settings, watch, go_on)
    start, end = fitted.notes["iou_start"], fitted.notes["iou_end"]
    if end >= max(COHERENT, start - LESS):
        return fitted
    other = make_initial_mesh(
        Init(shape=FALLBACK), scene.silhouettes, scene.cameras, frames=scene.frames
    )
    if _are_same(mesh, other.mesh):
        return fitted
    try:
        again = fit_mesh(other.mesh, scene, settings, watch, go_on)
    except InputError as error:  # numbers that are not finite; the first fit is there
        return fitted.warning(f"an {FALLBACK} was tried as another start, in vain: {error}")
    other_end = again.notes["iou_end"]
    if other_end > end:
        return again.warning(_describe(other_end, end, restarted=True))
    return fitted.warning(_describe(end, other_end, restarted=False))


def _are_same(mesh: trimesh.Trimesh, other: trimesh.Trimesh) -> bool:
    """Whether a fit began with this mesh already, but for the precision of its file."""
    here, there = mesh.vertices, other.vertices
    return here.shape == there.shape and np.allclose(here, there, rtol=0, atol=ROUNDED)


def _describe(end: float, other: float, restarted: bool) -> str:
    """What became of two starts, for a person."""
    if restarted:
        return f"the fit began again from an {FALLBACK}: IoU {end:.3f} in place of {other:.3f}"
    return f"an {FALLBACK} was tried as another start: IoU {other:.3f}, no better than {end:.3f}"
