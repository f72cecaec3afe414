"""Meshroom's ``cameras.sfm``: JSON of views, intrinsics and poses, all values strings.

Conventions, by AliceVision's reader and its compatibility data (``sfmDataIO``):

    pose        ``rotation`` lists the rotation from world to camera by columns, which by rows is
                the one from camera to world; ``center`` is where the camera stands; axes as ours
    principal   from the top left in pixels before version 1.2.1, from the image's middle since
    focal       ``pxFocalLength`` before 1.2 (one) and 1.2.2 (two); since then ``focalLength`` in
                units of ``sensorWidth``, of x, and since 1.2.11 of y, with ``pixelRatio`` fy / fx,
                which before 1.2.5 was fx / fy
    distortion  the ``type`` of the intrinsics before 1.2.8, ``distortionType`` since
    pixels      centres at integers: its undistortion samples pixel (i, j) at (i, j)
"""

from collections.abc import Mapping
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np

from silmesh.cameras.formats.parsing import (
    Camera,
    gather,
    intrinsics,
    nearest_rotation,
    numbers,
    pixels,
    to_half,
)
from silmesh.errors import InputError, blaming, cut, shorten
from silmesh.geometry.camera import Cameras, refuse_many
from silmesh.geometry.lens import Lens, lens_of
from silmesh.reading import read_json

Version = tuple[int, ...]
Row = Mapping[str, Any]
LENSES = {  # by its older and its newer name: our model, and where each of its parameters stands
    **dict.fromkeys(("pinhole", "none", ""), ("PINHOLE", ())),
    **dict.fromkeys(("radial1", "radialk1"), ("SIMPLE_RADIAL", (0,))),
    **dict.fromkeys(
        ("radial3", "radialk3", "radialk3pt"),
        ("FULL_OPENCV", (0, 1, None, None, 2, None, None, None)),
    ),
    "brown": ("FULL_OPENCV", (0, 1, 3, 4, 2, None, None, None)),
    **dict.fromkeys(("fisheye4", "fisheye"), ("OPENCV_FISHEYE", (0, 1, 2, 3))),
    "fisheye1": ("FOV", (0,)),
}


def is_sfm(content: Any) -> bool:
    """Whether this is what a ``.sfm`` file holds."""
    return isinstance(content, dict) and {"views", "intrinsics"} <= set(content)


def read(path: Path) -> Cameras:
    """Cameras of the views that have a pose, by the names of their images."""
    content = read_json(path)
    if not is_sfm(content):
        raise InputError(f"{path}: should hold 'views', 'intrinsics' and 'poses'")
    version = _parse_version(content.get("version"), path)
    lenses = _by_id(content["intrinsics"], "intrinsicId", path)
    poses = _by_id(content.get("poses") or [], "poseId", path)
    views = _by_id(content["views"], "viewId", path).values()
    views = [view for view in views if _id(view, "poseId") in poses]
    if not views:
        raise InputError(
            f"{path}: none of its {len(content['views'])} views has a pose; should be the "
            "cameras.sfm that Meshroom's StructureFromMotion leaves"
        )
    refuse_many(path, len(views))
    return gather([_parse(view, lenses, poses, version, path) for view in views])


def _parse_version(value: Any, path: Path) -> Version:
    """As a tuple; files before 1.2 need not say it."""
    return tuple(numbers(value or [1, 0, 0], (3,), f"{path}: version").astype(int).tolist())


def _by_id(rows: Any, key: str, path: Path) -> dict[str, Row]:
    if not isinstance(rows, list) or not all(isinstance(row, dict) and key in row for row in rows):
        raise InputError(f"{path}: should hold a list of objects with {key!r}")
    by_id = {_id(row, key): row for row in rows}
    if len(by_id) < len(rows):
        raise InputError(f"{path}: each {key!r} should be a name or a number of its own")
    return by_id


def _id(row: Row, key: str) -> str:
    """An identifier, which is a string or a number; any other value is found nowhere."""
    return str(row[key]) if isinstance(row.get(key), str | int) else ""


def _parse(
    view: Row, lenses: Mapping[str, Row], poses: Mapping[str, Row], version: Version, path: Path
) -> Camera:
    name = str(view.get("path", ""))
    where = f"{path}: view {cut(PureWindowsPath(name).name, 80)}"  # of any system
    if str(view.get("isPoseIndependant", "true")).lower() in ("false", "0"):
        raise InputError(f"{where}: is part of a rig of cameras, which cannot be read")
    lens = lenses.get(_id(view, "intrinsicId"))
    if lens is None:
        raise InputError(
            f"{where}: its intrinsics {cut(str(view.get('intrinsicId')), 80)} are not in the file"
        )
    size, K, lens = _parse_intrinsics(lens, version, where)
    transform = _within(_within(poses[_id(view, "poseId")], "pose", where), "transform", where)
    rotation = numbers(transform.get("rotation"), (9,), f"{where}: rotation")
    centre = numbers(transform.get("center"), (3,), f"{where}: center")
    R = nearest_rotation(rotation.reshape(3, 3).T, where)
    return Camera(name, size, to_half(K), R, -R @ centre, lens)


