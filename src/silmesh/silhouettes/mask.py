"""Silhouettes from mask files: white is the object."""

from pathlib import Path

import numpy as np
from PIL import Image

from silmesh.errors import InputError
from silmesh.views import View, read_image


def find(image: Image.Image, view: View, mask: Path | None) -> np.ndarray:
    """Resize the mask as its photograph was, and take what is at least half white.

    Raises:
        InputError: the mask cannot be read, or has another size than the photograph
    """
    white = read_image(mask).convert("L")
    if white.size != (view.width, view.height):
        raise InputError(
            f"{mask}: is {white.width}x{white.height}, but its photograph {view.source} is "
            f"{view.width}x{view.height}; a mask should have its photograph's size"
        )
    return np.asarray(view.place(white, Image.Resampling.BILINEAR)) > 127
