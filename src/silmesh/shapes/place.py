"""How many vertices a first mesh gets, and the report's scale and shift to the object."""

import math

import numpy as np

COUNTS = (642, 1352, 1922)  # what the report calls 600, 1,300 and 1,900 polygons
EDGE = 5.0  # pixels: `auto` takes the fewest vertices whose edges in the image are this short
REPORT_SIZE = 256  # pixels of the images in which the report's alignment counts
REPORT_RADIUS = 90  # pixels of the unit sphere, halved, in such an image


def choose_count(silhouettes: np.ndarray) -> int:
    """The fewest of 642, 1,352 and 1,922 vertices whose edges are a few pixels long.

    A convex body's surface is four times its mean silhouette (Cauchy), and a closed mesh of n
    vertices shares that among 2 n - 4 triangles; an even triangle of area a has edges of
    sqrt(4 a / sqrt(3)).

    Args:
        silhouettes: [views, height, width] bool
    """
    surface = 4 * silhouettes.sum(axis=(1, 2)).mean()
    for count in COUNTS:
        edge = math.sqrt(4 / math.sqrt(3) * surface / (2 * count - 4))
        if edge <= EDGE:
            return count
    return COUNTS[-1]


def align_to_box(verts: np.ndarray, silhouette: np.ndarray) -> np.ndarray:
    """The report's alignment: scale and shift x and y by the silhouette's bounding box.

    The box's sides are last index minus first, its unit is a pixel of a 256 x 256 image, in which
    the unit sphere, halved and seen by the report's cameras, has a radius of about 90.

    Args:
        verts: [verts, 3] of a unit mesh, not yet halved
        silhouette: [size, size] bool, of the first view
    Returns:
        [verts, 3]
    """
    left, top, width, height = _bounding_box(silhouette) * REPORT_SIZE / len(silhouette)
    half, r = REPORT_SIZE / 2, REPORT_RADIUS
    scale = np.array([width / 2 / r, height / 2 / r, 1])
    shift = np.array([-((half - width / 2) - left) / r, ((half - height / 2) - top) / r, 0])
    return verts * scale + shift


def _bounding_box(silhouette: np.ndarray) -> np.ndarray:
    """Left, top, width and height, the latter two as last index minus first."""
    rows, columns = (np.flatnonzero(silhouette.any(axis=axis)) for axis in (1, 0))
    return np.array(
        [columns[0], rows[0], columns[-1] - columns[0], rows[-1] - rows[0]], dtype=np.float64
    )
