"""The Python API: ``silmesh.reconstruct`` and the stages that it composes, all in memory.

``import silmesh`` gives these names and loads this module, and the libraries that it stands on,
when one of them is first used. What is chosen, and every default, is what the command
``silmesh PHOTOS`` takes. Only COLMAP needs files, which lie in a temporary folder meanwhile.

Stages follow one another:

    photographs = silmesh.read_photographs("photos/")
    found = silmesh.find_silhouettes(photographs, masks="masks/")
    scene = silmesh.find_cameras(photographs, found)
    initial = silmesh.initial_mesh(scene)
    fitted = silmesh.fit(initial, scene)
    fitted = silmesh.refine(fitted, scene, photographs)
    texture = silmesh.bake(fitted, scene, photographs)
    mesh, metrics = texture.mesh, silmesh.evaluate(fitted, scene, initial, texture=texture)

World   of a scene: normalised, y up, the object in the sphere of radius 0.5 about the origin; of
        what a fit gives: the cameras' own. Cameras are OpenCV's (``silmesh.geometry.camera``).
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
import trimesh
from PIL import Image

from silmesh.cameras.attempt import FILE, WORLD_TO_CAMERA, Attempt
from silmesh.cameras.locate import locate
from silmesh.cameras.sets import CLASH, find_sets
from silmesh.errors import InputError, name_some
from silmesh.evaluation import metrics
from silmesh.evaluation.texturing import make_texture
from silmesh.fitting.fit import Fitted
from silmesh.fitting.loop import Record
from silmesh.fitting.photometric import refine_by_photographs
from silmesh.fitting.robust_fit import fit_robustly
from silmesh.fitting.trial import trial_with
from silmesh.geometry.camera import INITIAL_SCALE, OBJECT_RADIUS, Cameras
from silmesh.geometry.mesh_files import read_mesh, write_coloured
from silmesh.geometry.obj_companions import name_companions, try_companions
from silmesh.geometry.textured_mesh import (
    encode_png,
    has_texture,
    texture_mesh,
    write_textured_glb,
    write_textured_obj,
)
from silmesh.geometry.thresholds import CONVINCING
from silmesh.intake.arguments import (
    checked,
    refuse_array,
    refuse_cameras,
    refuse_empty_mesh,
)
from silmesh.intake.photographs import find_longest, find_masks, find_photographs, is_video
from silmesh.intake.sources import choose_cameras, choose_silhouettes, look
from silmesh.naming import match_masks
from silmesh.progress import Share, untold
from silmesh.scene.assemble import build_scene
from silmesh.scene.judged import judge_scene
from silmesh.scene.scene import Scene
from silmesh.settings.cameras import Calibrate, Colmap
from silmesh.settings.check import check
from silmesh.settings.detail import NORMAL, choose_detail
from silmesh.settings.fit import FastFit, Fit, SoftRasFit, is_photometric, name_fit
from silmesh.settings.init import Init
from silmesh.settings.quality import Quality
from silmesh.settings.silhouettes import FOREGROUND_MODELS, Networks, check_source
from silmesh.settings.texture import Texture
from silmesh.settings.turntable import parse_turntable
from silmesh.settings.views import Views
from silmesh.shapes.initial import Initial, make_initial_mesh, take_mesh
from silmesh.silhouettes import Found
from silmesh.silhouettes import find_silhouettes as find_each
from silmesh.silhouettes.mask import refuse_labels
from silmesh.texture.vertex_colours import colour_vertices
from silmesh.views import Pictures, View, in_order, make_views

Paths = str | Path | Sequence[str | Path]
CameraSource = str | Path | Cameras
SECTIONS = {  # of the configuration
    "views": Views,
    **{name: field.annotation for name, field in Networks.model_fields.items()},
    "calibrate": Calibrate,
    "colmap": Colmap,
    "quality": Quality,
    "texture": Texture,
    "init": Init,
    "fit": Fit,
}
SOURCES = ("turntable", "calibrate", "colmap", "auto")  # of cameras, beside files
OWN = "the cameras given"  # what messages call cameras that come of no file
WRITTEN = (".glb", ".obj", ".ply", ".stl")  # formats of meshes
HULL = "hull"  # the initial mesh, unless another is asked for
UNIT = OBJECT_RADIUS * INITIAL_SCALE  # half the side of meshes at unit size


@dataclass(frozen=True)
class Photographs:
    """Photographs of one object, and their working images.

    Attributes:
        files: in natural order
        views: of each its name, and where it lies in its working image
        images: the working images by the views' names, [size, size] RGB or RGBA
        notes: what a person should know of what was found and is not used
        video: the folder of the pictures that a video was cut into, while this lives
    """

    files: tuple[Path, ...]
    views: tuple[View, ...]
    images: Mapping[str, Image.Image]
    notes: tuple[str, ...] = ()
    video: TemporaryDirectory | None = None


@dataclass(frozen=True)
class Silhouettes(Found):
    """The silhouettes of all photographs, and where they come from.

    Attributes:
        source: ``mask``, ``alpha``, ``threshold``, a network, or ``path/to/file.py:function``
        policy: what is done with outliers: ``keep``, ``drop`` or ``repair``
    """

    source: str = "mask"
    policy: str = "keep"


@dataclass(frozen=True)
class Baked:
    """A mesh with its texture.

    Attributes:
        mesh: with ``TextureVisuals``, its vertices split where charts of the texture end
        notes: as ``texture.json`` has them
    """

    mesh: trimesh.Trimesh
    notes: Mapping[str, Any]


@dataclass(frozen=True)
class Reconstruction:
    """What became of photographs.

    Attributes:
        mesh: with its texture, or with the colours of its vertices if none was asked for, in the
            cameras' world
        coloured: the mesh with the colours of its vertices
        cameras: of the fitted views, as ``cameras.json`` has them
        silhouettes: [views, size, size] bool, in the order of the cameras
        metrics: as ``metrics.json`` has them; ``silhouettes``, a folder there, is None
        losses: before each step, as ``loss.csv`` has them
        initial: the mesh that the fit began with, and what is said of it
        scene: what was fitted, in the normalised world
    """

    mesh: trimesh.Trimesh
    coloured: trimesh.Trimesh
    cameras: Cameras
    silhouettes: np.ndarray
    metrics: Mapping[str, Any]
    losses: Sequence[Record]
    initial: Initial
    scene: Scene

    @checked
    def save(self, path: str | Path) -> None:
        """Write the mesh as the workflow does, ``.glb`` or ``.obj``, or as ``.ply`` or ``.stl``.

        An OBJ with a texture has its MTL and its PNG beside it, which are named like it. PLY has
        colours of the vertices.

        Raises:
            InputError: the ending names none of these formats, or a file that silmesh did not make
                is where the MTL or the PNG belongs
        """
        if Path(path).suffix.lower() not in WRITTEN:
            raise InputError(f"{path}: should end in {', '.join(WRITTEN)}, which names the format")
        _write(Path(path), self.mesh, self.coloured)


@checked
def reconstruct(
    photographs: Paths,
    masks: Paths | None = None,
    cameras: CameraSource | None = None,
    *,
    silhouettes: str | None = None,
    turntable: str = "",
    sets: str = "",
    detail: str = NORMAL,
    size: int | None = None,
    init: str = HULL,
    preset: str = "fast",
    quality: str = "auto",
    photometric: str | bool | None = None,
    texture: str | int = "auto",
    truth: trimesh.Trimesh | str | Path | None = None,
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> Reconstruction:
    """Make a mesh of one object from photographs of it, as ``silmesh PHOTOS`` does.

    Args:
        photographs: a folder, files, or a video
        masks: a folder, a glob or files, white on the object, named like the photographs; found
            beside these if not given
        cameras: ``calibrate``, ``colmap``, ``auto``, ``turntable`` (known), a file or folder of
            cameras, or cameras of the photographs; chosen by what the photographs show if not given
        silhouettes: ``mask``, ``alpha``, ``threshold``, ``matting``, ``deeplab``, or a function of
            your own as ``path/to/file.py:function`` (``docs/extending.md``); chosen likewise
        turntable: what is known of it, ``distance,elevation,step`` in scene units and degrees; of
            several rounds each, separated by ``;``
        sets: of photographs between which the object was turned over, as globs of view names or as
            folders, ``upright_*;turned_*``; found, where one turntable explains not all, if not
            given; used by ``calibrate`` and ``auto``, and refused with ``turntable``
        detail: ``draft``: small and quick; ``normal``; ``high``: the photographs' own size, as far
            as 8 GiB reach
        size: side of the working images, in pixels; that of ``detail`` if not given
        init: shape of the initial mesh, or a function of your own
        preset: of the fit, ``fast`` or ``softras``, or a function of your own
        quality: what is done with outliers: ``auto``, ``keep``, ``drop`` or ``repair``
        photometric: ``auto`` moves the surface to where the photographs agree, if that is better;
            False does not; ``auto`` with the preset ``fast`` if not given, others never have it
        texture: pixels of its side; ``auto`` by the photographs; 0 for colours of the vertices
        truth: the true mesh, or its file, in the frame of the cameras; metrics compare with it
        settings: more of the configuration by its sections, as ``{"fit": {"iterations": 300}}``
        progress: is told each stage's name and which share of it is done

    Raises:
        InputError: what is given cannot be used, or no cameras agree with the silhouettes
    """
    beside = [path for path in (masks, cameras) if isinstance(path, str | Path)]
    files, notes, video = _find_files(photographs, beside, bool(sets))
    longest = find_longest(files) if detail != NORMAL else 0
    chosen = choose_detail(detail, longest, len(files), size, preset=preset).settings
    named = {
        "views": chosen["views"],
        "init": {"shape": init},
        "quality": {"policy": quality},
        "fit": {**name_fit(preset, photometric), **chosen.get("fit", {})},
        "texture": {"size": texture},
    }
    sections = _check_sections(settings or {}, named)
    wanted = _check("texture", sections["texture"])
    known = _read_truth(truth)  # before the work
    origin = _SilhouetteSource(files, masks, silhouettes)
    policy, fewest = _policy(origin.source, sections["quality"])
    shown = _read(files, notes, video, sections["views"], policy, fewest, _tell(progress, "views"))
    network = sections.get(origin.source, {})
    found = _find_silhouettes(shown, origin, policy, network, _tell(progress, "silhouettes"))
    scene = find_cameras(
        shown,
        found,
        cameras,
        turntable=turntable,
        sets=sets,
        fewest=fewest,
        calibrate=sections["calibrate"],
        colmap=sections["colmap"],
        progress=_tell(progress, "cameras"),
    )
    initial = initial_mesh(scene, **sections["init"], progress=_tell(progress, "initial mesh"))
    fitted = fit(initial, scene, **sections["fit"], progress=_tell(progress, "fit"))
    if is_photometric(fitted.settings):
        fitted = refine(fitted, scene, shown, progress=_tell(progress, "relief"))
    baked, coloured = None, colour(fitted, scene)
    if wanted.wanted:
        baked = bake(fitted, scene, shown, wanted.size, progress=_tell(progress, "texture"))
    return Reconstruction(
        baked.mesh if baked else coloured,
        coloured,
        fitted.cameras,
        scene.silhouettes,
        evaluate(fitted, scene, initial, known, baked),
        fitted.records,
        initial,
        scene,
    )


@checked
def read_photographs(
    photographs: Paths,
    *,
    size: int = 256,
    resize: str = "pad",
    fewest: int | None = None,
    progress: Share = untold,
) -> Photographs:
    """Read photographs, and resize them to square working images.

    Args:
        photographs: a folder, files, or a video
        size: side of the working images, in pixels
        resize: ``pad`` keeps the aspect, centred; ``stretch`` fills the square
        fewest: photographs that must be readable; all of them if not given
        progress: is told which share is done

    Raises:
        InputError: there are no photographs, they seem to be of several objects, or too few can be
            read
    """
    files, notes, video = _find_files(photographs, [])
    return _read(files, notes, video, {"size": size, "resize": resize}, "", fewest, progress)


@checked
def find_silhouettes(
    photographs: Photographs,
    masks: Paths | None = None,
    source: str | None = None,
    *,
    policy: str = "auto",
    progress: Share = untold,
    **settings: Any,
) -> Silhouettes:
    """Find which pixels of each working image show the object.

    Args:
        masks: a folder, a glob or files, as for ``reconstruct``
        source: as ``silhouettes`` of ``reconstruct``
        policy: ``keep`` refuses a silhouette that cannot be used; ``drop`` and ``repair`` let it be
            empty; ``auto`` is as for ``reconstruct``
        progress: is told which share is done
        settings: of the configuration's section of the source, if that is a network

    Raises:
        InputError: a silhouette cannot be found or used
    """
    origin = _SilhouetteSource(photographs.files, masks, source)
    if settings and origin.source not in Networks.model_fields:
        raise InputError(
            f"silhouettes {origin.source!r} take no settings, but {name_some([*settings])} is given"
        )
    policy, _ = _policy(origin.source, {"policy": policy})
    return _find_silhouettes(photographs, origin, policy, settings, progress)


@checked
def find_cameras(
    photographs: Photographs,
    silhouettes: Silhouettes,
    source: CameraSource | None = None,
    *,
    turntable: str = "",
    sets: str = "",
    fewest: int = 3,
    calibrate: Mapping[str, Any] | None = None,
    colmap: Mapping[str, Any] | None = None,
    progress: Share = untold,
) -> Scene:
    """Find or read the cameras of the photographs, judge the silhouettes by them, and normalise.

    Args:
        silhouettes: of the photographs
        source: ``calibrate``, ``colmap``, ``auto``, ``turntable``, a file or folder of cameras, or
            cameras in pixels of the photographs or of the working images, named like these; chosen
            by what the photographs show if not given, and by how far silhouettes agree
        turntable: what is known of it, as for ``reconstruct``
        sets: between which the object was turned over, as for ``reconstruct``
        fewest: views that must be left where outliers are dropped
        calibrate, colmap: of the configuration's sections
        progress: is told which share is done of what takes longest
    Returns:
        the views that are to be fitted: cameras, silhouettes and images, undistorted, in the
        normalised world

    Raises:
        InputError: there are no cameras, or they contradict the silhouettes; says what was tried
    """
    views = photographs.views
    shape = (len(views), *(2 * [views[0].size]))
    refuse_array("silhouettes", silhouettes.silhouettes, shape, "one of each view")
    tries: Sequence[CameraSource] = (source,) if source is not None else ()
    tries = tries or choose_cameras(look(photographs.files))[0]
    known = turntable, sets, calibrate or {}, colmap or {}
    search = _Search(photographs, silhouettes, *known, progress)
    made, failure = None, None
    for trial in tries:
        try:
            made = _judge(search, trial, fewest)
        except InputError as error:
            failure = error
            continue
        if made.coherence.mean() >= CONVINCING:
            break
    if made is None:
        raise failure
    return made


@checked
def initial_mesh(
    scene: Scene, shape: str = HULL, *, progress: Share = untold, **settings: Any
) -> Initial:
    """Make an initial mesh, at unit size: ``.mesh``, and ``.notes`` of how it was made.

    Args:
        scene: that it is for
        shape: ``sphere``, ``ellipsoid``, ``cylinder``, ``cube``, ``prism``, ``hull``, or ``auto``,
            which tries all but the sphere; or a function of your own
        progress: is told which share of the trials of ``auto`` is done
        settings: more of the configuration's section ``init``

    Raises:
        InputError: a setting is unknown or wrong
    """
    return make_initial_mesh(
        _check("init", {"shape": shape, **settings}),
        scene.silhouettes,
        scene.cameras,
        trial_with(SoftRasFit()),
        progress,
        scene.frames,
    )


@checked
def fit(
    mesh: trimesh.Trimesh | Initial,
    scene: Scene,
    preset: str = "fast",
    *,
    progress: Share = untold,
    watch: Callable[[Record], None] = lambda record: None,
    **settings: Any,
) -> Fitted:
    """Fit a mesh to the silhouettes of a scene, by a differentiable renderer.

    Source: Liu et al., Soft Rasterizer (ICCV 2019); ``docs/fitting.md`` says what ``fast`` adds.

    Args:
        mesh: at unit size, closed; your own, or an initial mesh
        scene: from ``find_cameras``
        preset: ``fast``: ours; ``softras``: the report's procedure to the letter; or a function of
            your own
        progress: is told which share of the steps is done
        watch: is told the losses before each step
        settings: more of the configuration's section ``fit``
    Returns:
        ``.mesh`` and ``.cameras`` in the cameras' own world, ``.records`` of the losses, and
        ``.notes`` on views that did not count and on another start, which an initial mesh by
        ``hull`` or ``auto`` may get

    Raises:
        InputError: a setting is wrong, or the fit meets numbers that are not finite
    """
    chosen = _check("fit", {"preset": preset, **settings})

    def tell(record: Record) -> None:
        progress((record.iteration + 1) / chosen.iterations)
        watch(record)

    whole = mesh.mesh if isinstance(mesh, Initial) else take_mesh("mesh", mesh, UNIT)
    shape = mesh.notes["asked"] if isinstance(mesh, Initial) else ""
    return fit_robustly(whole, scene, chosen, shape, tell)


@checked
def refine(
    fitted: Fitted, scene: Scene, photographs: Photographs, *, progress: Share = untold
) -> Fitted:
    """Move a fitted surface to where the photographs agree, if some that are kept out confirm it.

    Args:
        scene: that it was fitted to
        photographs: that the scene was made of, read again at their own size
        progress: is told which share is done
    Returns:
        the same with another ``mesh``, or with the same; with ``relief``, what was found, and
        ``standing``, what each vertex stands on

    Raises:
        InputError: the fit is not of the preset ``fast``
    """
    _refuse_other_views(fitted, scene)
    if not isinstance(fitted.settings, FastFit):
        raise InputError(
            f"fitted: is of the preset {fitted.settings.preset!r}; photographs have a say only "
            "after 'fast'"
        )
    found = refine_by_photographs(
        fitted.mesh,
        fitted.cameras,
        scene,
        photographs.views,
        fitted.settings,
        fitted.notes,
        progress,
    )
    return replace(fitted, mesh=found.mesh, relief=found.notes, standing=found.standing)


@checked
def evaluate(
    fitted: Fitted,
    scene: Scene,
    initial: Initial | None = None,
    truth: trimesh.Trimesh | str | Path | None = None,
    texture: Baked | None = None,
) -> dict[str, Any]:
    """Measure a fitted mesh: the content of ``metrics.json``, described in ``docs/metrics.md``.

    Args:
        fitted: by ``fit``
        scene: that it was fitted to
        initial: of which the metrics say how it was made
        truth: the true mesh, or its file, in the frame of the cameras; the mesh is first registered
            with it if the cameras were found from the photographs
        texture: by ``bake``, of which the metrics say how well it shows photographs that were held
            out

    Raises:
        InputError: the truth cannot be read
    """
    known = _read_truth(truth)
    _refuse_other_views(fitted, scene)
    estimated = scene.notes["cameras"] not in ("turntable", FILE)
    return metrics.evaluate(
        fitted.mesh,
        fitted.cameras,
        scene,
        asdict(fitted.records[-1]),
        fitted.settings.sigma_at(scene.silhouettes.shape[-1]),
        fitted.settings.holdout,
        initial.notes if initial else None,
        fitted.notes,
        truth=known,
        align=estimated,
        relief=fitted.relief,
        texture=texture.notes if texture else None,
    )


@checked
def colour(fitted: Fitted, scene: Scene) -> trimesh.Trimesh:
    """The fitted mesh with a colour of each vertex, sRGB, from the photographs that see it."""
    _refuse_other_views(fitted, scene)
    mesh, cameras = fitted.mesh, fitted.cameras
    colours = colour_vertices(
        mesh.vertices,
        mesh.faces,
        cameras,
        Pictures(scene.images, cameras.views),
        scene.silhouettes,
    )
    return trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_colors=colours, process=False)


@checked
def bake(
    fitted: Fitted,
    scene: Scene,
    photographs: Photographs,
    size: str | int = "auto",
    *,
    progress: Share = untold,
) -> Baked:
    """The fitted mesh with a texture, from the photographs at their own size.

    Args:
        scene: that it was fitted to
        photographs: whose files are read again
        size: pixels of its side; ``auto`` is as large as the photographs tell apart
        progress: is told which share is done

    Raises:
        InputError: the size is none, or a photograph is not there any more or was changed
    """
    _refuse_other_views(fitted, scene)
    wanted = _check("texture", {"size": size})
    if not wanted.wanted:
        raise InputError("texture.size: 0 is no texture; silmesh.colour gives colours of vertices")
    baked = make_texture(
        fitted.mesh,
        fitted.cameras,
        photographs.views,
        scene.notes.get("lenses"),
        scene.silhouettes,
        wanted,
        fitted.settings.holdout,
        progress,
    )
    mesh = texture_mesh(baked.verts, baked.faces, baked.uv, baked.image)
    return Baked(mesh, baked.notes)


def _write(path: Path, mesh: trimesh.Trimesh, coloured: trimesh.Trimesh) -> None:
    """Write a mesh with its texture where the format has one, else with colours of its vertices."""
    kind = path.suffix.lower()
    if not has_texture(mesh) or kind not in (".glb", ".obj"):
        colours = np.asarray(coloured.visual.vertex_colors)[:, :3]
        write_coloured([path], coloured, colours)
    elif kind == ".glb":
        write_textured_glb(path, mesh, encode_png(mesh))
    else:
        try_companions(path)
        write_textured_obj(path, mesh, encode_png(mesh), *name_companions(path))


def _read_truth(truth: trimesh.Trimesh | str | Path | None) -> trimesh.Trimesh | None:
    """The true mesh, of its file if it is one's."""
    known = read_mesh(Path(truth)) if isinstance(truth, str | Path) else truth
    if known is not None:
        refuse_empty_mesh("truth", known)
    return known


