"""A ``.npz`` file as IDR and NeuS have it: ``world_mat_<i>``, [4, 4], for each photograph.

Its first three rows are P = K [R | t] of the world of the file, whatever ``scale_mat_<i>`` takes
from a unit sphere to it: silmesh finds the object's place and size itself. DVR's files have just
[R | t] there, and ``camera_mat_<i>`` for K, in pixels or to [-1, 1]. Matrices belong to the
photographs in their order; pixel centres lie at integers, for these projects make their rays so.
"""

import math
import re
import zipfile
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np

from silmesh.cameras.formats.parsing import gather, numbers, to_half
from silmesh.cameras.formats.projection import cameras_of, decompose
from silmesh.errors import InputError, cut, reading, shorten
from silmesh.geometry.camera import Cameras
from silmesh.views import View

BARE = 1e-3  # by which the K of a world_mat that is [R | t] alone may differ from 1
NEEDED = r"(world|camera)_mat_\d+"  # names of what is read
LARGEST = 4096  # bytes of a matrix with its header
MOST = 20_000  # arrays
HEADERS = {  # readers of them by the version of a .npy file
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
NORMED = 20.0  # focal length in pixels below which a camera_mat is taken to lead to [-1, 1]


def read(path: Path, views: Sequence[View]) -> Cameras:
    """Cameras in the order of their numbers."""
    values = _load(path)
    numbered = sorted(
        (int(found[1]), name)
        for name in values
        if (found := re.fullmatch(r"world_mat_(\d+)", name))
    )
    if not numbered:
        raise InputError(
            f"{path}: should hold world_mat_0, world_mat_1, ..., holds "
            f"{cut(', '.join(sorted(values)[:4]), 200) or 'nothing'}"
        )
    matrices = []
    for position, (i, name) in enumerate(numbered):
        P = _rows(values[name], 4, f"{path}: {name}")
        if f"camera_mat_{i}" in values and _is_bare(P, f"{path}: {name}"):
            camera = _rows(values[f"camera_mat_{i}"], 3, f"{path}: camera_mat_{i}")
            P = _to_pixels(camera, views[min(position, len(views) - 1)]) @ P
        matrices.append(to_half(P))
    return gather(cameras_of(matrices, [name for _, name in numbered], path))


def _load(path: Path) -> dict[str, np.ndarray | None]:
    """The arrays by their names; None for those that are not needed, which are not unpacked."""
    with reading(path, "an .npz file"), zipfile.ZipFile(path) as archive:
        names = [name.removesuffix(".npy") for name in archive.namelist()]
        if len(set(names)) < len(names) or len(names) > MOST:
            raise ValueError(f"it has {len(names):,} arrays, or one twice")
        return {
            name: _read_matrix(archive, info) if re.fullmatch(NEEDED, name) else None
            for name, info in zip(names, archive.infolist(), strict=True)
        }


def _read_matrix(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    """An array that is as small as a matrix, by the archive's word and by its own."""
    if info.file_size > LARGEST:
        raise ValueError(f"{info.filename} has {info.file_size:,} bytes, too many for a matrix")
    with archive.open(info) as member:
        data = BytesIO(member.read(LARGEST))
    read_header = HEADERS[np.lib.format.read_magic(data)]
    shape, _, dtype = read_header(data, max_header_size=LARGEST)
    if math.prod(shape) * dtype.itemsize > LARGEST:
        raise ValueError(f"{info.filename} should be a matrix, not {shorten(list(shape))}")
    data.seek(0)
    return np.lib.format.read_array(data, allow_pickle=False, max_header_size=LARGEST)


def _rows(matrix: np.ndarray, columns: int, where: str) -> np.ndarray:
    """The first three rows, and this many columns, of a matrix [4, 4] or one of just that shape."""
    if matrix.shape == (4, 4):
        matrix = matrix[:3, :columns]
    return numbers(matrix, (3, columns), where)


def _is_bare(P: np.ndarray, where: str) -> bool:
    """Whether P is [R | t], without a K."""
    return bool(np.abs(decompose(P, where)[0] - np.eye(3)).max() < BARE)


def _to_pixels(K: np.ndarray, view: View) -> np.ndarray:
    """K in pixels with centres at integers; [-1, 1] reaches from the first centre to the last."""
    if abs(K[0, 0]) > NORMED:
        return K
    half = (np.array([view.width, view.height]) - 1) / 2
    return np.array([[half[0], 0, half[0]], [0, half[1], half[1]], [0, 0, 1]]) @ K
