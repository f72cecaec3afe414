"""Bundler's ``.out`` file: a focal length, two radial terms, R and t a camera, then points.

    # Bundle file v0.3
    <cameras> <points>
    <f> <k1> <k2>
    <R, three rows>
    <t>

A point is at P = R X + t with x right, y up and the camera looking along -z, so R and t are ours
times diag(1, -1, -1); its pixel is f (1 + k1 r^2 + k2 r^4) (-P_xy / P_z), r = |P_xy / P_z|, from
the image's middle. A focal length of 0, or an R of zeros, says that there is no camera. Names are
those of the list of photographs that Bundler is given, ``list.txt``: one a line, before its other
words.

https://www.cs.cornell.edu/~snavely/bundler/bundler-v0.4-manual.html
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from silmesh.cameras.formats.assignment import Sizes
from silmesh.cameras.formats.parsing import (
    UNSAID,
    Camera,
    gather,
    intrinsics,
    nearest_rotation,
    numbers,
    read_lines,
)
from silmesh.cameras.locate import find_lists
from silmesh.errors import InputError
from silmesh.geometry.camera import OPENGL, Cameras
from silmesh.geometry.lens import lens_of
from silmesh.views import View

HEADER = "# Bundle file"
LINES = 5  # of a camera


def read(path: Path, views: Sequence[View]) -> Cameras:
    """Cameras by the names in the list; the views say the size whose middle the pixels are from."""
    rows = [line for line in read_lines(path) if line.strip()]
    if not rows or not rows[0].startswith(HEADER):
        raise InputError(f"{path}: should begin with '{HEADER} v0.3'")
    count = _parse_count(rows, path)
    names = _read_names(path, count)
    cameras, sizes = [], Sizes(views)
    for i, name in enumerate(names):
        lines = rows[2 + LINES * i : 2 + LINES * (i + 1)]
        values = numbers([line.split() for line in lines], (LINES, 3), f"{path}: camera {i}")
        if values[0, 0] != 0 and values[1:4].any():
            cameras.append(_parse(values, name, sizes, f"{path}: camera {i} ({name})"))
    if not cameras:
        raise InputError(f"{path}: none of its {count} cameras was found: all focal lengths are 0")
    return gather(cameras)


def _parse_count(rows: Sequence[str], path: Path) -> int:
    words = rows[1].split() if len(rows) > 1 else []
    if len(words) != 2 or not all(word.isdecimal() and len(word) < 10 for word in words):
        raise InputError(
            f"{path}: its second line should be the numbers of cameras and points, not "
            f"{' '.join(words)[:80]!r}"
        )
    count = int(words[0])
    if len(rows) < 2 + LINES * count:
        raise InputError(
            f"{path}: should hold {LINES} lines for each of {count} cameras, as its second line "
            f"says; it has {len(rows) - 2}"
        )
    return count


def _read_names(path: Path, count: int) -> list[str]:
    """The photographs' names, in the cameras' order."""
    lists = find_lists(path)
    if not lists:
        raise InputError(
            f"{path}: has no names; beside it should lie list.txt, the list of photographs that "
            "the program wrote or was given: one name a line, in the order of its cameras"
        )
    names = [_parse_name(line) for line in read_lines(lists[0]) if line.strip()]
    if len(names) != count:
        raise InputError(
            f"{path}: has {count} cameras, but its list {lists[0]} names {len(names)} photographs"
        )
    return names


def _parse_name(line: str) -> str:
    """A line's name, which may have spaces, without ``0 <focal length>`` after it."""
    words = line.strip().rsplit(maxsplit=2)
    if len(words) == 3 and words[1] == "0" and words[2].replace(".", "", 1).isdecimal():
        return words[0]
    return line.strip()


def _parse(values: np.ndarray, name: str, sizes: Sizes, where: str) -> Camera:
    focal, *radial = values[0].tolist()
    width, height = sizes.of(name)
    K = intrinsics((focal, focal), (width / 2, height / 2), where)
    R = OPENGL @ nearest_rotation(values[1:4], where)
    return Camera(name, UNSAID, K, R, OPENGL @ values[4], lens_of("RADIAL", radial))
