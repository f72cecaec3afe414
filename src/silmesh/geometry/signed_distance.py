"""Signed distance of pixels to the outline of a silhouette, positive inside."""

from collections.abc import Sequence

import numpy as np
from numba import njit

from silmesh.geometry.frame import find_box

# Pixels by which every outline is moved outwards. An outline is known to half a pixel only, and a
# visual hull takes the smallest of all views; without this margin small images lose thin parts.
GRACE = 0.15


def signed_distance(silhouette: np.ndarray, far: float, grace: float = GRACE) -> np.ndarray:
    """Distance of each pixel's centre to the outline between pixels, positive inside.

    Args:
        silhouette: [height, width] bool
        far: where distances are cut off, in pixels
        grace: how far the outline is moved outwards, in pixels
    Returns:
        [height, width] float32
    """
    left, top, right, bottom = find_box(silhouette)
    signed = np.full(silhouette.shape, -far, np.float32)
    if right > left:  # further away than this from its box all is cut off
        most = int(np.ceil(far)) + 2
        part = np.s_[max(0, top - most) : bottom + most, max(0, left - most) : right + most]
        _measure(signed[part], silhouette[part], most, far, grace)
    return signed


def measure_within(silhouette: np.ndarray, part: Sequence[int], far: float) -> np.ndarray:
    """The same by the pixels of a part of an image alone, of which the border is no outline.

    Args:
        part: left, top, right and bottom, in pixels; beyond it stands -far
    """
    left, top, right, bottom = part
    signed = np.full(silhouette.shape, -far, np.float32)
    within = np.ascontiguousarray(silhouette[top:bottom, left:right])
    signed[top:bottom, left:right] = signed_distance(within, far)
    return signed


@njit(nogil=True, cache=True)
def _measure(signed, silhouette, most, far, grace):
    """Signed distance of each pixel's centre to the outline.

    Down and up each column first the distance to the nearest of the other kind, cut off at
    ``most``; then along the rows, where a column that stands k aside offers k^2 + (its own
    distance)^2. Only the columns about those that offer anything need be asked.
    """
    height, width = silhouette.shape
    along = np.full((height, width), most, np.int32)
    for r in range(1, height):
        for c in range(width):
            if silhouette[r, c] != silhouette[r - 1, c]:
                along[r, c] = 1
            else:
                along[r, c] = min(along[r - 1, c] + 1, most)
    for r in range(height - 2, -1, -1):
        for c in range(width):
            if silhouette[r, c] != silhouette[r + 1, c]:
                along[r, c] = 1
            else:
                along[r, c] = min(along[r + 1, c] + 1, along[r, c])
    for r in range(height):
        for c in range(width):
            inside = silhouette[r, c]
            best = along[r, c] * along[r, c]
            k = 1
            while k * k < best:
                if c >= k:
                    there = along[r, c - k] if silhouette[r, c - k] == inside else 0
                    best = min(best, k * k + there * there)
                if c + k < width:
                    there = along[r, c + k] if silhouette[r, c + k] == inside else 0
                    best = min(best, k * k + there * there)
                k += 1
            distance = np.sqrt(best) - 0.5
            distance = grace + (distance if inside else -distance)
            signed[r, c] = max(-far, min(far, distance))