def _refuse_other_views(fitted: Fitted, scene: Scene) -> None:
    """Refuse a scene that a mesh was not fitted to."""
    own, others = fitted.cameras.views, scene.cameras.views
    if own != others:
        raise InputError(
            f"scene: should have the {len(own)} views that were fitted ({name_some(own)}), not "
            f"{len(others)} ({name_some(others)})"
        )


class _SilhouetteSource:
    """Where silhouettes come from: the source, and the mask of each photograph or none.

    Args:
        files: the photographs
        masks: as a person gives them
        source: likewise
    """

    def __init__(self, files: Sequence[Path], masks: Paths | None, source: str | None):
        if source is not None:
            check_source(source)
        if masks is not None and source not in (None, "mask"):
            raise InputError(
                f"masks {masks}: silhouettes {source!r} take no masks; leave one of the two out"
            )
        wanted = source in (None, "mask")
        self.masks, self.notes = _find_masks(files, masks) if wanted else ([], [])
        where = str(files[0].parent)
        self.source = source or choose_silhouettes(look(files), self.masks, where)[0]
        if self.source == "mask" and not self.masks:
            raise InputError("masks: none are given, and none are found beside the photographs")
        if self.source == "mask":
            refuse_labels(self.masks)


def _find_masks(files: Sequence[Path], masks: Paths | None) -> tuple[list[Path], list[str]]:
    """The mask of each photograph, or none, and what is not used."""
    if masks is None or isinstance(masks, str | Path):
        return find_masks(files, Path(masks) if masks is not None else None)
    if not masks:
        raise InputError("masks: none are named; should be a folder, a glob or files")
    found, _ = match_masks(files, [Path(mask) for mask in masks])
    return found, []


