"""Objects cut out of their photographs: colour and coverage, without the old background's edge."""

from pathlib import Path

import numpy as np
import torch
from PIL import Image
from scipy import ndimage
from torch import Tensor

from silmesh.errors import InputError
from silmesh.geometry.frame import find_box
from silmesh.views import read_image

RIM = 1  # pixels inside the mask's edge whose colour may be mixed with the old background's
SOFT = 0.7  # pixels by which the mask's steps are smoothed


def read_cutout(photograph: Path, mask: Path, size: int) -> Tensor:
    """Cut an object out of its photograph.

    Args:
        photograph, mask: files of the same size; the mask is white on the object
        size: bounds the longer side of what is kept, in pixels
    Returns:
        [4, height, width] uint8: red, green, blue and coverage, within the object's bounding box
        and two pixels around it

    Raises:
        InputError: one cannot be read, their sizes differ, or the mask is empty
    """
    image, drawn = read_image(photograph).convert("RGB"), read_image(mask).convert("L")
    if image.size != drawn.size:
        raise InputError(
            f"{mask}: is {drawn.width}x{drawn.height}, but its photograph {photograph} is "
            f"{image.width}x{image.height}; a mask should have its photograph's size"
        )
    shown = np.asarray(drawn)
    inside = shown > shown.max() // 2
    if not inside.any():
        raise InputError(f"{mask}: is empty; the object should be white in it")
    box = _bounding_box(inside)
    return cut_out(np.asarray(image)[box], inside[box], size)


def cut_out(pixels: np.ndarray, inside: np.ndarray, size: int) -> Tensor:
    """Colour and coverage of an object, [4, height, width] uint8, its longer side at most ``size``.

    Its own colours are drawn outwards over the edge, so that no background shines through there.

    Args:
        pixels: [height, width, 3] uint8
        inside: [height, width] bool
    """
    colours = Image.fromarray(_spread_colours(pixels, inside))
    soft = ndimage.gaussian_filter(inside.astype(np.float32), SOFT)
    coverage = Image.fromarray(np.round(255 * soft).astype(np.uint8))
    scale = min(1, size / max(colours.size))
    extent = [max(1, round(side * scale)) for side in colours.size]
    rgba = [np.asarray(part.resize(extent, Image.Resampling.BOX)) for part in (colours, coverage)]
    return torch.from_numpy(np.moveaxis(np.dstack(rgba), -1, 0).copy())


def _spread_colours(pixels: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The pixels, each outside and on the rim replaced by the nearest of the object's core."""
    core = ndimage.binary_erosion(inside, iterations=RIM, border_value=1)
    if not core.any():
        core = inside
    rows, columns = ndimage.distance_transform_edt(
        ~core, return_distances=False, return_indices=True
    )
    return pixels[rows, columns]


def _bounding_box(inside: np.ndarray, margin: int = 2) -> tuple[slice, slice]:
    left, top, right, bottom = find_box(inside)
    return (
        slice(max(top - margin, 0), bottom + margin),
        slice(max(left - margin, 0), right + margin),
    )
