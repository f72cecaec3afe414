"""A wine bottle: straight body, shoulder and neck, a label and a capsule over the cork."""

from functools import cache

import numpy as np

from silmesh.synthetic.paints import Array, band, coat, cover, ink_at, mix, print_label, rgb, step
from silmesh.synthetic.solids import lathe, round_corners, unite

BOX = ((-0.16, -0.44, -0.16), (0.16, 0.44, 0.16))
VOXEL = 0.0085

RADIUS = 0.128
GLASS = round_corners(
    [(0, -0.41), (0.1, -0.41), (0.128, -0.405), (0.128, -0.37), (0.128, -0.1), (0.128, 0.06),
     (0.115, 0.13), (0.055, 0.17), (0.043, 0.23), (0.04, 0.34), (0.04, 0.395), (0, 0.395)]
)  # fmt: skip
CAPSULE = round_corners(
    [(0, 0.25), (0.046, 0.25), (0.047, 0.25), (0.047, 0.37), (0.054, 0.372), (0.054, 0.39),
     (0.05, 0.392), (0.05, 0.408), (0.045, 0.412), (0, 0.412)], times=2
)  # fmt: skip
LABEL = (-0.29, 0.01)  # lower and upper edge
LABEL_HALF_ANGLE = 1.15


def distance(points: Array) -> Array:
    """Signed distance: glass and capsule, both turned on a lathe."""
    return unite(lathe(points, GLASS), lathe(points, CAPSULE))


def paint(points: Array) -> Array:
    """Green glass, a paper label in front and a small one behind, a red and gold capsule."""
    x, y, z = points.T
    angle = np.arctan2(x, z)
    gold = rgb("d9b154")
    skin = coat(points, rgb("1f5a34"), 1.0)
    skin[:, :3] = mix(skin[:, :3], rgb("4d9648"), 0.6 * step(0.1, y, 0.25))
    _paint_label(skin, angle, y)
    cover(skin, step(0.249, y), rgb("8c1a2c"), 0.6)
    cover(skin, band(0.262, 0.27, y) + band(0.356, 0.366, y), gold, 0.8)
    return skin


def _paint_label(skin: Array, angle: Array, y: Array) -> None:
    """The front label with its frame and text, and the plain one behind."""
    low, high = LABEL
    side = (LABEL_HALF_ANGLE - np.abs(angle)) * RADIUS
    inside = np.minimum(side, np.minimum(y - low, high - y))  # distance from the label's edge
    cover(skin, step(0.0, inside), rgb("f3ead2"), 0.12)
    cover(skin, band(0.008, 0.012, inside), rgb("c39a3d"), 0.4)
    ink = ink_at(_label(), angle / (2 * LABEL_HALF_ANGLE) + 0.5, (high - y) / (high - low))
    cover(skin, ink * (inside > 0), rgb("3a2430"), 0.12)
    hill = (y + 0.275) - 0.028 * np.cos(angle * 4.2) - 0.012 * np.sin(angle * 9)
    cover(skin, (1 - step(0.0, hill)) * step(0.012, inside), rgb("8f2f3f"), 0.12)
    behind = np.minimum((np.abs(angle) - np.pi + 0.55) * RADIUS, np.minimum(y + 0.24, -0.06 - y))
    cover(skin, step(0.0, behind), rgb("efe4c8"), 0.12)
    lines = band(0.3, 0.6, (y / 0.018) % 1.0, 0.1) * step(0.015, behind)
    cover(skin, lines, rgb("7a6a60"), 0.12)


@cache
def _label() -> Array:
    lines = [
        ("CHATEAU", 0.1, 0.2),
        ("SILHOUETTE", 0.125, 0.35),
        ("grand cru", 0.09, 0.53),
        ("2019", 0.12, 0.68),
    ]
    return print_label(lines, (LABEL[1] - LABEL[0]) / (2 * LABEL_HALF_ANGLE * RADIUS))
