"""A tube of cream that stands on its cap: round at one end, flat at the other."""

from functools import cache

import numpy as np

from silmesh.synthetic.paints import Array, band, coat, cover, ink_at, print_label, rgb, step
from silmesh.synthetic.solids import ellipse, lathe, round_corners, unite

BOX = ((-0.25, -0.43, -0.18), (0.25, 0.43, 0.18))
VOXEL = 0.009

RADIUS = 0.135
SHOULDER, CRIMP, TOP = -0.235, 0.335, 0.405  # heights: end of the cap, of the bag, of the tube
CAP = round_corners(
    [(0, -0.4), (0.1, -0.4), (0.118, -0.395), (0.124, -0.26), (0.12, -0.25), (0, -0.25)], times=2
)


def distance(points: Array) -> Array:
    """Signed distance: a bag from a circle to a seam of the same girth, and the cap."""
    x, y, z = points.T
    part = np.clip((y - SHOULDER) / (CRIMP - SHOULDER), 0, 1)
    wide = RADIUS * (1 + (np.pi / 2 - 1) * part)
    thick = np.maximum(RADIUS * np.sqrt(np.maximum(1 - part**1.7, 0)), 0.018)
    below = np.maximum(SHOULDER + 0.03 - y, 0) / 0.05  # the bag rounds off towards the cap
    side = ellipse(x, z, wide, thick) + 0.03 * below**2
    seam = np.maximum(np.maximum(np.abs(x) - np.pi / 2 * RADIUS, np.abs(z) - 0.014), CRIMP - y)
    bag = np.maximum(unite(side, seam, blend=0.012), np.maximum(y - TOP, SHOULDER - 0.02 - y))
    angle = np.arctan2(x, z)
    ribs = 0.0025 * np.cos(40 * angle) * band(-0.385, -0.27, y, 0.01)
    return unite(bag, lathe(points, CAP) + ribs, blend=0.006)


def paint(points: Array) -> Array:
    """White with a printed label before and behind, teal below, a striped crimp, a coral cap."""
    x, y, z = points.T
    teal, coral = rgb("1d9a94"), rgb("ef6f5c")
    skin = coat(points, rgb("f4f3ee"), 0.7)
    wave = y + 0.15 + 0.025 * np.sin(2 * np.arctan2(x, z))
    cover(skin, 1 - step(0.0, wave), rgb("8ed3c7"), 0.7)
    cover(skin, 1 - step(-0.03, wave), teal, 0.7)
    cover(skin, band(0.008, 0.016, wave), coral, 0.7)
    cover(skin, _ink(x, y, z), rgb("155e63"), 0.7)
    disc = 1 - step(0.032, np.hypot(x, y - 0.235))
    leaf = 1 - step(0.0, np.hypot(np.abs(x) + 0.012, y - 0.235) - 0.026)
    cover(skin, disc * (1 - leaf), teal, 0.7)
    crimp = step(CRIMP + 0.005, y)
    cover(skin, crimp, teal, 0.5)
    cover(skin, crimp * step(0, np.cos(y * (2 * np.pi / 0.012)), 1.2), rgb("6fc2b9"), 0.5)
    cover(skin, 1 - step(SHOULDER - 0.012, y), coral, 0.5)
    return skin


def _ink(x: Array, y: Array, z: Array) -> Array:
    """Ink of the label, the right way round on both sides."""
    across = np.where(z > 0, x, -x) / 0.26 + 0.5
    return ink_at(_label(), across, (0.18 - y) / 0.26)


@cache
def _label() -> Array:
    lines = [
        ("SILMESH", 0.22, 0.15),
        ("hand cream", 0.15, 0.38),
        ("with apricot oil", 0.11, 0.58),
        ("75 ml", 0.11, 0.82),
    ]
    return print_label(lines, 1.0)
