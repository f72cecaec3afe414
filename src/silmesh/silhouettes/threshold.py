"""Silhouettes on a plain background, by a threshold that finds its own level from the border."""

from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage
from skimage.filters import threshold_otsu

from silmesh.views import View

SPECK = 0.02  # of the object's area: smaller pieces are dropped and smaller holes filled


def find(image: Image.Image, view: View, mask: Path | None) -> np.ndarray:
    """Take the pixels that differ from the border's colour by more than the border itself does."""
    silhouette = np.zeros((view.size, view.size), bool)
    inside = (slice(view.top, view.bottom), slice(view.left, view.right))
    silhouette[inside] = separate(np.asarray(image.convert("RGB"))[inside])
    return silhouette


def separate(pixels: np.ndarray) -> np.ndarray:
    """Separate an object from a plain background.

    The background's colour is the median of the border. A pixel's contrast is its largest
    difference from that over the channels. The level is Otsu's between the background and the
    object's darkest part, found by applying Otsu's twice (the first split may run through the
    object, between its light and its dark side), and never below what the border itself shows.

    Args:
        pixels: [height, width, 3] uint8
    Returns:
        [height, width] bool
    """
    values = pixels.astype(np.int16)
    edge = np.concatenate([values[0], values[-1], values[:, 0], values[:, -1]])
    ground = np.median(edge, axis=0)
    contrast = np.abs(values - ground).max(axis=-1)
    noise = np.percentile(np.abs(edge - ground).max(axis=-1), 90)
    level = max(_level(contrast), 2 * noise, 4)
    return _clean(contrast > level)


def _level(contrast: np.ndarray) -> float:
    """Otsu's level, or the lower one of its dark side if that side has two parts itself."""
    if contrast.max() == contrast.min():
        return float(contrast.max())
    first = threshold_otsu(contrast)
    dark = contrast[contrast <= first]
    return float(threshold_otsu(dark)) if dark.max() > dark.min() else float(first)


def _clean(silhouette: np.ndarray) -> np.ndarray:
    """Drop specks and fill pinholes, both judged by the object's area."""
    if not silhouette.any():
        return silhouette
    pieces, areas = _pieces(silhouette)
    least = SPECK * areas.max()
    kept = (areas >= least)[pieces]
    holes, areas = _pieces(~kept)
    return ~(areas >= least)[holes]


def _pieces(region: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The number of each pixel's connected piece, and the pieces' areas, 0 for what is outside."""
    pieces, _ = ndimage.label(region)
    areas = np.bincount(pieces.ravel())
    areas[0] = 0
    return pieces, areas
