"""The initial mesh that a configuration names, and what a person should know of it."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import trimesh

from silmesh.errors import InputError, name_some
from silmesh.geometry.camera import INITIAL_SCALE, Cameras
from silmesh.geometry.frame import is_cut
from silmesh.own_code import call, own_file
from silmesh.progress import Share, untold
from silmesh.settings.init import Init
from silmesh.shapes.alignment import align_to_box, choose_count, choose_report_count, to_unit
from silmesh.shapes.carved import CARVED, EmptyHull
from silmesh.shapes.choose import VERTICES, Score, Trial, score_meshes, share
from silmesh.shapes.downsample import crop
from silmesh.shapes.primitives import PRIMITIVES, placed_primitive, plain_primitive
from silmesh.shapes.sphere import unit_sphere

PLACED = (*PRIMITIVES, *CARVED)  # shapes that all views place in the world; `auto` tries these
SHAPES = ("sphere", *PLACED, "auto")
FALLBACK = "ellipsoid"  # the shape that is taken if a hull is empty
LOST = 0.001  # share of a carved body's volume in smaller pieces from which to warn
NAMED = 5  # most views that a warning names


@dataclass(frozen=True)
class Initial:
    """An initial mesh at unit size, and what ``init.json`` says of it."""

    mesh: trimesh.Trimesh
    notes: Mapping[str, Any]


def make_initial_mesh(
    init: Init,
    silhouettes: np.ndarray,
    cameras: Cameras,
    trial: Trial | None = None,
    progress: Share = untold,
    frame: Sequence[int] | None = None,
) -> Initial:
    """Make an initial mesh at unit size; the fit halves it.

    Where a hull is asked for that is empty, it is the ellipsoid, with a warning. A function of a
    person's own (``own_code``) is called with the silhouettes, the cameras, and the number of
    vertices or None, and gives a closed mesh in the cameras' world, the normalised one.

    Args:
        init: what is asked for
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        trial: fits for a few steps; needed for ``auto``
        progress: is told which share of these fits is done
        frame: left, top, right and bottom of all photographs in these images, in pixels; the whole
            images if not given

    Raises:
        InputError: a function of a person's own fails, or gives no closed mesh
    """
    if frame is not None and init.shape != "sphere":  # the report's is placed in the whole image
        silhouettes, cameras = crop(silhouettes, cameras, frame)
    scores, warnings = {}, []
    shape = init.shape
    if shape == "auto":
        scores, warnings = _score(init, silhouettes, cameras, trial, progress)
        shape = next(iter(scores))
    try:
        mesh, notes = _make(init.model_copy(update={"shape": shape}), silhouettes, cameras)
    except EmptyHull as error:
        shape = FALLBACK
        warnings.append(f"{error}; the initial mesh is the {FALLBACK} instead")
        mesh, notes = _make(init.model_copy(update={"shape": shape}), silhouettes, cameras)
    described = {
        "asked": init.shape,
        "shape": shape,
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "genus": 1 - mesh.euler_number // 2,
        **notes,
        "scores": {name: asdict(score) for name, score in scores.items()},
        "warnings": [*warnings, *_warnings(notes, silhouettes, cameras)],
    }
    return Initial(mesh, described)


def _make(
    init: Init, silhouettes: np.ndarray, cameras: Cameras
) -> tuple[trimesh.Trimesh, dict[str, Any]]:
    """An initial mesh at unit size, and what is told of a carved one."""
    counted = init.vertices == "auto"
    if init.shape == "sphere":
        mesh = unit_sphere(choose_report_count(silhouettes) if counted else init.vertices)
        if init.align == "bbox":
            mesh.vertices = align_to_box(mesh.vertices, silhouettes[0])
        return mesh, {}
    vertices = choose_count(silhouettes) if counted else init.vertices
    notes = {}
    if init.shape in CARVED:
        carved = CARVED[init.shape](silhouettes, cameras, vertices, init.genus)
        mesh = carved.mesh
        notes = {name: getattr(carved, name) for name in ("tolerated", "pieces", "lost")}
    elif own_file(init.shape):
        given = None if counted else init.vertices
        mesh = _take(init.shape, call(init.shape, silhouettes, cameras, given))
    elif init.align == "none":
        mesh = plain_primitive(init.shape, vertices)
    else:
        mesh = placed_primitive(init.shape, vertices, silhouettes, cameras)
    if init.align == "none":
        return to_unit(mesh), notes
    mesh.apply_scale(INITIAL_SCALE)
    return mesh, notes


def _take(shape: str, made: Any) -> trimesh.Trimesh:
    """The mesh that a person's own function gave, if one can be fitted from it."""
    if not isinstance(made, trimesh.Trimesh):
        raise InputError(f"{shape}: gives {type(made).__name__}; should give a trimesh.Trimesh")
    if not np.isfinite(made.vertices).all():
        raise InputError(f"{shape}: gives a vertex that is not finite")
    if not (len(made.faces) and made.is_watertight):
        raise InputError(f"{shape}: gives a mesh that is not closed; should be watertight")
    return trimesh.Trimesh(made.vertices, made.faces, process=False)


def _score(
    init: Init, silhouettes: np.ndarray, cameras: Cameras, trial: Trial | None, progress: Share
) -> tuple[dict[str, Score], list[str]]:
    """How every placed shape does, the best first, and why some are not among them."""
    if trial is None:
        raise ValueError("auto needs a trial")
    meshes, warnings = {}, []

    def make(shape: str) -> None:
        try:
            small = init.model_copy(update={"shape": shape, "vertices": VERTICES})
            meshes[shape], _ = _make(small, silhouettes, cameras)
        except EmptyHull as error:
            warnings.append(str(error))

    share(make, PLACED)
    meshes = {shape: meshes[shape] for shape in PLACED if shape in meshes}
    return score_meshes(meshes, silhouettes, cameras, trial, progress), warnings


def _warnings(notes: Mapping[str, Any], silhouettes: np.ndarray, cameras: Cameras) -> list[str]:
    """What a person should know of the views and the pieces, in sentences."""
    found = []
    if notes.get("lost", 0) > LOST:
        found.append(
            f"the body comes in {notes['pieces']} pieces; the largest is kept, the others are "
            f"{notes['lost']:.1%} of the volume"
        )
    if notes.get("tolerated"):
        found.append(
            f"the hull lets {notes['tolerated']} of {len(cameras)} views disagree: of all views it "
            "would not fill the silhouettes"
        )
    cut = [view for view, is_it in zip(cameras.views, is_cut(silhouettes), strict=True) if is_it]
    if cut:
        found.append(
            f"the frame cuts the object in {name_some(cut, NAMED)}: what lies beyond is not known"
        )
    return found
