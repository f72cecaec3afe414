"""Cameras from files: one module a format, their list, and the cameras in the order of the views.

A reader gives the cameras as the file lists them, in our convention (``silmesh.cameras.camera``),
each by the name of its image; ``matching`` finds the view of each.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from silmesh.cameras.attempt import Attempt
from silmesh.cameras.camera import LARGEST, Cameras, read_cameras
from silmesh.cameras.formats import colmap, mat, meshroom, middlebury, nerf, npz, texts
from silmesh.cameras.formats.matching import Rules, match
from silmesh.cameras.formats.parts import read_json
from silmesh.cameras.locate import Located, locate
from silmesh.cameras.turntable import softras_cameras
from silmesh.errors import InputError, reading, shorten
from silmesh.views import View


class Format(NamedTuple):
    """A format: what messages call it, its reader, and how its cameras belong to photographs."""

    name: str
    read: Callable[[Path, Sequence[View]], Cameras]
    rules: Rules = Rules()


def _read_softras(path: Path, views: Sequence[View]) -> Cameras:
    return softras_cameras(path, [view.view for view in views], views[0].size)


FORMATS = {
    "colmap": Format("a COLMAP model", lambda path, views: colmap.read(path)),
    "meshroom": Format("Meshroom's cameras.sfm", lambda path, views: meshroom.read(path)),
    "nerf": Format("NeRF's transforms.json", nerf.read),
    "silmesh": Format(
        "silmesh's cameras.json", lambda path, views: read_cameras(path), Rules(working=True)
    ),
    "texts": Format("3x4 matrices in text files", lambda path, views: texts.read(path)),
    "mat": Format(
        "3x4 matrices in a .mat file", lambda path, views: mat.read(path), Rules(by_order=True)
    ),
    "npz": Format("matrices of IDR or NeuS", npz.read, Rules(by_order=True)),
    "middlebury": Format("Middlebury's _par.txt", lambda path, views: middlebury.read(path)),
    "softras": Format("SoftRas's camera.npy", _read_softras, Rules(by_order=True, working=True)),
}

FOCAL = (1e-3, 1e9)  # pixels: a lens that sees anything has a focal length between these
WRITERS = {"colmap": colmap.write, "transforms": nerf.write}


def recognise(path: Path) -> tuple[Format, Located]:
    """The format of what a path holds, and where it lies.

    Raises:
        InputError: it holds no cameras that are known
    """
    located = locate(path)
    kind = located.kind
    if kind == "json":
        content = read_json(located.path)
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
        cameras = format_.read(located.path, views)
        _refuse_extreme(located.path, cameras)
    attempt = match(located.path, cameras, views, format_.rules)
    figures = {"format": format_.name, "file": str(located.path), "cameras": len(cameras)}
    return replace(attempt, figures=figures)


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
