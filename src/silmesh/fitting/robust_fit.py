"""A fit that bears wrong silhouettes, and a start that misleads it.

First every view counts. Where the visual hull of the others contradicts views, as the fit refined
their cameras too, the mesh is fitted again without what is contradicted. A visual hull of wrong
silhouettes or cameras can be a splinter, from which no fit recovers; then the fit begins again from
an ellipsoid, which knows less and misleads less, and the better one is taken.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import trimesh

from silmesh.errors import InputError
from silmesh.fitting.belief import Belief, find_belief
from silmesh.fitting.checkpoint import Checkpoint
from silmesh.fitting.fit import Fitted, fit_mesh, fitted_views
from silmesh.fitting.loop import Record
from silmesh.geometry.thresholds import COHERENT
from silmesh.scene.scene import Scene
from silmesh.settings.fit import FastFit, Fit
from silmesh.settings.init import Init
from silmesh.shapes.initial import FALLBACK, make_initial_mesh

ATTEMPTS = ("first", "judged", "other")  # names of fits, each of which keeps a checkpoint
CONTESTED = 0.5  # of the views: if more are contradicted it is not the silhouettes that are wrong
LESS = 0.01  # of IoU: a fit that ends by more below its start was led astray
SAME = 1e-5  # of the world: two starts whose vertices are no further apart are one
MISLEADING = ("hull", "auto")  # shapes that wrong silhouettes spoil, and that nobody compares

Resume = Callable[[str, Sequence[Any]], Checkpoint]


def fit_robustly(
    mesh: trimesh.Trimesh,
    scene: Scene,
    settings: Fit,
    shape: str = "",
    watch: Callable[[Record], None] = lambda record: None,
    resume: Resume | None = None,
) -> Fitted:
    """Fit a mesh; by the preset ``fast`` again where views are contradicted or the fit ends badly.

    A fit ends badly below its start, or incoherent. The ellipsoid that is then tried has as many
    vertices as the mesh. What was done otherwise is among the warnings in the result's ``notes``.

    Arguments, result and errors are those of ``fit_mesh``, and:

    Args:
        shape: what the initial mesh was asked as; of ``hull`` and ``auto`` another start is tried
        resume: makes the checkpoint of each of ``ATTEMPTS``, which need files of their own, since
            a fit that was killed resumes from all
    """

    def fit(name: str, start: trimesh.Trimesh, belief: Belief | None) -> Fitted:
        return fit_mesh(
            start, scene, settings, watch, partial(resume, name) if resume else None, belief
        )

    fitted = fit("first", mesh, None)
    if not isinstance(settings, FastFit):
        return fitted
    belief = judge(scene, settings, fitted) if settings.judge_views else None
    if belief:
        try:
            fitted = fit("judged", mesh, belief)
        except InputError as error:  # numbers that are not finite; the fit before is there
            said = f"a fit without what the other views contradict was in vain: {error}"
            fitted, belief = fitted.warning(said), None
    end = fitted.notes["iou_end"]
    if shape not in MISLEADING or end >= max(COHERENT, fitted.notes["iou_start"] - LESS):
        return fitted
    init = Init(shape=FALLBACK, vertices=len(mesh.vertices), align="bbox", genus="keep", moved=0)
    other = make_initial_mesh(init, scene.silhouettes, scene.cameras, frames=scene.frames).mesh
    if _is_same(mesh, other):
        return fitted
    try:
        again = fit("other", other, belief)
    except InputError as error:  # numbers that are not finite; the fit before is there
        return fitted.warning(f"an {FALLBACK} was tried as another start, in vain: {error}")
    other_end = again.notes["iou_end"]
    if other_end > end:
        return again.warning(_describe(other_end, end, restarted=True))
    return fitted.warning(_describe(end, other_end, restarted=False))


def judge(scene: Scene, settings: Fit, fitted: Fitted) -> Belief | None:
    """What is to count of the views, if some of them are contradicted by the others.

    Cameras that are a little wrong contradict silhouettes that are right. So the views are judged
    by the cameras as they were given and as the fit refined them, and the ones that contradict the
    fewest views are believed.
    """
    views = fitted_views(scene, settings)
    belief = find_belief(scene, views, scene.cameras)
    if belief.contested:
        refined = fitted.cameras.in_world_of(scene.similarity)
        belief = min(belief, find_belief(scene, views, refined), key=lambda b: b.contested)
    return belief if 0 < belief.contested <= CONTESTED * len(views) else None


def _is_same(mesh: trimesh.Trimesh, other: trimesh.Trimesh) -> bool:
    """Whether two starts are one, apart from how their files round them."""
    if mesh.vertices.shape != other.vertices.shape:
        return False
    return bool(np.allclose(mesh.vertices, other.vertices, rtol=0, atol=SAME))


def _describe(end: float, other: float, restarted: bool) -> str:
    """What became of two starts, for a person."""
    if restarted:
        return f"the fit began again from an {FALLBACK}: IoU {end:.3f} in place of {other:.3f}"
    return f"an {FALLBACK} was tried as another start: IoU {other:.3f}, no better than {end:.3f}"
