"""A folder of text files with a 3x4 projection matrix each, named as the photographs are.

Each file holds 12 numbers by rows, with depth (u, v, 1) = P (X, 1), perhaps after a line CONTOUR
(PMVS); a fourth row 0 0 0 1 is let pass. Pixel centres are taken to lie at integer + 0.5, since the
bunny's visual hull agrees better with its masks so than for centres at integers (docs/cameras.md).
"""

from pathlib import Path

import numpy as np

from silmesh.cameras.formats.parsing import gather, read_lines
from silmesh.cameras.formats.projection import cameras_of
from silmesh.errors import InputError, explain
from silmesh.geometry.camera import Cameras


def read(folder: Path) -> Cameras:
    """Cameras by the stems of the folder's ``.txt`` files."""
    files = sorted(file for file in folder.iterdir() if file.suffix.lower() == ".txt")
    return gather(cameras_of([_read_matrix(f) for f in files], [f.stem for f in files], folder))


def _read_matrix(file: Path) -> np.ndarray:
    """P [3, 4]."""
    words = " ".join(read_lines(file)).replace(",", " ").split()
    words = words[1:] if words[:1] == ["CONTOUR"] else words
    if len(words) > 16:
        raise InputError(f"{file}: should hold the 12 numbers of a 3x4 matrix, not {len(words)}")
    try:
        values = np.array(words, np.float64)
    except ValueError as error:
        raise InputError(
            f"{file}: should hold the numbers of a 3x4 matrix: {explain(error)}"
        ) from error
    if len(values) == 16 and (values[12:] == [0, 0, 0, 1]).all():
        values = values[:12]
    if len(values) != 12:
        raise InputError(f"{file}: should hold the 12 numbers of a 3x4 matrix, not {len(values)}")
    return values.reshape(3, 4)