def _within(row: Row, key: str, where: str) -> Row:
    """An object within an object."""
    if not isinstance(inside := row.get(key), dict):
        raise InputError(f"{where}: should have an object {key!r}, not {shorten(inside)}")
    return inside


def _parse_intrinsics(
    row: Row, version: Version, where: str
) -> tuple[tuple[int, int], np.ndarray, Lens | None]:
    """Size, K with pixel centres at integers, lens."""
    width, height = pixels(row.get("width"), row.get("height"), where)
    centre = numbers(row.get("principalPoint"), (2,), f"{where}: principalPoint")
    if version >= (1, 2, 1):
        centre += (width / 2, height / 2)
    K = intrinsics(_parse_focal(row, width, version, where), tuple(centre), where)
    kind = str(row.get("type", "pinhole")).lower()
    if version >= (1, 2, 8) and kind == "pinhole":
        kind = str(row.get("distortionType", "none")).lower()
    _refuse_strange(row, kind, where)
    if kind not in LENSES:
        raise InputError(
            f"{where}: the lens {shorten(kind)} cannot be read; known are "
            f"{', '.join(filter(None, LENSES))}. Other ones are undistorted by Meshroom's "
            "ImageProcessing or PrepareDenseScene, whose images and cameras can be read"
        )
    model, indices = LENSES[kind]
    values = row.get("distortionParams") or []
    if not isinstance(values, list):
        raise InputError(f"{where}: distortionParams should be a list, not {shorten(values)}")
    values = numbers(values, (len(values),), f"{where}: distortionParams").tolist()
    if len(values) <= max((p for p in indices if p is not None), default=-1):
        values = [0.0] * 5  # a lens that was never estimated
    with blaming(where):
        lens = lens_of(model, [0.0 if p is None else values[p] for p in indices])
    if kind == "radialk3pt":  # scaled to keep the point at radius 1 in its place
        if not (scale := 1 + sum(values[:3])) > 0:
            raise InputError(f"{where}: a lens of {values[:3]} folds the image over")
        K = K @ np.diag([1 / scale] * 2 + [1])
    return (width, height), K, lens


def _refuse_strange(row: Row, kind: str, where: str) -> None:
    """Refuse more of a lens than its kind has: other terms, or an undistortion beside it."""
    values = row.get("distortionParams")
    indices = LENSES.get(kind, ("", ()))[1]
    terms = 1 + max((index for index in indices if index is not None), default=-1)
    extra = values[terms:] if isinstance(values, list) and kind in LENSES else []
    other = str(row.get("undistortionType") or "none").lower()
    if other != "none" or any(_says_something(value) for value in extra):
        what = f"an undistortion {other!r}" if other != "none" else f"terms {extra[:8]}"
        raise InputError(
            f"{where}: its lens {kind!r} has {what} beside, which cannot be read; give the images "
            "and cameras of Meshroom's ImageProcessing or PrepareDenseScene"
        )


def _says_something(value: Any) -> bool:
    try:
        return float(value) != 0
    except (TypeError, ValueError, OverflowError):
        return True


def _parse_focal(row: Row, width: int, version: Version, where: str) -> tuple[float, float]:
    """In pixels, of x and y."""
    if version < (1, 2, 2):
        value = row.get("pxFocalLength")
        count = 2 if isinstance(value, list) else 1
        given = numbers(value if count == 2 else [value], (count,), f"{where}: pxFocalLength")
        return float(given[0]), float(given[-1])
    length, sensor, ratio = (
        float(numbers(row.get(key, default), (), f"{where}: {key}"))
        for key, default in (("focalLength", None), ("sensorWidth", 36), ("pixelRatio", 1))
    )
    if not (sensor > 0 and ratio > 0):
        raise InputError(
            f"{where}: sensorWidth and pixelRatio should be above 0, not {sensor:g} and {ratio:g}"
        )
    focal = length / sensor * width
    if version >= (1, 2, 11):
        return focal / ratio, focal
    return focal, focal * ratio if version >= (1, 2, 5) else focal / ratio
