"""Middlebury's ``_par.txt``: ``name k11 k12 ... k33 r11 ... r33 t1 t2 t3`` a line, after a count.

P = K [R | t] in pixels whose centres lie at integers from the top left (Seitz et al. 2006). It is
taken as any P is: where K has negative focal lengths, other axes of the camera are the same.
"""

import re
from pathlib import Path

import numpy as np

from silmesh.cameras.formats.parsing import (
    UNSAID,
    Camera,
    gather,
    nearest_rotation,
    numbers,
    read_lines,
    to_half,
)
from silmesh.cameras.formats.projection import decompose
from silmesh.errors import InputError, cut, shorten
from silmesh.geometry.camera import Cameras


def read(path: Path) -> Cameras:
    """Cameras by the names of their images."""
    rows = [line.split() for line in read_lines(path) if line.strip()]
    if not rows or len(rows[0]) != 1 or not re.fullmatch("[0-9]{1,9}", rows[0][0]):
        raise InputError(f"{path}: should begin with a line that says how many cameras follow")
    if len(rows) - 1 != int(rows[0][0]):
        raise InputError(
            f"{path}: should hold {rows[0][0]} cameras, as its first line says, not {len(rows) - 1}"
        )
    return gather([_parse(row, f"{path}: camera {i}") for i, row in enumerate(rows[1:])])


def _parse(row: list[str], where: str) -> Camera:
    name, where = row[0], f"{where} ({cut(row[0], 80)})"
    values = numbers(row[1:], (21,), f"{where}: K, R and t")
    K, R, t = values[:9].reshape(3, 3), values[9:18].reshape(3, 3), values[18:]
    if np.abs([K[1, 0], *K[2, :2]]).max() > 0 or K[2, 2] == 0:
        raise InputError(f"{where}: K should be upper triangular, not {shorten(K.tolist())}")
    K, R, t = decompose(K @ np.c_[nearest_rotation(R, where), t], where)
    return Camera(name, UNSAID, to_half(K), R, t)