def _find_files(
    photographs: Paths, besides: Sequence[str | Path], several: bool = False
) -> tuple[tuple[Path, ...], tuple[str, ...], TemporaryDirectory | None]:
    """The photographs, what is not used beside them, and the folder of a video's pictures."""
    one = isinstance(photographs, str | Path)
    paths, video = [Path(path) for path in ([photographs] if one else photographs)], None
    for path in paths:
        if not os.path.exists(path):  # also of a name that is too long
            raise InputError(f"{path}: is not there; should be a folder, photographs or a video")
    if not paths:
        raise InputError("photographs: none are named; should be a folder, files or a video")
    if len(paths) == 1 and is_video(paths[0]):
        from silmesh.intake.video import cut  # its libraries, for few

        video = TemporaryDirectory()
        paths = list(cut(paths[0], Path(video.name) / "frames"))
    files, notes = find_photographs(paths, [Path(path) for path in besides], several=several)
    return tuple(files), tuple(notes), video


def _read(
    files: tuple[Path, ...],
    notes: tuple[str, ...],
    video: TemporaryDirectory | None,
    settings: Mapping[str, Any],
    policy: str,
    fewest: int | None,
    progress: Share,
) -> Photographs:
    chosen = _check("views", settings)
    least = None if policy == "keep" else fewest
    made = dict(make_views(files, chosen.size, chosen.resize, least, progress))
    views = in_order(list(made), files)
    return Photographs(files, tuple(views), {v.view: made[v] for v in views}, notes, video)


