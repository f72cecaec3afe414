"""Which triangle each pixel shows: a z-buffer in numba, without antialiasing.

A pixel shows the nearest triangle that its centre lies in. One over the depth is linear in the
image (as for any plane), so that is what is interpolated and compared; the weights of the corners
are corrected for the perspective. With all depths 1 the same draws an atlas.
"""

import math

import numpy as np
from numba import njit


def draw(
    points: np.ndarray, depths: np.ndarray, faces: np.ndarray, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Draw triangles, each from both sides.

    Args:
        points: [verts, 2] pixels, centres at integer + 0.5
        depths: [verts]; a triangle with a corner that is not in front is left out
        faces: [faces, 3]
        size: width and height
    Returns:
        the triangle that each pixel shows [height, width] int32, -1 for none, and its depth
        [height, width] float32, infinite for none
    """
    shown = np.full(size[::-1], -1, np.int32)
    nearness = np.zeros(size[::-1], np.float32)
    _draw(points.astype(np.float64), depths.astype(np.float64), faces, shown, nearness)
    with np.errstate(divide="ignore"):
        return shown, 1 / nearness


@njit(nogil=True, cache=True, error_model="numpy")
def _draw(points, depths, faces, shown, nearness):
    height, width = shown.shape
    for f in range(len(faces)):
        a, b, c = faces[f]
        if not (depths[a] > 0 and depths[b] > 0 and depths[c] > 0):
            continue
        ax, ay = points[a]
        bx, by = points[b]
        cx, cy = points[c]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0 or not math.isfinite(area):
            continue
        top = max(0, math.ceil(min(ay, by, cy) - 0.5))
        bottom = min(height - 1, math.floor(max(ay, by, cy) - 0.5))
        left = max(0, math.ceil(min(ax, bx, cx) - 0.5))
        right = min(width - 1, math.floor(max(ax, bx, cx) - 0.5))
        za, zb, zc = 1 / depths[a], 1 / depths[b], 1 / depths[c]
        for i in range(top, bottom + 1):
            y = i + 0.5
            for j in range(left, right + 1):
                x = j + 0.5
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1 - u - v
                if u < 0 or v < 0 or w < 0:
                    continue
                near = u * za + v * zb + w * zc
                if near > nearness[i, j]:
                    nearness[i, j] = near
                    shown[i, j] = f


def weigh_corners(
    points: np.ndarray, depths: np.ndarray, corners: np.ndarray, pixels: np.ndarray
) -> np.ndarray:
    """The weights of triangles' corners at pixels, right for the perspective: [n, 3] float32.

    Args:
        points: [verts, 2] pixels
        depths: [verts]
        corners: [n, 3] of the triangle at each pixel
        pixels: [n, 2]
    """
    a, b, c = (points[corners[:, i]] - pixels for i in range(3))
    weights = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=1) / depths[corners]
    return (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
