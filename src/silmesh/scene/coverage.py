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
STRIP = 11  # the same around what is a few pixels thick
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
    coverage, told = _estimate(pixels, core, beyond, NEARBY)
    return np.where(free & ~core & ~beyond & told, coverage >= 0.5, region)


def undo_shaving(before: np.ndarray, after: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """What a region became, without the thin strips whose colours are those of where they were.

    A hull from wrong cameras lies a little beside the object. It cuts a strip off one side, and
    adds one to the other. A part is such a strip if most of it lies so close to the object and to
    the background, which are what both regions agree on, that its coverage can be told.

    Args:
        before, after: [height, width] bool
        pixels: [height, width, 3] uint8
    """
    core = ndimage.binary_erosion(before & after, AROUND)
    beyond = ~ndimage.binary_dilation(before | after, AROUND)
    coverage, told = _estimate(pixels, core, beyond, STRIP)
    parts, count = ndimage.label(before ^ after, AROUND)
    every = np.arange(count + 1)
    known = ndimage.mean(told, parts, every) > 0.5
    weight = np.maximum(ndimage.sum(told, parts, every), 1)
    covered = ndimage.sum(np.where(told, coverage, 0), parts, every) / weight >= 0.5
    undone = (known[parts] & (covered[parts] == before)) & (parts > 0)
    return np.where(undone, before, after)


def keep_outline(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """What a region became, its outline as it was where it moved by no more than a pixel.

    The outline of a region of which only a part is wrong is more exact than what colours show. A
    thin limb that was lost or won touches what both regions agree on only at its end, and counts.

    Args:
        before, after: [height, width] bool
    """
    changed = before ^ after
    beside = ndimage.binary_dilation(before & after, AROUND)
    moved_far = ndimage.binary_dilation(changed & ~beside, AROUND)
    return np.where(changed & ~moved_far, before, after)


def _estimate(
    pixels: np.ndarray, core: np.ndarray, beyond: np.ndarray, nearby: int
) -> tuple[np.ndarray, np.ndarray]:
    """The coverage by an object [height, width], and where it can be told.

    Args:
        core, beyond: [height, width] bool, what is the object's for sure, and the background's
        nearby: side of the square in which colours are averaged
    """
    within, object_there = _average(pixels, core, nearby)
    outside, ground_there = _average(pixels, beyond, nearby)
    across = within - outside
    square = (across**2).sum(axis=-1)
    coverage = ((pixels - outside) * across).sum(axis=-1) / np.maximum(square, 1)
    return coverage, object_there & ground_there & (square > APART**2)


def _average(pixels: np.ndarray, part: np.ndarray, nearby: int) -> tuple[np.ndarray, np.ndarray]:
    """The mean colour of the pixels of a part around each [height, width, 3], and where any are."""
    weight = ndimage.uniform_filter(part.astype(np.float32), nearby, mode="constant")
    shown = ndimage.uniform_filter(
        pixels * part[..., None].astype(np.float32), (nearby, nearby, 0), mode="constant"
    )
    there = weight > 0.5 / nearby**2
    return shown / np.where(there, weight, 1)[..., None], there
