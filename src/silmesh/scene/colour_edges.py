"""Whether the photographs' colours agree with the silhouettes: outlines lie where colours change.

Two figures a view, from the slope of the working image, by the differences of its neighbours after
a Gaussian of one pixel. ``edges``: the share of the outline near which there is any slope; a soft
shadow that passes for a part of the object has none. ``in_place``: how steep it is along the
outline, as a share of the steepest that a shifted outline would find; a mask that lies beside its
object has its steepest elsewhere (the maximum of a cross-correlation).
"""

from collections.abc import Mapping, Sequence

import numpy as np
from PIL import Image
from scipy import fft, ndimage

Figures = Mapping[str, float]
EDGES, IN_PLACE = "edges", "in_place"
SLOPE = 1024.0  # grey levels along the image's longer side: less is no edge, at any size
SHARP = 16.0  # grey levels a pixel: more is an edge, also in an image of few pixels
STEEP = 20.0  # grey levels a pixel: more counts no more, so that a few edges do not decide
NEAR = 1 / 128  # of the image's longer side: how far an outline may lie beside its edge
MARGIN = 4  # pixels of a photograph's border that say nothing
REACH = 0.2  # of the object's diagonal: how far an outline is shifted
LARGE = 256  # pixels of the longer side: larger images are looked at in steps
FEWEST = 16  # pixels of an outline that can be judged
AGREES = {EDGES: 0.9, IN_PLACE: 0.9}  # below, colours contradict a silhouette


def compare(pixels: np.ndarray, silhouette: np.ndarray, frame: Sequence[int]) -> Figures:
    """The two figures of a view, each in 0..1; NaN where there is no outline to judge.

    Args:
        pixels: [height, width, 3] uint8
        silhouette: [height, width] bool
        frame: left, top, right and bottom of the photograph within the image
    """
    step = -(-max(silhouette.shape) // LARGE)
    pixels, silhouette = pixels[::step, ::step], silhouette[::step, ::step]
    left, top, right, bottom = (round(side / step) for side in frame)
    seen = np.zeros_like(silhouette)
    seen[top + MARGIN : bottom - MARGIN, left + MARGIN : right - MARGIN] = True
    outline = silhouette & ~ndimage.binary_erosion(silhouette) & seen
    if outline.sum() < FEWEST:
        return {EDGES: np.nan, IN_PLACE: np.nan}
    slope = np.where(seen, _slope(pixels), 0)
    beside = max(1, round(NEAR * max(slope.shape)))
    near = ndimage.maximum_filter(slope, 2 * beside + 1)
    rows, columns = np.nonzero(silhouette)
    reach = int(REACH * np.hypot(np.ptp(rows) + 1, np.ptp(columns) + 1))
    reach = min(max(reach, beside), min(slope.shape) // 2 - 1)
    steep = _correlate(np.minimum(slope, STEEP), outline, reach)
    around = slice(reach - beside, reach + beside + 1)
    here = steep[around, around].max()
    edge = min(SLOPE / max(slope.shape), SHARP)
    return {
        EDGES: float((near[outline] > edge).mean()),
        IN_PLACE: float(here / steep.max()) if steep.max() > 0 else 0.0,
    }


def _slope(pixels: np.ndarray) -> np.ndarray:
    """How fast the colour changes, in the channel where it does most: [height, width]."""
    smooth = ndimage.gaussian_filter(pixels.astype(np.float32), (1, 1, 0))
    slope2 = np.zeros(smooth.shape, np.float32)
    slope2[1:-1] += (smooth[2:] - smooth[:-2]) ** 2
    slope2[:, 1:-1] += (smooth[:, 2:] - smooth[:, :-2]) ** 2
    return np.sqrt(slope2.max(axis=-1)) / 2


def _correlate(slope: np.ndarray, outline: np.ndarray, reach: int) -> np.ndarray:
    """The mean slope along the outline shifted by -reach..reach: [2 reach + 1, 2 reach + 1]."""
    along = fft.irfft2(
        fft.rfft2(slope) * np.conj(fft.rfft2(outline.astype(np.float32))), s=slope.shape
    )
    around = np.roll(along, (reach, reach), (0, 1))[: 2 * reach + 1, : 2 * reach + 1]
    return np.maximum(around, 0) / outline.sum()


def compare_all(
    images: Mapping[str, Image.Image],
    views: Sequence[str],
    silhouettes: np.ndarray,
    frames: np.ndarray,
) -> list[Figures]:
    """The figures of all views.

    NaN for a photograph that is transparent in places: what colour it has there says nothing.

    Args:
        images: the working images of the views
        silhouettes: [views, height, width] bool
        frames: [views, 4] of the photographs within the images, as ``compare`` takes them
    """
    found = []
    for view, silhouette, frame in zip(views, silhouettes, frames, strict=True):
        image = images[view]
        if image.has_transparency_data:
            found.append({EDGES: np.nan, IN_PLACE: np.nan})
        else:
            found.append(compare(np.asarray(image.convert("RGB")), silhouette, frame))
    return found


def contradict(figures: Figures) -> bool:
    """Whether the figures of a view say that its silhouette is not the object's."""
    return any(figures[name] < least for name, least in AGREES.items())
