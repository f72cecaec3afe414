"""Outlines, and as SVG paths, small enough for every view of every fit to be in the page.

A path's numbers are whole, in units of which ``UNITS`` make a side of the working image.
"""

from collections.abc import Sequence

import numpy as np
from skimage.measure import approximate_polygon, find_contours

from silmesh.geometry.frame import count_on_frame

UNITS = 1024
TOLERANCE = 0.3  # pixels of the working image by which a path may leave the outline


def find_outlines(alpha: np.ndarray, frame: Sequence[int] | None = None) -> list[np.ndarray]:
    """The outlines of a mask, or of what an alpha of at least a half covers: lists of [n, 2].

    They are closed, the last point being the first; where the frame cuts the mask they are open,
    since there it has no outline.

    Args:
        alpha: [height, width] bool, or in [0, 1]
        frame: left, top, right and bottom of the photograph within the image, if it may cut it
    """
    left, top = 0, 0
    covered = alpha.astype(float)
    if frame is not None and count_on_frame(alpha > 0.5, frame):
        left, top, right, bottom = frame
        covered = np.pad(covered[top:bottom, left:right], 1, mode="edge")
    else:
        covered = np.pad(covered, 1)
    return [c[:, ::-1] - 0.5 + (left, top) for c in find_contours(covered, 0.5)]


def outline_path(alpha: np.ndarray, frame: Sequence[int] | None = None) -> str:
    """The outline of a mask, or of what an alpha of at least a half covers.

    Args:
        alpha: [size, size] bool, or in [0, 1]
        frame: as ``find_outlines`` takes it
    Returns:
        the ``d`` of a path; empty where nothing is covered
    """
    scale = UNITS / len(alpha)
    parts = [approximate_polygon(c, TOLERANCE) for c in find_outlines(alpha, frame)]
    return "".join(
        _part(np.rint(c * scale).astype(int)) for c in parts if not _closed(c) or len(c) > 3
    )


def _closed(points: np.ndarray) -> bool:
    """Whether points [n, 2] end where they begin."""
    return bool((points[0] == points[-1]).all())


def _part(points: np.ndarray) -> str:
    """Points [n, 2] as a part of a path: where it begins, and the steps from there."""
    x, y = points[0]
    closed = _closed(points)
    steps = np.diff(points[:-1] if closed else points, axis=0)
    return f"M{x} {y}l" + " ".join(f"{dx} {dy}" for dx, dy in steps) + "z" * closed
