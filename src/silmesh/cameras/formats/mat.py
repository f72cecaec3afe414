"""A ``.mat`` file with a cell array P of 3x4 projection matrices, as Oxford's dinosaur has it.

The matrices belong to the photographs in their order. Pixel centres are taken to lie at integers.
"""

from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from silmesh.cameras.camera import Cameras
from silmesh.cameras.formats.parts import gather, numbers, to_half
from silmesh.cameras.formats.projection import cameras_of
from silmesh.errors import InputError


def read(path: Path) -> Cameras:
    """Cameras in the order of the cells."""
    try:
        values = loadmat(path)
    except (OSError, ValueError, TypeError, NotImplementedError, MatReadError) as error:
        raise InputError(
            f"{path}: cannot be read as a .mat file up to version 7: {error}"
        ) from error
    if "P" not in values:
        named = ", ".join(name for name in values if not name.startswith("__")) or "nothing"
        raise InputError(f"{path}: should hold a cell array P of 3x4 matrices, holds {named}")
    cells = values["P"]
    if cells.dtype == object:
        cells = list(cells.ravel())
    elif cells.ndim == 3 and cells.shape[:2] == (3, 4):
        cells = list(np.moveaxis(cells, 2, 0))  # an array of 3 x 4 x views
    else:
        raise InputError(
            f"{path}: P should be a cell array of 3x4 matrices, not {list(cells.shape)} of "
            f"{cells.dtype}"
        )
    names = [f"P{{{i + 1}}}" for i in range(len(cells))]
    matrices = [
        to_half(numbers(cell, (3, 4), f"{path}: {name}"))
        for cell, name in zip(cells, names, strict=True)
    ]
    return gather(cameras_of(matrices, names, path))
