"""Silhouettes by a function of a person's own: ``function(photograph)`` for each photograph.

It is given the photograph as its file has it, upright, [height, width, 3] uint8 in sRGB, and gives
[height, width] bool: which pixels show the object. The file is run once for all photographs, so
what it loads, a network's weights for example, is loaded once.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from PIL import Image

from silmesh.errors import InputError
from silmesh.own_code import ask, load
from silmesh.views import View, read_photograph


def find_all(views: Sequence[View], source: str) -> Iterator[np.ndarray]:
    """The silhouette of each view in turn, [size, size] bool.

    Args:
        source: ``path/to/file.py:function``

    Raises:
        InputError: a photograph cannot be read, or the function fails or gives something else
    """
    find = load(source)
    for view in views:
        photograph = np.array(read_photograph(view).convert("RGB"))
        size = photograph.shape[:2]
        found = ask(source, find, photograph)
        _refuse_other(f"{source}: of {view.source}", found, size)
        drawn = Image.fromarray(np.where(found, 255, 0).astype(np.uint8))
        yield np.asarray(view.into_square(drawn, Image.Resampling.BILINEAR)) > 127


def _refuse_other(where: str, found: Any, size: tuple[int, int]) -> None:
    if not isinstance(found, np.ndarray):
        gives = type(found).__name__
    elif found.dtype != bool or found.shape != size:
        gives = f"{found.dtype} {list(found.shape)}"
    else:
        return
    raise InputError(
        f"{where}: gives {gives}; should give a numpy array, bool {list(size)}, true on the object"
    )