def _find_silhouettes(
    photographs: Photographs,
    origin: _SilhouetteSource,
    policy: str,
    settings: Mapping[str, Any],
    progress: Share,
) -> Silhouettes:
    views = photographs.views
    found = find_each(
        origin.source,
        views,
        photographs.images,
        origin.masks,
        _prepare(origin.source, settings),
        policy != "keep",
        lambda done: progress(done / len(views)),
        torch.get_num_threads(),
    )
    return Silhouettes(found.silhouettes, found.spared, found.lost, origin.source, policy)


def _prepare(source: str, settings: Mapping[str, Any]) -> Any:
    """The settings of a network, whose weights are fetched if they can be; else none."""
    if source not in Networks.model_fields:
        return None
    chosen = _check(source, settings)
    if source == "matting" and chosen.model in FOREGROUND_MODELS:
        from silmesh.silhouettes.weights import fetch_weights

        fetch_weights(chosen.model)
    return chosen


@dataclass(frozen=True)
class _Search:
    """What cameras are found by."""

    photographs: Photographs
    found: Silhouettes
    turntable: str
    sets: str
    calibrate: Mapping[str, Any]
    colmap: Mapping[str, Any]
    progress: Share

    def attempt(self, source: CameraSource) -> tuple[list[Attempt], bool]:
        """Attempts at cameras from a source, and whether their world is normalised already."""
        views = self.photographs.views
        if isinstance(source, Cameras):
            return [_attempt_own(source, views)], False
        if str(source) not in SOURCES:
            from silmesh.cameras.formats import attempt_from_file

            located = locate(Path(str(source).removeprefix("file:")).expanduser())
            return [attempt_from_file(located.path, views)], located.kind == "softras"
        known = parse_turntable(self.turntable)
        if source == "turntable":
            return [self._turn(known)], True
        found = self._attempt_colmap() if source in ("colmap", "auto") else []
        return [*found, *([self._calibrate(known, found)] if source != "colmap" else [])], False

    def _turn(self, known: Any) -> Attempt:
        from silmesh.cameras.known import attempt_turntable

        if not known.complete:
            raise InputError(
                f"turntable {self.turntable!r}: lacks a number or names several rounds; should be "
                "distance,elevation,step, for example 2.732,0,5; cameras 'calibrate' finds what is "
                "not known"
            )
        if self.sets.strip():
            raise InputError(CLASH)
        views = self.photographs.views
        return attempt_turntable(views, known.distance, known.elevation, known.step)

    def _calibrate(self, known: Any, before: Sequence[Attempt]) -> Attempt:
        """By the silhouettes, unless attempts that were made before leave little to gain."""
        from silmesh.scene.calibrated_sets import SOURCE, calibrate_sets
        from silmesh.scene.sparing import spare_turntable

        views, files = self.photographs.views, self.photographs.files
        settings = _check("calibrate", self.calibrate)
        if not settings.always:
            said = bool(self.turntable.strip() or self.sets.strip())
            if spared := spare_turntable(SOURCE, before, len(views), named=said):
                return spared
        named = [view.view for view in views]
        return calibrate_sets(
            self.found.silhouettes,
            views,
            find_sets(self.sets, named, [file.parent.name for file in files]),
            self.photographs.images,
            step=known.step,
            elevation=known.elevation,
            distance=known.distance,
            rounds=known.rounds,
            above_table=settings.above_table,
            progress=self.progress,
        )

    def _attempt_colmap(self) -> list[Attempt]:
        from silmesh.scene.motion import attempt_colmap  # pycolmap, for those who want it

        with TemporaryDirectory() as scratch:
            return attempt_colmap(
                self.photographs.files,
                self.photographs.views,
                self.found.silhouettes,
                _check("colmap", self.colmap),
                torch.get_num_threads(),
                Path(scratch),
                self.progress,
                self.photographs.images,
            )


