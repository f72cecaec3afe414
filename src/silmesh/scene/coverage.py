"""Pixels on an outline, which show both sides: the object's are those that it covers by half.

The colour of such a pixel is a mixture, a F + (1 - a) B, of those on both sides. A model of the
object's colours, which are many, explains mixtures better than one of an even background does, so
that what a cut finds is too large by a part of a pixel. The coverage a is estimated from the mean
colours nearby, as in matting: a = (c - B).(F - B) / |F - B|^2.
"""

import numpy as np
from scipy import ndimage

AROUND = np.ones((3, 3), bool)
NEARBY = 7  # pixels: side of the square in which colours are averaged
APART = 24.0  # grey levels: sides that differ by less do not show the coverage


def settle_outline(region: np.ndarray, pixels: np.ndarray, free: np.ndarray) -> np.ndarray:
    """The region with its outline where half of a pixel is covered.

    Args:
        region: [height, width] bool
        pixels: [height, width, 3] uint8
        free: [height, width] bool, the pixels that may change
    """
    core = ndimage.binary_erosion(region, AROUND)
    beyond = ~ndimage.binary_dilation(region, AROUND)
    within, object_there = _average(pixels, core)
    outside, ground_there = _average(pixels, beyond)
    across = within - outside
    square = (across**2).sum(axis=-1)
    coverage = ((pixels - outside) * across).sum(axis=-1) / np.maximum(square, 1)
    told = free & ~core & ~beyond & object_there & ground_there & (square > APART**2)
    return np.where(told, coverage >= 0.5, region)


def _average(pixels: np.ndarray, part: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mean colour of the pixels of a part around each [height, width, 3], and where any are."""
    weight = ndimage.uniform_filter(part.astype(np.float32), NEARBY, mode="constant")
    shown = ndimage.uniform_filter(
        pixels * part[..., None].astype(np.float32), (NEARBY, NEARBY, 0), mode="constant"
    )
    there = weight > 0.5 / NEARBY**2
    return shown / np.where(there, weight, 1)[..., None], there
