"""Whether the photographs' colours agree with the silhouettes: outlines should lie on colour edges.

Each view gets three measures from the gradient magnitude of the working image, after a Gaussian
blur of one pixel. ``edges`` is the share of the outline that is close to an edge; a soft shadow
that was taken for a part of the object has none. ``in_place`` is the mean gradient along the
outline as a share of the largest mean gradient along a shifted outline, by cross-correlation; a
mask that lies beside its object has its maximum elsewhere. ``offset`` is by how many pixels the
outline lies outside of where the mean gradient is largest, inside if negative. In a single view
that can be chance; the median over all views is within a pixel where masks end where their objects
do.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from PIL import Image
from scipy import fft, ndimage

from silmesh.ahead import ahead

Figures = Mapping[str, float]
EDGES, IN_PLACE, OFFSET = "edges", "in_place", "offset"
# A gradient is an edge from the smaller of two thresholds on. SLOPE is in grey levels per length of
# the image's longer side, so that it does not depend on resolution; SHARP in grey levels per pixel.
SLOPE = 1024.0
SHARP = 16.0
STEEP = (
    20.0  # grey levels a pixel: gradients are clipped here, lest a few edges decide ``in_place``
)
NEAR = 1 / 128  # of the image's longer side: greatest distance of an outline from its edge
MARGIN = 4  # pixels of a photograph's border that are ignored
REACH = 0.2  # of the diagonal of the object's bounding box: greatest shift of an outline
LARGE = 256  # pixels of the longer side: larger images are subsampled
BAND = 6  # pixels to both sides of an outline in which its edge is looked for
APART = 2  # pixels: a median offset from which on all outlines lie beside the edges
FEWEST = 16  # pixels: a shorter outline is not measured
MEASURES = (EDGES, IN_PLACE, OFFSET)
AGREES = {EDGES: 0.9, IN_PLACE: 0.9}  # a measure below this contradicts the silhouette


def compare(pixels: np.ndarray, silhouette: np.ndarray, frame: Sequence[int]) -> Figures:
    """The three measures of a view; NaN if there is no outline to measure.

    Args:
        pixels: [height, width, 3] uint8
        silhouette: [height, width] bool
        frame: left, top, right and bottom of the photograph within the image
    """
    step = -(-max(silhouette.shape) // LARGE)
    pixels, silhouette = pixels[::step, ::step], silhouette[::step, ::step]
    left, top, right, bottom = (round(side / step) for side in frame)
    photographed = np.zeros_like(silhouette)
    photographed[top + MARGIN : bottom - MARGIN, left + MARGIN : right - MARGIN] = True
    outline = silhouette & ~ndimage.binary_erosion(silhouette) & photographed
    if outline.sum() < FEWEST:
        return dict.fromkeys(MEASURES, np.nan)
    slope = np.where(photographed, _slope(pixels), 0)
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
        OFFSET: _find_offset(slope, silhouette, photographed),
    }


def _find_offset(slope: np.ndarray, silhouette: np.ndarray, photographed: np.ndarray) -> float:
    """By how many pixels the outline lies outside of the line of the largest mean gradient."""
    outside = ndimage.distance_transform_edt(~silhouette) - 0.5
    inside = ndimage.distance_transform_edt(silhouette) - 0.5
    distance = np.round(np.where(silhouette, -inside, outside))
    looked = photographed & (np.abs(distance) <= BAND)
    index = np.arange(-BAND, BAND + 1)
    at = np.where(looked, distance, BAND + 1)
    with np.errstate(invalid="ignore"):  # a thin object has no pixels that lie deep inside
        steep = ndimage.mean(np.minimum(slope, STEEP), at, index)
    return float(-index[np.nan_to_num(steep).argmax()])


def _slope(pixels: np.ndarray) -> np.ndarray:
    """The gradient magnitude of the channel that has the largest one: [height, width]."""
    smooth = ndimage.gaussian_filter(pixels.astype(np.float32), (1, 1, 0))
    slope2 = np.zeros(smooth.shape, np.float32)
    slope2[1:-1] += (smooth[2:] - smooth[:-2]) ** 2
    slope2[:, 1:-1] += (smooth[:, 2:] - smooth[:, :-2]) ** 2
    return np.sqrt(slope2.max(axis=-1)) / 2


def _correlate(slope: np.ndarray, outline: np.ndarray, reach: int) -> np.ndarray:
    """The mean gradient along the outline shifted by -reach..reach: [2 reach + 1, 2 reach + 1]."""
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
    """The measures of all views.

    They are NaN for a photograph with transparent pixels, whose colours have no meaning.

    Args:
        images: the working images of the views
        silhouettes: [views, height, width] bool
        frames: [views, 4] of the photographs within the images, as ``compare`` takes them
    """

    def measure(place: int) -> Figures:
        image = images[views[place]]
        if image.has_transparency_data:
            return dict.fromkeys(MEASURES, np.nan)
        return compare(np.asarray(image.convert("RGB")), silhouettes[place], frames[place])

    return list(ahead(measure, range(len(views)), torch.get_num_threads()))


def describe_offset(figures: Sequence[Figures]) -> list[str]:
    """What is to be said of all outlines together: a sentence if they lie beside the edges."""
    offsets = [each[OFFSET] for each in figures if not np.isnan(each[OFFSET])]
    if not offsets or abs(median := float(np.median(offsets))) < APART:
        return []
    return [
        f"the outlines of the silhouettes lie {abs(median):.0f} pixels "
        f"{'outside' if median > 0 else 'inside'} the edges in the photographs (the median of "
        f"{len(offsets)} views, in images of at most {LARGE} pixels): masks should end where the "
        "object does"
    ]


def contradict(figures: Figures) -> bool:
    """Whether the measures of a view contradict its silhouette."""
    return any(figures[name] < least for name, least in AGREES.items())
