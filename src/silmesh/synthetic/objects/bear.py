"""A teddy bear that stands with its legs apart: a gap between them, open below."""

import numpy as np

from silmesh.synthetic.paints import Array, band, coat, cover, rgb, speckle, step
from silmesh.synthetic.solids import ellipsoid, limb, ring, sphere, subtract, unite

BOX = ((-0.36, -0.47, -0.22), (0.36, 0.44, 0.26))
VOXEL = 0.011

EYES = ((-0.06, 0.255, 0.139), (0.06, 0.255, 0.139))
NOSE = (0, 0.218, 0.208)
MUZZLE = (0, 0.19, 0.135)
SCARF_HEIGHT = 0.075


def distance(points: Array) -> Array:
    """Signed distance, of one half mirrored: the bear is the same left and right."""
    half = np.stack([np.abs(points[:, 0]), points[:, 1], points[:, 2]], axis=1)
    return unite(_body(half), _face(half), _scarf(points))


def _body(half: Array) -> Array:
    """Trunk, head with ears, arms and legs, one mirrored half."""
    trunk = ellipsoid(half, (0, -0.1, 0), (0.165, 0.2, 0.14))
    neck = sphere(half, (0, SCARF_HEIGHT, 0), 0.1)
    head = ellipsoid(half, (0, 0.225, 0), (0.172, 0.155, 0.15))
    ear = ellipsoid(half, (0.125, 0.35, -0.005), (0.062, 0.062, 0.036))
    ear = subtract(ear, sphere(half, (0.127, 0.352, 0.05), 0.042), blend=0.012)
    arm = limb(half, (0.13, 0.01, 0.01), (0.275, -0.11, 0.06), (0.058, 0.062))
    leg = limb(half, (0.098, -0.22, 0), (0.135, -0.375, 0.015), (0.078, 0.068))
    foot = ellipsoid(half, (0.142, -0.39, 0.055), (0.07, 0.06, 0.105))
    body = unite(trunk, neck, head, blend=0.03)
    body = unite(body, ear, arm, blend=0.02)
    return unite(body, unite(leg, foot, blend=0.03), blend=0.025)


def _face(half: Array) -> Array:
    """Muzzle, nose and eyes, one mirrored half."""
    muzzle = ellipsoid(half, MUZZLE, (0.082, 0.066, 0.072))
    nose = ellipsoid(half, NOSE, (0.03, 0.021, 0.02))
    return unite(muzzle, nose, sphere(half, EYES[1], 0.023), blend=0.004)


def _scarf(points: Array) -> Array:
    """A ring around the neck with one end hanging down in front."""
    around = points * np.float32([1, 1, 1.08])
    collar = ring(around, (0, SCARF_HEIGHT, 0), 1, 0.118, 0.036)
    end = limb(points, (0.075, 0.06, 0.125), (0.1, -0.075, 0.125), (0.026, 0.036))
    return unite(collar, end, blend=0.012)


def paint(points: Array) -> Array:
    """Brown wool, lighter muzzle, ears, belly and soles; a striped scarf, black eyes and nose."""
    half = np.stack([np.abs(points[:, 0]), points[:, 1], points[:, 2]], axis=1)
    light = rgb("e9cf9f")
    paint = coat(points, rgb("a86a34"), 0.03)
    cover(
        paint, 1 - step(0.0, ellipsoid(half, (0, -0.11, 0.15), (0.1, 0.13, 0.08)), 0.008), light, 0
    )
    cover(paint, 1 - step(0.006, ellipsoid(half, MUZZLE, (0.082, 0.066, 0.072)), 0.006), light, 0)
    cover(
        paint,
        1 - step(0.043, np.linalg.norm(half - np.float32([0.127, 0.352, 0.05]), axis=1), 0.006),
        light,
        0,
    )
    cover(
        paint,
        1 - step(0.0, ellipsoid(half, (0.142, -0.385, 0.16), (0.045, 0.042, 0.04)), 0.006),
        light,
        0,
    )
    paint[:, :3] *= (
        1 + (0.10 * speckle(points, 0.008) + 0.09 * speckle(points, 0.02, seed=1))[:, None]
    )
    smile = points[:, 1] - 0.163 - 14 * points[:, 0] ** 2
    mouth = band(-0.0035, 0.0035, smile) * (half[:, 0] < 0.036) + (half[:, 0] < 0.003) * band(
        0.163, 0.2, points[:, 1]
    )
    cover(paint, mouth * (points[:, 2] > 0.16), rgb("4a2c1a"), 0)
    _paint_scarf(paint, points)
    black = rgb("2a211d")
    for eye in EYES:
        cover(paint, 1 - step(0.025, np.linalg.norm(points - np.float32(eye), axis=1)), black, 1.0)
    cover(paint, 1 - step(0.002, ellipsoid(half, NOSE, (0.03, 0.021, 0.02))), black, 0.6)
    return paint


def _paint_scarf(paint: Array, points: Array) -> None:
    """Red with white stripes, across the collar and across the hanging end."""
    wool = 1 - step(0.003, _scarf(points), 0.003)
    angle = np.arctan2(points[:, 0], points[:, 2])
    along = np.where(points[:, 1] > 0.035, angle / 0.35, points[:, 1] / 0.035)
    stripes = band(0.3, 0.55, along - np.floor(along), 0.05)
    cover(paint, wool, rgb("c8323a"), 0.05)
    cover(paint, wool * stripes, rgb("f3ead9"), 0.05)
    paint[:, :3] *= 1 + (0.06 * speckle(points, 0.006, seed=2) * wool)[:, None]
