"""An apricot: small and beside the turntable's axis, where a first sphere covers it badly."""

import numpy as np

from silmesh.synthetic.paints import Array, cover, mix, rgb, speckle, step
from silmesh.synthetic.solids import ellipsoid, limb, subtract, unite

CENTRE = np.float32([0.075, -0.28, 0.065])
RADII = np.float32([0.118, 0.112, 0.122])
BOX = (tuple(CENTRE - 0.16), tuple(CENTRE + 0.16))
VOXEL = 0.0045

# From the fruit's centre.
STEM = (0.0, 0.085, 0.0), (0.014, 0.128, 0.004), (0.0095, 0.0075)  # ends, and radii there
LEAF = (0.052, 0.122, 0.012)


def distance(points: Array) -> Array:
    """Signed distance: a round fruit with a crease and a dimple, a stem and a leaf."""
    at = points - CENTRE
    fruit = ellipsoid(at, (0, 0, 0), RADII)
    crease = _crease_depth(at)
    dimple = ellipsoid(at, (0, 0.118, 0), (0.05, 0.026, 0.05))
    fruit = subtract(fruit + 0.013 * crease, dimple, blend=0.03)
    stem = limb(at, *STEM)
    return unite(unite(fruit, stem, blend=0.012), _leaf(at), blend=0.008)


def paint(points: Array) -> Array:
    """Orange, with a red blush on the sunny side and freckles; a brown stem, a green leaf."""
    at = points - CENTRE
    up = at / np.linalg.norm(at, axis=1, keepdims=True)
    mottle = 0.6 * speckle(at, 0.03) + 0.4 * speckle(at, 0.009, seed=1)
    colour = np.broadcast_to(rgb("f49a2c"), at.shape)
    colour = mix(colour, rgb("f7b544"), 0.5 - 0.5 * up[:, 1] + 0.2 * mottle)
    blush = up @ np.float32([0.62, 0.38, 0.68]) + 0.28 * mottle
    colour = mix(colour, rgb("e2602a"), step(0.35, blush, 0.9))
    colour = mix(colour, rgb("c03a26"), 0.75 * step(0.75, blush, 0.7))
    colour = mix(colour, rgb("b4461f"), 0.4 * _crease_depth(at))
    colour = mix(colour, rgb("a83a1c"), 0.55 * step(0.62, speckle(at, 0.006, seed=2), 0.25) * blush)
    skin = np.concatenate([colour, np.full((len(at), 1), 0.22, dtype="f4")], axis=1)
    cover(skin, 1 - step(0.002, limb(at, *STEM), 0.004), rgb("7a5632"), 0.1)
    vein = np.abs(at[:, 2] - LEAF[2]) < 0.0022
    green = mix(np.broadcast_to(rgb("5f9a3a"), at.shape), rgb("a5cc74"), vein.astype("f4"))
    leaf = 1 - step(0.002, _leaf(at), 0.003)
    skin[:, :3] = mix(skin[:, :3], green, leaf)
    return skin.astype(np.float32)


def _crease_depth(at: Array) -> Array:
    """1 in the crease that runs from the stem down one side, 0 away from it."""
    front = np.clip(at[:, 2] / 0.04 + 0.6, 0, 1)
    return front * np.exp(-((at[:, 0] / 0.016) ** 2))


def _leaf(at: Array) -> Array:
    """A thin leaf that bends down away from the stem."""
    x, y, z = at.T
    drop = 3 * np.maximum(x, 0) ** 2 - 4 * (z - LEAF[2]) ** 2  # its edges rise to a trough
    return ellipsoid(np.stack([x, y + drop, z], axis=1), LEAF, (0.052, 0.0075, 0.026))
