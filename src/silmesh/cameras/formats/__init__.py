"""Cameras from files: one module a format, their list, and the cameras in the order of the views.

A reader gives the cameras as the file lists them, in our convention (``silmesh.geometry.camera``),
each by the name of its image; ``assignment`` finds the view of each.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from silmesh.cameras.attempt import (
    CAMERA_TO_WORLD,
    CAMERA_TO_WORLD_OPENGL,
    WORLD_TO_CAMERA,
    Attempt,
)
from silmesh.cameras.formats import (
    bundler,
    colmap_model,
    llff,
    mat,
    meshroom,
    metashape,
    middlebury,
    nerf,
    npz,
    realitycapture,
    texts,
)
from silmesh.cameras.formats.assignment import Rules, choose_world, match
from silmesh.cameras.locate import Located, locate
from silmesh.cameras.turntable import softras_cameras
from silmesh.cameras.unread import recognise_json
from silmesh.errors import InputError, reading, shorten
from silmesh.geometry.camera import LARGEST, Cameras, read_cameras
from silmesh.reading import read_json
from silmesh.views import View

Worlds = Cameras | Mapping[str, Cameras]  # of parts of a scene that nothing joins: by their names


class Format(NamedTuple):
    """A format: its name in messages, its reader, how its cameras belong to photographs, its poses.

    A pose is ``written`` from world to camera or the other way, with the axes of its camera.
    """

    name: str
    read: Callable[[Path, Sequence[View]], Worlds]
    rules: Rules = Rules()
    written: str = WORLD_TO_CAMERA


def _read_softras(path: Path, views: Sequence[View]) -> Cameras:
    return softras_cameras(path, [view.view for view in views], views[0].size)


FORMATS = {
    "colmap": Format("a COLMAP model", lambda path, views: colmap_model.read(path)),
    "meshroom": Format(
        "Meshroom's cameras.sfm",
        lambda path, views: meshroom.read(path),
        written=CAMERA_TO_WORLD,
    ),
    "nerf": Format("NeRF's transforms.json", nerf.read, written=CAMERA_TO_WORLD_OPENGL),
    "silmesh": Format(
        "silmesh's cameras.json",
        lambda path, views: read_cameras(path, mirrors=True),
        Rules(working=True),
    ),
    "texts": Format(
        "3x4 matrices in text files", lambda path, views: texts.read(path), Rules(signless=True)
    ),
    "mat": Format(
        "3x4 matrices in a .mat file",
        lambda path, views: mat.read(path),
        Rules(by_order=True, signless=True),
    ),
    "npz": Format("matrices of IDR or NeuS", npz.read, Rules(by_order=True, signless=True)),
    "middlebury": Format(
        "Middlebury's _par.txt", lambda path, views: middlebury.read(path), Rules(signless=True)
    ),
    "llff": Format(
        "LLFF's poses_bounds.npy", llff.read, Rules(by_order=True), written=CAMERA_TO_WORLD
    ),
    "metashape": Format("Metashape's cameras.xml", metashape.read, written=CAMERA_TO_WORLD),
    "bundler": Format("Bundler's .out", bundler.read),
    "realitycapture": Format("RealityCapture's .csv", realitycapture.read),
    "softras": Format("SoftRas's camera.npy", _read_softras, Rules(by_order=True, working=True)),
}

FOCAL = (1e-3, 1e9)  # pixels: a lens that sees anything has a focal length between these
WRITERS = {"colmap": colmap_model.write, "transforms": nerf.write}


def recognise(path: Path) -> tuple[Format, Located]:
    """The format of what a path holds, and where it lies.

    Raises:
        InputError: it holds no cameras that are known, or such as are not read
    """
    located = locate(path)
    kind = located.kind
    if kind == "json":
        content = read_json(located.path)
        if unread := recognise_json(content):
            raise InputError(f"{located.path}: {unread}")
        kind = (
            "meshroom"
            if meshroom.is_sfm(content)
            else "nerf"
            if nerf.is_transforms(content)
            else "silmesh"
        )
    return FORMATS[kind], located


def attempt_from_file(path: Path, views: Sequence[View]) -> Attempt:
    """Read cameras for these views, in pixels of the working images.

    Args:
        path: a file or a folder

    Raises:
        InputError: the format is unknown, the file cannot be used, or the cameras do not match the
            views
    """
    format_, located = recognise(path)
    with reading(located.path, format_.name):
        worlds = format_.read(located.path, views)
        if isinstance(worlds, Cameras):
            worlds = {located.path.name: worlds}
        for cameras in worlds.values():
            _refuse_extreme(located.path, cameras)
    cameras, warnings = choose_world(located.path, worlds, views)
    attempt = match(located.path, cameras, views, format_.rules)
    figures = {
        **attempt.figures,
        "format": format_.name,
        "file": str(located.path),
        "cameras": len(cameras),
        "written": format_.written,
    }
    return replace(attempt, figures=figures, warnings=(*warnings, *attempt.warnings))


def _refuse_extreme(path: Path, cameras: Cameras) -> None:
    """Refuse numbers that no camera has, with which nothing can be computed."""
    for name, K, t in zip(cameras.views, cameras.K, cameras.t, strict=True):
        where = f"{path}: camera {shorten(name)}"
        if not (FOCAL[0] < K[0, 0] < FOCAL[1] and FOCAL[0] < K[1, 1] < FOCAL[1]):
            raise InputError(
                f"{where}: its focal lengths, {K[0, 0]:g} and {K[1, 1]:g}, should be between "
                f"{FOCAL[0]:g} and {FOCAL[1]:g} pixels"
            )
        if not (K.abs().max() < LARGEST and t.abs().max() < LARGEST):
            raise InputError(
                f"{where}: K and t should be numbers up to {LARGEST:g}, not "
                f"{shorten(K.tolist())} and {shorten(t.tolist())}"
            )
