"""An airliner that banks as it climbs: thin wings, which few views see from their broad side."""

import numpy as np

from silmesh.synthetic.paints import Array, band, coat, cover, rgb, step
from silmesh.synthetic.solids import ellipse, ellipsoid, lathe, limb, round_corners, unite

BOX = ((-0.5, -0.3, -0.5), (0.5, 0.36, 0.5))
VOXEL = 0.0085

FUSELAGE = round_corners(
    [(0, -0.47), (0.012, -0.47), (0.03, -0.4), (0.07, -0.22), (0.075, -0.1), (0.075, 0.3),
     (0.07, 0.4), (0.045, 0.465), (0, 0.47)]
)  # fmt: skip
ENGINE = (0.185, -0.062, 0.115)  # of the mirrored half


def _from_world() -> Array:
    """Rotation from the world to the plane's own axes: x along a wing, y up, z to the nose."""
    pitch, bank = np.radians(-9), np.radians(16)
    cp, sp, cb, sb = np.cos(pitch), np.sin(pitch), np.cos(bank), np.sin(bank)
    climb = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    roll = np.array([[cb, -sb, 0], [sb, cb, 0], [0, 0, 1]])
    return (climb @ roll).T.astype(np.float32)


FROM_WORLD = _from_world()


def distance(points: Array) -> Array:
    """Signed distance, of one half mirrored."""
    own = points @ FROM_WORLD.T
    half = np.stack([np.abs(own[:, 0]), own[:, 1], own[:, 2]], axis=1)
    x, y, z = half.T
    hull = lathe(half[:, [0, 2, 1]], FUSELAGE)
    wing = _plate(x, z, y + 0.03 - 0.1 * x, 0.455, (0.0, 0.22), (-0.14, -0.05), 0.017)
    tail = _plate(x, z, y - 0.03, 0.18, (-0.43, -0.32), (-0.46, -0.4), 0.013)
    fin = _plate(y, z, x, 0.225, (-0.43, -0.27), (-0.475, -0.405), 0.013)
    engine = limb(half, _shift(ENGINE, 0.055), _shift(ENGINE, -0.055), (0.036, 0.027))
    engine = np.maximum(engine, z - ENGINE[2] - 0.065)
    pylon = ellipsoid(half, (0.185, -0.03, 0.1), (0.012, 0.035, 0.05))
    body = unite(hull, wing, blend=0.03)
    return unite(body, tail, fin, engine, pylon, blend=0.012)


def _shift(place: tuple[float, float, float], along: float) -> tuple[float, float, float]:
    return place[0], place[1], place[2] + along


def _plate(
    out: Array, along: Array, up: Array, span: float, root: tuple, tip: tuple, thickness: float
) -> Array:
    """A wing: an ellipse in each section, from the root's (rear, front) to the tip's."""
    part = np.clip(out / span, 0, 1)
    rear, front = (root[i] + (tip[i] - root[i]) * part for i in (0, 1))
    section = ellipse(along - (rear + front) / 2, up, (front - rear) / 2, thickness)
    return unite_rounded_end(section, out - span)


def unite_rounded_end(section: Array, beyond: Array) -> Array:
    """The section as far as the tip."""
    return np.maximum(section, beyond)


def paint(points: Array) -> Array:
    """White above and grey below, a blue and orange livery, windows, engines and cockpit."""
    own = points @ FROM_WORLD.T
    x, y, z = own.T
    blue, orange, dark = rgb("1f4fa3"), rgb("f08a24"), rgb("2c3442")
    paint = coat(points, rgb("f3f5f7"), 0.7)
    hull = (np.abs(x) < 0.08) & (np.hypot(x, y) < 0.082)
    cover(paint, (1 - step(-0.028, y)) * hull, rgb("b9c2cc"), 0.6)
    cover(paint, band(-0.026, -0.012, y) * hull, blue, 0.7)
    cover(paint, band(-0.034, -0.029, y) * hull, orange, 0.7)
    windows = band(0.3, 0.75, (z / 0.026) % 1.0, 0.1) * band(0.008, 0.028, y) * band(-0.3, 0.36, z)
    cover(paint, windows * (np.abs(x) > 0.05) * hull, dark, 0.9)
    cockpit = band(0.015, 0.042, y) * band(0.405, 0.45, z) * (np.abs(np.abs(x) - 0.022) > 0.0025)
    cover(paint, cockpit * hull, dark, 1.0)
    wings = ~hull & (np.abs(x) > 0.08) & (z > -0.3)
    cover(paint, 1.0 * wings, rgb("ccd3da"), 0.6)
    cover(paint, wings * step(0.405, np.abs(x)), orange, 0.6)
    tail = (z < -0.26) & ~hull
    cover(paint, 1.0 * tail, blue, 0.6)
    stripe = band(0.14, 0.165, y - 0.25 * (z + 0.4), 0.003)
    cover(paint, stripe * (np.abs(x) < 0.03) * tail, orange, 0.6)
    _paint_engines(paint, own, blue, dark)
    return paint


def _paint_engines(paint: Array, own: Array, blue: Array, dark: Array) -> None:
    """Blue nacelles with a bright lip and a dark fan."""
    x, y, z = own.T
    out = np.hypot(np.abs(x) - ENGINE[0], y - ENGINE[1])
    nacelle = (1 - step(0.041, out)) * (y < -0.034) * (z > 0.02)
    cover(paint, nacelle, blue, 0.8)
    lip = step(ENGINE[2] + 0.05, z)
    cover(paint, nacelle * lip, rgb("dfe4e8"), 0.9)
    cover(paint, nacelle * step(ENGINE[2] + 0.062, z) * (1 - step(0.024, out)), dark, 0.3)
