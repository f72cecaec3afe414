"""LLFF's ``poses_bounds.npy``: [views, 17] numbers, 15 of a camera and the range of its depths.

The 15 are a matrix [3, 5] by rows, whose columns are the camera's axes down, right and back in the
world, its place, and (height, width, focal length) in pixels, with the principal point in the
middle. The cameras are those of the photographs sorted by name as a program sorts, so that
``img_10`` comes before ``img_2``. LLFF takes them from COLMAP: pixel centres at integer + 0.5.

https://github.com/Fyusion/LLFF
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from silmesh.cameras.formats.parsing import Camera, gather, intrinsics, nearest_rotation, numbers
from silmesh.cameras.locate import LLFF
from silmesh.errors import InputError
from silmesh.geometry.camera import WIDEST, Cameras
from silmesh.reading import open_array
from silmesh.views import View


def read(path: Path, views: Sequence[View]) -> Cameras:
    """Cameras in the order of the views, of which there is one each."""
    rows = _load(path)
    if len(rows) != len(views):
        raise InputError(
            f"{path}: has {len(rows)} cameras, but there are {len(views)} photographs; the format "
            "has no names, so there should be a camera for each photograph, sorted by name. Give "
            "the photographs that it was made from, or the COLMAP model (sparse/0) beside it"
        )
    order = sorted(range(len(views)), key=lambda i: Path(views[i].source).name)
    cameras = {i: _parse(rows[n], views[i].view, f"{path}: row {n}") for n, i in enumerate(order)}
    return gather([cameras[i] for i in range(len(views))])


def _load(path: Path) -> np.ndarray:
    """[views, 17] finite numbers."""
    rows = open_array(path)
    if rows.ndim != 2 or rows.shape[1] != LLFF or rows.dtype.kind not in "iuf" or not len(rows):
        raise InputError(
            f"{path}: should hold [views, {LLFF}] numbers, not {list(rows.shape)} of {rows.dtype}"
        )
    return rows


def _parse(row: np.ndarray, name: str, where: str) -> Camera:
    pose = numbers(row[:15], (15,), where).reshape(3, 5)
    down, right, back, centre, (height, width, focal) = pose.T
    if not (1 <= width <= WIDEST and 1 <= height <= WIDEST):
        raise InputError(
            f"{where}: height and width should be pixels, not {height:g} and {width:g}"
        )
    R = nearest_rotation(np.stack([right, down, -back]), where)
    K = intrinsics((focal, focal), (width / 2, height / 2), where)
    return Camera(name, (round(width), round(height)), K, R, -R @ centre)
