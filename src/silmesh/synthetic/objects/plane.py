"""An airliner that banks as it climbs: thin wings, which few views see from their broad side."""

import numpy as np

from silmesh.synthetic.paints import Array, band, coat, cover, rgb, step
from silmesh.synthetic.solids import ellipse, ellipsoid, lathe, limb, round_corners, unite

BOX = ((-0.5, -0.26, -0.5), (0.5, 0.3, 0.5))
VOXEL = 0.0085

FUSELAGE = round_corners(
    [(0, -0.46), (0.012, -0.46), (0.03, -0.39), (0.07, -0.22), (0.075, -0.1), (0.075, 0.3),
     (0.07, 0.4), (0.045, 0.465), (0, 0.47)]
)  # fmt: skip
ENGINE = (0.185, -0.062, 0.115)  # the middle of the one on the side of positive x
CLIMB, BANK = 9, 16  # degrees
ORANGE, BLUE, DARK = rgb("f08a24"), rgb("17449c"), rgb("1d2531")


def _own_axes() -> Array:
    """Rows: the plane's own axes in the world, x along a wing, y up, z to the nose."""
    (cc, sc), (cb, sb) = ((np.cos(a), np.sin(a)) for a in np.radians([CLIMB, BANK]))
    climb = np.array([[1, 0, 0], [0, cc, sc], [0, -sc, cc]])
    bank = np.array([[cb, -sb, 0], [sb, cb, 0], [0, 0, 1]])
    return (climb @ bank).T.astype(np.float32)


OWN_AXES = _own_axes()


def distance(points: Array) -> Array:
    """Signed distance: a hull turned on a lathe, wings, a tail and two engines."""
    own = points @ OWN_AXES.T
    half = own * np.where(own[:, :1] < 0, np.float32([-1, 1, 1]), 1)  # both sides are alike
    x, y, z = half.T
    hull = lathe(half[:, [0, 2, 1]], FUSELAGE)
    wing = _wing(x, z, y + 0.03 - 0.1 * x, 0.455, (0.0, 0.22), (-0.14, -0.05), 0.017)
    tail = _wing(x, z, y - 0.03, 0.18, (-0.43, -0.32), (-0.455, -0.39), 0.014)
    fin = _wing(y, z, x, 0.22, (-0.43, -0.27), (-0.46, -0.38), 0.014)
    front, back = (np.add(ENGINE, (0, 0, dz)) for dz in (0.055, -0.055))
    engine = np.maximum(limb(half, front, back, (0.036, 0.027)), z - front[2] - 0.01)
    pylon = ellipsoid(half, (ENGINE[0], -0.03, 0.1), (0.014, 0.035, 0.05))
    return unite(unite(hull, wing, blend=0.03), tail, fin, engine, pylon, blend=0.012)


def _wing(
    out: Array,
    along: Array,
    up: Array,
    span: float,
    root: tuple[float, float],
    tip: tuple[float, float],
    thickness: float,
) -> Array:
    """Distance to a wing: elliptic sections, whose rear and front go from the root to the tip.

    Args:
        out, along, up: coordinates [n] from the root to the tip, from rear to front, across
        span: from the root to the tip
        root, tip: rear and front there
        thickness: half of it
    """
    part = np.clip(out / span, 0, 1)
    rear, front = (root[i] + (tip[i] - root[i]) * part for i in (0, 1))
    section = ellipse(along - (rear + front) / 2, up, (front - rear) / 2, thickness)
    return np.maximum(section, np.maximum(out - span, -out))


def paint(points: Array) -> Array:
    """White above and grey below, a blue and orange livery, windows, engines and cockpit."""
    own = points @ OWN_AXES.T
    x, y, z = own.T
    skin = coat(points, rgb("f3f5f7"), 0.7)
    hull = (np.abs(x) < 0.08) & (np.hypot(x, y) < 0.082)
    cover(skin, ~hull & (z > -0.3), rgb("ccd3da"), 0.6)
    cover(skin, ~hull & (z > -0.3) & (np.abs(x) > 0.405), ORANGE, 0.6)
    cover(skin, ~hull & (z < -0.26), BLUE, 0.6)
    stripe = band(0.14, 0.165, y - 0.25 * (z + 0.4), 0.003) * (np.abs(x) < 0.03) * (z < -0.26)
    cover(skin, stripe, ORANGE, 0.6)
    _paint_hull(skin, x, y, z, hull)
    _paint_engines(skin, x, y, z)
    return skin


def _paint_hull(skin: Array, x: Array, y: Array, z: Array, hull: Array) -> None:
    """Grey belly, two stripes, passengers' windows and the cockpit's."""
    cover(skin, (1 - step(-0.028, y)) * hull, rgb("b9c2cc"), 0.6)
    cover(skin, band(-0.026, -0.012, y) * hull, BLUE, 0.7)
    cover(skin, band(-0.034, -0.029, y) * hull, ORANGE, 0.7)
    row = band(0.3, 0.75, (z / 0.026) % 1.0, 0.1) * band(0.008, 0.028, y) * band(-0.3, 0.36, z)
    cover(skin, row * hull * (np.abs(x) > 0.05), DARK, 0.9)
    panes = np.abs(np.abs(x) - 0.022) > 0.0025
    cover(skin, band(0.015, 0.042, y) * band(0.405, 0.45, z) * hull * panes, DARK, 1.0)


def _paint_engines(skin: Array, x: Array, y: Array, z: Array) -> None:
    """Blue, with a bright lip and a dark fan."""
    out = np.hypot(np.abs(x) - ENGINE[0], y - ENGINE[1])
    engine = (1 - step(0.041, out)) * (y < -0.034) * (z > 0.02)
    front = z - ENGINE[2]
    cover(skin, engine, BLUE, 0.8)
    cover(skin, engine * step(0.05, front), rgb("dfe4e8"), 0.9)
    cover(skin, engine * step(0.062, front) * (1 - step(0.024, out)), DARK, 0.3)
