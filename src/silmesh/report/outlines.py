"""Outlines as SVG paths, small enough for every view of every fit to be in the page.

A path's numbers are whole, in units of which ``UNITS`` make a side of the working image.
"""

import numpy as np
from skimage.measure import approximate_polygon, find_contours

UNITS = 1024
TOLERANCE = 0.3  # pixels of the working image by which a path may leave the outline


def outline_path(alpha: np.ndarray) -> str:
    """The outline of a mask, or of what an alpha of at least a half covers.

    Args:
        alpha: [size, size] bool, or in [0, 1]
    Returns:
        the ``d`` of a path, each part closed; empty where nothing is covered
    """
    scale = UNITS / len(alpha)
    contours = find_contours(np.pad(alpha.astype(float), 1), 0.5)
    corners = [approximate_polygon(c, TOLERANCE)[:-1, ::-1] - 0.5 for c in contours]
    return "".join(_part(np.rint(c * scale).astype(int)) for c in corners if len(c) > 2)


def _part(points: np.ndarray) -> str:
    """Points [n, 2] as a closed part of a path: where it begins, and the steps from there."""
    x, y = points[0]
    steps = " ".join(f"{dx} {dy}" for dx, dy in np.diff(points, axis=0))
    return f"M{x} {y}l{steps}z"
