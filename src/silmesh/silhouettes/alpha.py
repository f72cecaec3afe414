"""Silhouettes from the photographs' own alpha channel."""

from pathlib import Path

import numpy as np
from PIL import Image

from silmesh.errors import InputError
from silmesh.views import View


def find(image: Image.Image, view: View, mask: Path | None) -> np.ndarray:
    """Take what is at least half opaque.

    Raises:
        InputError: the photograph has no alpha channel
    """
    if image.mode != "RGBA":
        raise InputError(
            f"{view.source}: has no alpha channel; silhouettes 'alpha' needs one, "
            "'mask' takes mask files and 'threshold' a plain background"
        )
    return np.asarray(image.getchannel("A")) > 127
