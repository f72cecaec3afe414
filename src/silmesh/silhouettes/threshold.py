"""Silhouettes on a plain background, by a threshold that finds its own level from the border."""

from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage
from skimage.filters import threshold_otsu

from silmesh.silhouettes.shadow import find_shadow, may_have_shadow
from silmesh.views import View, read_photograph

BORDER = 0.02  # width of the border that is taken for background, over the shorter side
ROUNDS = 8  # iterations of the fit of the background, each without the outliers of the one before
CLOSE = 256  # pixels of the longer side: in a smaller picture a soft edge looks like a step
SPECK = 0.02  # of the object's area: smaller pieces are dropped, and smaller holes are filled


def find(image: Image.Image, view: View, mask: Path | None) -> np.ndarray:
    """Take the pixels that differ from the border's colour by more than the border itself does.

    The object's shadow on a plain ground is left out, as far as it can be recognised.
    """
    silhouette = np.zeros((view.size, view.size), bool)
    inside = (slice(view.top, view.bottom), slice(view.left, view.right))
    pixels = np.asarray(image.convert("RGB"))[inside]
    silhouette[inside] = _drop_shadow(*_split(pixels), pixels, view)
    return silhouette


def _drop_shadow(
    found: np.ndarray, ground: np.ndarray, pixels: np.ndarray, view: View
) -> np.ndarray:
    """A silhouette without its shadow, which is looked for in no smaller a picture than CLOSE."""
    if not may_have_shadow(pixels, ground, found):
        return found
    if max(found.shape) >= CLOSE:
        shadow = find_shadow(pixels, ground, found)
    else:
        photograph = read_photograph(view, (CLOSE, CLOSE)).convert("RGB")
        photograph.thumbnail((CLOSE, CLOSE))
        closer = np.asarray(photograph)
        larger, behind = _split(closer)
        shadow = Image.fromarray(find_shadow(closer, behind, larger))
        shadow = shadow.convert("L").resize(found.shape[::-1], Image.Resampling.BOX)
        shadow = np.asarray(shadow) > 127
    kept = found & ~shadow
    return _clean(kept, kept) if shadow.any() else found


def separate(pixels: np.ndarray) -> np.ndarray:
    """Separate an object from a plain background.

    The background is a polynomial of second order in the position, for uneven light, fitted to the
    border. A pixel's contrast is its largest difference from that over the channels. The level is
    Otsu's between the background and the object's darkest part, found by applying Otsu's twice (the
    first split may run through the object, between its light and its dark side), and never below
    what the border itself shows. A hole in which most pixels still differ from the background by
    more than the border does is a part as dark as that, and filled.

    Args:
        pixels: [height, width, 3] uint8
    Returns:
        [height, width] bool
    """
    return _split(pixels)[0]


def _split(pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An object with its shadow, [height, width] bool, and the background as ``find_ground``."""
    border, ground = _border(pixels.shape[:2]), find_ground(pixels)
    contrast = np.abs(pixels - ground).max(axis=-1).round()
    most, usual = np.percentile(contrast[border], (90, 75))
    noise = min(most, 2 * usual)  # where the frame cuts the object, the most is of the object
    level = max(_level(contrast), 2 * noise, 4)
    return _clean(contrast > level, contrast > max(noise, 2)), ground


def border_noise(pixels: np.ndarray) -> float:
    """How far the border of an image strays from a plain background, for three quarters of it.

    Args:
        pixels: [height, width, 3] uint8
    Returns:
        grey levels
    """
    border = _border(pixels.shape[:2])
    contrast = np.abs(pixels - find_ground(pixels)).max(axis=-1)
    return float(np.percentile(contrast[border], 75))


def _border(shape: tuple[int, int]) -> np.ndarray:
    """The pixels along the edge of an image: [height, width] bool."""
    width = max(1, round(BORDER * min(shape)))
    border = np.ones(shape, bool)
    border[width:-width, width:-width] = False
    return border


def find_ground(pixels: np.ndarray) -> np.ndarray:
    """The background behind the object, [height, width, 3], from what the border shows of it.

    Least squares, begun with what is near the border's median; what the object covers of the border
    lies off the fit and is left out of the next.

    Args:
        pixels: [height, width, 3] uint8
    """
    values = pixels.astype(np.float64)
    border = _border(pixels.shape[:2])
    y, x = (np.linspace(-1, 1, side) for side in border.shape)
    y, x = np.meshgrid(y, x, indexing="ij")
    terms = np.stack([np.ones_like(x), x, y, x * y, x * x, y * y], axis=-1)
    there, shown = terms[border], values[border]
    off = np.abs(shown - np.median(shown, axis=0)).max(axis=-1)
    for _ in range(ROUNDS):
        near = off <= max(np.percentile(off, 60), 2)
        factors = np.linalg.lstsq(there[near], shown[near], rcond=None)[0]
        off = np.abs(shown - there @ factors).max(axis=-1)
    return terms @ factors


def _level(contrast: np.ndarray) -> float:
    """Otsu's level, or the lower one of its dark side if that side has two parts itself."""
    if contrast.max() == contrast.min():
        return float(contrast.max())
    first = threshold_otsu(contrast)
    dark = contrast[contrast <= first]
    return float(threshold_otsu(dark)) if dark.max() > dark.min() else float(first)


def _clean(silhouette: np.ndarray, differs: np.ndarray) -> np.ndarray:
    """Drop specks and fill pinholes, both judged by the object's area, and dark parts.

    Args:
        silhouette: [height, width] bool
        differs: [height, width] bool, where the background does not show
    """
    if not silhouette.any():
        return silhouette
    pieces, areas = _pieces(silhouette)
    least = SPECK * areas.max()
    kept = (areas >= least)[pieces]
    holes, areas = _pieces(~kept)
    dark = np.bincount(holes[differs], minlength=len(areas)) > areas / 2
    edges = (holes[0], holes[-1], holes[:, 0], holes[:, -1])
    dark[np.unique(np.concatenate(edges))] = False
    return ~((areas >= least) & ~dark)[holes]


def _pieces(region: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The number of each pixel's connected piece, and the pieces' areas, 0 for what is outside."""
    pieces, _ = ndimage.label(region)
    areas = np.bincount(pieces.ravel())
    areas[0] = 0
    return pieces, areas
