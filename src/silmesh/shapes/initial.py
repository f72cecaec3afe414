"""The initial mesh that a configuration names, and what a person should know of it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
import trimesh

from silmesh.errors import InputError, name_some
from silmesh.geometry.camera import INITIAL_SCALE, OBJECT_RADIUS, Cameras
from silmesh.geometry.frame import find_whole, is_cut, known_pixels
from silmesh.geometry.overlap import mean_iou
from silmesh.geometry.robust_hull import RobustHull
from silmesh.geometry.small_images import LARGEST, shrink, shrink_frames
from silmesh.geometry.thresholds import COHERENT
from silmesh.geometry.visual_hull import Hull
from silmesh.own_code import call, own_file
from silmesh.progress import Share, untold
from silmesh.settings.init import Init, mesh_file
from silmesh.shapes.alignment import MOST, align_to_box, choose_count, choose_report_count, to_unit
from silmesh.shapes.carved import CARVED, Carved, EmptyHull, draw
from silmesh.shapes.choose import VERTICES, Score, Trial, score_meshes, share
from silmesh.shapes.downsample import crop
from silmesh.shapes.moved import jitter, turn
from silmesh.shapes.own_mesh import own_mesh
from silmesh.shapes.primitives import PRIMITIVES, placed_primitive, plain_primitive
from silmesh.shapes.sphere import unit_sphere
from silmesh.shapes.starts import Start, measure_start, render_initial

PLACED = (*PRIMITIVES, *CARVED)  # shapes that all views place in the world; `auto` tries these
SHAPES = ("sphere", *PLACED, "auto")
FALLBACK = "ellipsoid"  # the shape that is taken if a hull is empty
BETTER = 0.01  # IoU by which that must fit better than a hull to take its place
LOST = 0.001  # share of a carved body's volume in smaller pieces from which to warn
NOTHING = 1e-9  # volume over the cube of its size of what is no body
FAR = 20  # radii of the object: what a person gives as its mesh should not reach farther
# A hull's mesh may fit worse than the hull itself by COARSE of IoU; if it fits poorly and that is
# passed, `vertices: auto` doubles its vertices, up to DOUBLED times.
COARSE, DOUBLED = 0.05, 3
NAMED = 5  # most views that a warning names


@dataclass(frozen=True)
class Initial:
    """An initial mesh at unit size, and what ``init.json`` says of it."""

    mesh: trimesh.Trimesh
    notes: Mapping[str, Any]


@dataclass(frozen=True)
class _Made:
    """A mesh at unit size, what is said of a carved one, and the hull it was drawn from."""

    shape: str
    mesh: trimesh.Trimesh
    notes: Mapping[str, Any] = field(default_factory=dict)
    robust: RobustHull | None = None
    hull: Hull | None = None


def make_initial_mesh(
    init: Init,
    silhouettes: np.ndarray,
    cameras: Cameras,
    trial: Trial | None = None,
    progress: Share = untold,
    frames: np.ndarray | None = None,
) -> Initial:
    """Make an initial mesh at unit size; the fit halves it.

    Where a hull is asked for that is empty, or fits the silhouettes worse than the ellipsoid, it is
    the ellipsoid, with a warning; so it is where a prism comes in pieces of which the largest fits
    worse. A function of a person's own (``own_code``) is called with the silhouettes, the cameras,
    and the number of vertices or None, and gives a closed mesh in the cameras' world, the
    normalised one. Images of more than ``LARGEST`` pixels are shrunk before all that.

    Args:
        init: what is asked for
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        trial: fits for a few steps; needed for ``auto``
        progress: is told which share of these fits is done
        frames: [views, 4] left, top, right and bottom of the photographs in these images, in
            pixels; the whole images if not given

    Raises:
        InputError: a function of a person's own fails, or gives no closed mesh; all silhouettes
            are empty
    """
    if frames is not None and init.shape != "sphere":  # the report's is placed in the whole image
        silhouettes, cameras, frames = crop(silhouettes, cameras, frames)
    if max(silhouettes.shape[1:]) > LARGEST:
        frames = shrink_frames(silhouettes, LARGEST, frames)
        silhouettes, cameras = shrink(silhouettes, cameras, LARGEST)
    if not silhouettes.any():
        raise InputError("no silhouette shows the object: all are empty")
    scores, warnings = {}, []
    shape = init.shape
    if shape == "auto":
        scores, warnings = _score(init, silhouettes, cameras, trial, progress, frames)
        shape = next(iter(scores))
    try:
        made = _make(init.model_copy(update={"shape": shape}), silhouettes, cameras, frames)
    except EmptyHull as error:
        warnings.append(f"{error}; the initial mesh is the {FALLBACK} instead")
        made = _make(init.model_copy(update={"shape": FALLBACK}), silhouettes, cameras, frames)
    warnings += _warnings(made.notes, silhouettes, cameras, frames)
    notes, starts = made.notes, {}
    if made.shape in CARVED and init.align != "none":
        made, starts, changed = _compare_starts(made, init, silhouettes, cameras, frames)
        warnings += changed
    mesh = jitter(made.mesh, init.moved)
    shown = render_initial(mesh, cameras, silhouettes.shape[1:])
    described = {
        "asked": init.shape,
        "shape": made.shape,
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "genus": 1 - mesh.euler_number // 2,
        "iou_mean": mean_iou(shown, silhouettes, known_pixels(silhouettes, frames)),
        **notes,
        "starts": {name: asdict(start) for name, start in starts.items()},
        "scores": {name: asdict(score) for name, score in scores.items()},
        "warnings": warnings,
    }
    return Initial(mesh, described)


def _compare_starts(
    made: _Made,
    init: Init,
    silhouettes: np.ndarray,
    cameras: Cameras,
    frames: np.ndarray | None,
) -> tuple[_Made, dict[str, Start], list[str]]:
    """A carved body, or the ellipsoid if that fits better; how they do, and what was changed.

    The ellipsoid is looked at only where a hull fits poorly, or a body lost much with its other
    pieces. That a prism fits worse is no reason: it is coarse by its nature, and was asked for.
    """
    lost = made.notes["lost"]
    own = measure_start(made.mesh, lost, silhouettes, cameras, made.robust, frames)
    starts, finer = {made.shape: own}, []
    if made.shape == "hull" and init.vertices == "auto" and own.iou < COHERENT:
        made, own, finer = _draw_finer(made, own, init.genus, silhouettes, cameras, frames)
        starts = {made.shape: own}
    if not (own.splinter if made.robust is None else own.poor):
        return made, starts, finer
    other = _make(init.model_copy(update={"shape": FALLBACK}), silhouettes, cameras, frames)
    plain = measure_start(other.mesh, 0, silhouettes, cameras, made.robust, frames)
    starts[FALLBACK] = plain
    if plain.iou <= own.iou + BETTER:
        return made, starts, finer
    changed = (
        f"the initial mesh is the {FALLBACK}: its IoU with the silhouettes is {plain.iou:.2f}, and "
        f"{own.iou:.2f} that of the {made.shape}'s largest piece, {own.kept:.0%} of its volume"
    )
    return other, starts, [*finer, changed]


def _draw_finer(
    made: _Made,
    start: Start,
    genus: str,
    silhouettes: np.ndarray,
    cameras: Cameras,
    frames: np.ndarray | None,
) -> tuple[_Made, Start, list[str]]:
    """The hull with more vertices where its mesh loses what is thin; how it does, what was changed.

    No more are tried once the mesh fits nearly as well as the hull itself.
    """

    def measure(mesh: trimesh.Trimesh) -> Start:
        lost = made.notes["lost"]
        return measure_start(mesh, lost, silhouettes, cameras, made.robust, frames)

    surface = trimesh.Trimesh(*made.hull.surface(), process=False)
    whole = measure(surface.apply_scale(INITIAL_SCALE)).iou
    count = few = len(made.mesh.vertices)
    before = start.iou
    for _ in range(DOUBLED):
        count *= 2
        if start.iou >= whole - COARSE or count > MOST:
            break
        mesh = draw(made.hull, count, genus).mesh.apply_scale(INITIAL_SCALE)
        if (tried := measure(mesh)).iou > start.iou:
            made, start = replace(made, mesh=mesh), tried
    if start.iou == before:
        return made, start, []
    changed = (
        f"the initial mesh has {len(made.mesh.vertices)} vertices instead of {few}: its IoU with "
        f"the silhouettes is {start.iou:.2f} instead of {before:.2f}, {whole:.2f} that of the hull"
    )
    return made, start, [changed]


def _make(
    init: Init, silhouettes: np.ndarray, cameras: Cameras, frames: np.ndarray | None
) -> _Made:
    """An initial mesh at unit size."""
    counted = init.vertices == "auto"
    if init.shape == "sphere":
        count = choose_report_count(silhouettes) if counted else init.vertices
        mesh = turn(unit_sphere(count), init.moved)
        if init.align == "bbox":
            mesh.vertices = align_to_box(mesh.vertices, silhouettes[0])
        return _Made(init.shape, mesh)
    whole = find_whole(silhouettes, frames)
    nearer = _compare_scale(cameras, whole)
    vertices = choose_count(silhouettes[whole], nearer) if counted else init.vertices
    notes, robust, hull = {}, None, None
    if path := mesh_file(init.shape):
        given = None if counted else init.vertices
        return _Made(init.shape, own_mesh(path, given, init, silhouettes, cameras, frames))
    if init.shape in CARVED:
        carved = CARVED[init.shape](silhouettes, cameras, vertices, init.genus, frames)
        mesh, robust, hull = carved.mesh, carved.robust, carved.hull
        notes = _describe(carved, cameras)
    elif own_file(init.shape):
        given = None if counted else init.vertices
        own = silhouettes.copy()  # what it writes into stays its own
        radius = OBJECT_RADIUS if init.align != "none" else None
        mesh = take_mesh(init.shape, call(init.shape, own, cameras, given), radius)
    elif init.align == "none":
        mesh = plain_primitive(init.shape, vertices)
    else:
        mesh = placed_primitive(init.shape, vertices, silhouettes, cameras, frames)
    if init.align == "none":
        return _Made(init.shape, to_unit(mesh), notes, robust)
    mesh.apply_scale(INITIAL_SCALE)
    return _Made(init.shape, mesh, notes, robust, hull)


def _describe(carved: Carved, cameras: Cameras) -> dict[str, Any]:
    """What is said of a carved body, of a hull with the views that are not wholly believed."""
    notes = {name: getattr(carved, name) for name in ("tolerated", "pieces", "lost")}
    if carved.robust is not None:
        for name in ("distrusted", "corrected"):
            notes[name] = [cameras.views[i] for i in getattr(carved.robust, name)]
    return notes


def _compare_scale(cameras: Cameras, whole: np.ndarray) -> float:
    """By which factor areas grow if they are measured in pixels of all views, not of some.

    A pixel has the mean area of those of all views, so that close-ups, of which each shows a part,
    make triangles smaller only as far as all views together resolve them.
    """
    if len(whole) == len(cameras):
        return 1.0
    depths = cameras.t[:, 2].abs().clamp(min=OBJECT_RADIUS)
    areas = (depths / cameras.K[:, 0, 0]).square()
    return max(1.0, float(areas[whole].mean() / areas.mean()))


def take_mesh(name: str, made: Any, radius: float | None = None) -> trimesh.Trimesh:
    """The mesh that a person's own function or code gave, if one can be fitted from it.

    Args:
        name: of what gave it, for messages
        radius: of the sphere about the origin that the object lies in; any if not given

    Raises:
        InputError: it is no closed mesh, or far larger than the object
    """
    if not isinstance(made, trimesh.Trimesh):
        raise InputError(f"{name}: gives {type(made).__name__}; should give a trimesh.Trimesh")
    if not np.isfinite(made.vertices).all():
        raise InputError(f"{name}: gives a vertex that is not finite")
    if not (len(made.faces) and made.is_watertight):
        raise InputError(f"{name}: gives a mesh that is not closed; should be watertight")
    mesh = trimesh.Trimesh(made.vertices, made.faces, process=False)
    far, volume = np.abs(mesh.vertices).max(), _measure_volume(mesh)
    if radius is not None and far > FAR * radius:
        raise InputError(
            f"{name}: gives a mesh that reaches {far:.3g} from the origin; the object lies within "
            f"{radius:g}"
        )
    if abs(volume) <= NOTHING * far**3:
        raise InputError(f"{name}: gives a mesh without volume; should be a solid body")
    if volume < 0:  # a fit would turn it outside out through its own surface
        mesh.invert()
    return mesh


def _measure_volume(mesh: trimesh.Trimesh) -> float:
    """The signed volume; that of trimesh divides by it."""
    return float(np.linalg.det(mesh.vertices[mesh.faces]).sum() / 6)


def _score(
    init: Init,
    silhouettes: np.ndarray,
    cameras: Cameras,
    trial: Trial | None,
    progress: Share,
    frames: np.ndarray | None,
) -> tuple[dict[str, Score], list[str]]:
    """How every placed shape does, the best first, and why some are not among them."""
    if trial is None:
        raise ValueError("auto needs a trial")
    meshes, empty = {}, {}

    def make(shape: str) -> None:
        try:
            small = init.model_copy(update={"shape": shape, "vertices": VERTICES})
            meshes[shape] = _make(small, silhouettes, cameras, frames).mesh
        except EmptyHull as error:
            empty[shape] = str(error)

    share(make, PLACED)
    warnings = [empty[shape] for shape in PLACED if shape in empty]  # whichever came first
    meshes = {shape: meshes[shape] for shape in PLACED if shape in meshes}
    return score_meshes(meshes, silhouettes, cameras, trial, progress, frames), warnings


def _warnings(
    notes: Mapping[str, Any], silhouettes: np.ndarray, cameras: Cameras, frames: np.ndarray | None
) -> list[str]:
    """What a person should know of the views and the pieces, in sentences."""
    found = []
    if notes.get("lost", 0) > LOST:
        found.append(
            f"the body comes in {notes['pieces']} pieces; the largest is kept, the others are "
            f"{notes['lost']:.1%} of the volume"
        )
    if lost := notes.get("distrusted"):
        found.append(
            f"the hull of the other views contradicts {name_some(lost, NAMED)}: no weight in the "
            "initial mesh"
        )
    if parts := notes.get("corrected"):
        found.append(
            f"parts of the silhouettes contradict those of other views in {name_some(parts, NAMED)}"
            ": the initial mesh does not follow them there"
        )
    if notes.get("tolerated"):
        found.append(
            f"the hull lets {notes['tolerated']} of {len(cameras)} views disagree: of all views it "
            "would not fill the silhouettes"
        )
    cut = [cameras.views[i] for i in np.flatnonzero(is_cut(silhouettes, frames))]
    if cut:
        found.append(
            f"the frame cuts the object in {name_some(cut, NAMED)}: what lies beyond is not known"
        )
    return found
