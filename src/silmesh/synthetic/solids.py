"""Signed distance functions of simple solids, and how they combine: negative inside.

Most are exact; ``ellipse``, ``ellipsoid`` and ``limb`` are close to the surface what they should
be, which is where they are used. The formulas are those that Inigo Quilez collects in *distance
functions* (iquilezles.org). Everywhere ``points`` is [n, 3] and a distance [n], in world units.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
Point = Sequence[float]


def sphere(points: Array, centre: Point, radius: float) -> Array:
    """Distance to a sphere."""
    return _norm(points - np.float32(centre)) - radius


def ellipsoid(points: Array, centre: Point, radii: Point) -> Array:
    """Distance to an ellipsoid along the axes, to first order near its surface."""
    offset = points - np.float32(centre)
    scaled = _norm(offset / np.float32(radii))
    slope = _norm(offset / np.float32(radii) ** 2)
    return (scaled - 1) * _ratio(scaled, slope)


def ellipse(u: Array, v: Array, a: Array | float, b: Array | float) -> Array:
    """Distance in a plane to an ellipse of half axes a and b, to first order near it."""
    scaled = np.hypot(u / a, v / b)
    slope = np.hypot(u / a**2, v / b**2)
    return (scaled - 1) * _ratio(scaled, slope)


def limb(points: Array, start: Point, end: Point, radii: tuple[float, float]) -> Array:
    """Distance to a rod with round ends, whose radius goes evenly from one end to the other."""
    start, along = np.float32(start), np.float32(end) - np.float32(start)
    offset = points - start
    part = np.clip(offset @ along / (along @ along), 0, 1)
    axis = _norm(offset - part[:, None] * along)
    return axis - (radii[0] + (radii[1] - radii[0]) * part)


def ring(points: Array, centre: Point, axis: int, radius: float, thickness: float) -> Array:
    """Distance to a torus around the coordinate axis of this number."""
    offset = points - np.float32(centre)
    height = offset[:, axis]
    out = _norm(np.delete(offset, axis, axis=1))
    return np.hypot(out - radius, height) - thickness


def lathe(points: Array, profile: Array) -> Array:
    """Distance to a solid of revolution about the y axis.

        y
        |___ profile[-1]
        |   \\
        |    |      rows of (radius, y) from the bottom to the top, the first and
        |___/       the last on the axis
        profile[0]
    """
    radius, y = np.hypot(points[:, 0], points[:, 2]), points[:, 1]
    nearest2 = np.full(len(points), np.inf, dtype=points.dtype)
    inside = np.zeros(len(points), dtype=bool)
    for (r0, y0), (r1, y1) in pairwise(profile):
        dr, dy = r1 - r0, y1 - y0
        part = np.clip(((radius - r0) * dr + (y - y0) * dy) / (dr * dr + dy * dy), 0, 1)
        distance2 = (radius - r0 - part * dr) ** 2 + (y - y0 - part * dy) ** 2
        nearest2 = np.minimum(nearest2, distance2)
        if dy:  # an edge that a walk outwards from the point crosses
            crosses = (y0 > y) != (y1 > y)
            inside ^= crosses & (radius < r0 + (y - y0) * (dr / dy))
    return np.where(inside, -1, 1) * np.sqrt(nearest2)


def round_corners(profile: Sequence[tuple[float, float]], times: int = 3) -> Array:
    """Cut the corners of an open line again and again (Chaikin's curve); its ends stay."""
    line = np.array(profile, dtype=np.float32)
    for _ in range(times):
        before, after = line[:-1], line[1:]
        cut = np.stack([0.75 * before + 0.25 * after, 0.25 * before + 0.75 * after], axis=1)
        line = np.concatenate([line[:1], cut.reshape(-1, 2)[1:-1], line[-1:]])
    return line


def unite(first: Array, *others: Array, blend: float = 0.0) -> Array:
    """What is in any of the solids; a blend of some width fills the creases between them."""
    for other in others:
        first = np.minimum(first, other) - _fillet(first, other, blend)
    return first


def subtract(solid: Array, cut: Array, blend: float = 0.0) -> Array:
    """What is in the solid and not in the cut."""
    return -unite(-solid, cut, blend=blend)


def _fillet(a: Array, b: Array, width: float) -> Array | float:
    """How much a blended union lies outside the sharp one: a parabola within the width."""
    if not width:
        return 0.0
    return np.maximum(width - np.abs(a - b), 0) ** 2 / (4 * width)


def _norm(vectors: Array) -> Array:
    """Lengths of the rows: [n]."""
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def _ratio(scaled: Array, slope: Array) -> Array:
    """Their quotient, which tends to a half axis at the centre, where both are zero."""
    return (scaled + 1e-6) / (slope + 1e-5)