def _attempt_own(cameras: Cameras, views: Sequence[View]) -> Attempt:
    """Cameras that a person has in memory, as an attempt."""
    from silmesh.cameras.formats.assignment import Rules, match

    refuse_cameras(cameras)
    attempt = match(Path(OWN), cameras, views, Rules(working=True))
    figures = {**attempt.figures, "file": OWN, "cameras": len(cameras), "written": WORLD_TO_CAMERA}
    return replace(attempt, figures=figures)


def _judge(search: _Search, source: CameraSource, fewest: int) -> Scene:
    """The scene by one source of cameras, its outliers kept, dropped or repaired."""
    attempts, keep_world = search.attempt(source)
    found, shown = search.found, search.photographs
    made = build_scene(attempts, shown.views, found.silhouettes, keep_world, found.lost)
    undistorted = made.undistorted
    images = {v: undistorted.image(v, shown.images[v]) for v in made.scene.cameras.views}
    whole = replace(made.scene, images=images)
    return judge_scene(whole, found.policy, fewest, keep_world, search.progress).scene


def _tell(progress: Callable[[str, float], None], stage: str) -> Share:
    return lambda share: progress(stage, share)


def _check_sections(
    settings: Mapping[str, Mapping[str, Any]], named: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """All sections of the configuration: the settings, over those that have arguments' names."""
    for name in settings:
        if name not in SECTIONS:
            raise InputError(f"settings: {name!r} is no section; known are {', '.join(SECTIONS)}")
    return {name: {**named.get(name, {}), **settings.get(name, {})} for name in SECTIONS}


def _check(section: str, values: Mapping[str, Any]) -> Any:
    """A section of the configuration, its values checked and the others the defaults."""
    return check(SECTIONS[section], dict(values), section)


def _policy(source: str, quality: Mapping[str, Any]) -> tuple[str, int]:
    """What is done with outliers among the silhouettes of a source, and how many must be left."""
    chosen = _check("quality", quality)
    return chosen.policy_for(source), chosen.fewest
