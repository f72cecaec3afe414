"""Silhouettes from mask files: the object is bright, and opaque if a mask has an alpha channel."""

from pathlib import Path

import numpy as np
from PIL import Image

from silmesh.errors import InputError
from silmesh.views import View, read_image


def find(image: Image.Image, view: View, mask: Path | None) -> np.ndarray:
    """Resize the mask as its photograph was, and take what is at least half as bright as it gets.

    So masks of 0 and 1, and the grey silhouettes that this package writes, are read as well.

    Raises:
        InputError: the mask cannot be read, or has another size than the photograph
    """
    drawn = read_image(mask)
    if drawn.size != (view.width, view.height):
        turned = drawn.size == (view.height, view.width)
        raise InputError(
            f"{mask}: is {drawn.width}x{drawn.height}, but its photograph {view.source} is "
            f"{view.width}x{view.height}; a mask should have its photograph's size"
            + ", turned upright as its EXIF orientation says"
            * turned
        )
    shown = Image.alpha_composite(Image.new("RGBA", drawn.size, "black"), drawn.convert("RGBA"))
    bright = np.asarray(view.place(shown.convert("L"), Image.Resampling.BILINEAR))
    return bright > bright.max() // 2
