"""A teddy bear that stands with its legs apart: a gap between them, open below."""

import numpy as np

from silmesh.synthetic.paints import Array, band, coat, cover, rgb, speckle, step
from silmesh.synthetic.solids import ellipsoid, limb, ring, sphere, subtract, unite

BOX = ((-0.36, -0.47, -0.22), (0.36, 0.44, 0.26))
VOXEL = 0.011

# Of the half with positive x: centres, and the radii of some.
EYE = (0.06, 0.255, 0.139)
NOSE = (0, 0.218, 0.208), (0.03, 0.021, 0.02)
MUZZLE = (0, 0.19, 0.135), (0.082, 0.066, 0.072)
EAR_HOLLOW = (0.127, 0.352, 0.05), 0.042
SCARF_HEIGHT, SMILE_HEIGHT = 0.075, 0.163
BLACK = rgb("2a211d")


def distance(points: Array) -> Array:
    """Signed distance: a body the same left and right, and a scarf."""
    half = _mirrored(points)
    return unite(_body(half), _face(half), _scarf(points))


def _body(half: Array) -> Array:
    """Trunk, head with ears, arms and legs, one mirrored half."""
    trunk = ellipsoid(half, (0, -0.1, 0), (0.165, 0.2, 0.14))
    neck = sphere(half, (0, SCARF_HEIGHT, 0), 0.1)
    head = ellipsoid(half, (0, 0.225, 0), (0.172, 0.155, 0.15))
    ear = ellipsoid(half, (0.125, 0.35, -0.005), (0.062, 0.062, 0.036))
    ear = subtract(ear, sphere(half, *EAR_HOLLOW), blend=0.012)
    arm = limb(half, (0.13, 0.01, 0.01), (0.275, -0.11, 0.06), (0.058, 0.062))
    leg = limb(half, (0.098, -0.22, 0), (0.135, -0.375, 0.015), (0.078, 0.068))
    foot = ellipsoid(half, (0.142, -0.39, 0.055), (0.07, 0.06, 0.105))
    body = unite(trunk, neck, head, blend=0.03)
    body = unite(body, ear, arm, blend=0.02)
    return unite(body, unite(leg, foot, blend=0.03), blend=0.025)


def _face(half: Array) -> Array:
    """Muzzle, nose and eyes, one mirrored half."""
    muzzle = ellipsoid(half, *MUZZLE)
    nose = ellipsoid(half, *NOSE)
    return unite(muzzle, nose, sphere(half, EYE, 0.023), blend=0.004)


def _scarf(points: Array) -> Array:
    """A ring around the neck with one end hanging down in front."""
    around = points * np.float32([1, 1, 1.08])
    collar = ring(around, (0, SCARF_HEIGHT, 0), 1, 0.118, 0.036)
    end = limb(points, (0.075, 0.06, 0.125), (0.1, -0.075, 0.125), (0.026, 0.036))
    return unite(collar, end, blend=0.012)


def paint(points: Array) -> Array:
    """Brown wool with lighter patches, a striped scarf, black eyes and nose."""
    half = _mirrored(points)
    skin = coat(points, rgb("a86a34"), 0.03)
    cover(skin, 1 - step(0.003, _patches(half), 0.008), rgb("e9cf9f"), 0)
    wool = 0.10 * speckle(points, 0.008) + 0.09 * speckle(points, 0.02, seed=1)
    skin[:, :3] *= 1 + wool[:, None]
    _paint_scarf(skin, points)
    _paint_mouth(skin, half)
    cover(skin, 1 - step(0.025, sphere(half, EYE, 0)), BLACK, 1.0)
    cover(skin, 1 - step(0.002, ellipsoid(half, *NOSE)), BLACK, 0.6)
    return skin


def _patches(half: Array) -> Array:
    """Distance to what is light: muzzle, belly, toes and the insides of the ears."""
    belly = ellipsoid(half, (0, -0.11, 0.15), (0.1, 0.13, 0.08))
    toes = ellipsoid(half, (0.142, -0.385, 0.16), (0.045, 0.042, 0.04))
    return unite(ellipsoid(half, *MUZZLE), belly, toes, sphere(half, *EAR_HOLLOW))


def _paint_mouth(skin: Array, half: Array) -> None:
    """A smile below the nose, and the line from it up to the nose."""
    x, y, z = half.T
    smile = band(-0.0035, 0.0035, y - SMILE_HEIGHT - 14 * x**2) * (x < 0.036)
    line = band(SMILE_HEIGHT, NOSE[0][1], y) * (x < 0.003)
    cover(skin, (smile + line) * (z > 0.16), rgb("4a2c1a"), 0)


def _paint_scarf(skin: Array, points: Array) -> None:
    """Red with white stripes, across the collar and across the hanging end."""
    wool = 1 - step(0.003, _scarf(points), 0.003)
    x, y, z = points.T
    along = np.where(y > 0.035, np.arctan2(x, z) / 0.35, y / 0.035)
    stripes = band(0.3, 0.55, along % 1.0, 0.05)
    cover(skin, wool, rgb("c8323a"), 0.05)
    cover(skin, wool * stripes, rgb("f3ead9"), 0.05)


def _mirrored(points: Array) -> Array:
    """The points, those of the bear's right half moved to its left."""
    return np.stack([np.abs(points[:, 0]), points[:, 1], points[:, 2]], axis=1)
