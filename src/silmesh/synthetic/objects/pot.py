"""A glazed pot with a lid and two handles: large, and low in the picture."""

import numpy as np

from silmesh.synthetic.paints import Array, band, coat, cover, rgb, step
from silmesh.synthetic.solids import ellipsoid, lathe, ring, round_corners, unite

BOX = ((-0.51, -0.46, -0.42), (0.51, 0.25, 0.42))
VOXEL = 0.012

BODY = round_corners(
    [(0, -0.43), (0.21, -0.43), (0.225, -0.425), (0.225, -0.405), (0.29, -0.38), (0.4, -0.27),
     (0.4, -0.13), (0.33, -0.03), (0.3, 0.0), (0.3, 0.03), (0.33, 0.035), (0.33, 0.055), (0, 0.06)]
)  # fmt: skip
LID = round_corners(
    [(0, 0.05), (0.29, 0.05), (0.312, 0.055), (0.312, 0.08), (0.25, 0.1), (0.14, 0.145),
     (0.05, 0.15), (0.028, 0.16), (0.028, 0.18), (0, 0.18)]
)  # fmt: skip
FLOWERS = 10  # around the belly
BELLY = 0.38  # its radius about where they are


def distance(points: Array) -> Array:
    """Signed distance: body, lid and knob turned on a lathe, two rings as handles."""
    body = unite(lathe(points, BODY), lathe(points, LID), blend=0.02)
    knob = ellipsoid(points, (0, 0.2, 0), (0.052, 0.036, 0.052))
    return unite(unite(body, knob, blend=0.015), _handles(points), blend=0.02)


def _handles(points: Array) -> Array:
    """Distance to the two rings."""
    return unite(*(ring(points, (x, -0.085, 0), 2, 0.074, 0.023) for x in (-0.388, 0.388)))


def paint(points: Array) -> Array:
    """White glaze with blue bands, a frieze of flowers and a bare foot of clay."""
    x, y, z = points.T
    angle, out = np.arctan2(x, z), np.hypot(x, z)
    petals, hearts = _flowers(angle, y)
    belly = band(-0.3, 0.0, y) * (out > 0.25)
    knob = step(0.162, y) * (out < 0.1)
    handles = 1 - step(0.004, _handles(points))
    skin = coat(points, rgb("f1ead8"), 0.8)
    cover(skin, petals * belly + _bands(angle, y) + knob + handles, rgb("1d4596"), 0.8)
    cover(skin, hearts * belly * (1 - handles), rgb("e08a2e"), 0.8)
    cover(skin, 1 - step(-0.405, y), rgb("a9673f"), 0.1)
    return skin


def _bands(angle: Array, y: Array) -> Array:
    """1 on the bands around foot, belly, neck, rim and lid, and on the wave above the foot."""
    edges = [(-0.31, -0.295), (-0.29, -0.283), (-0.04, -0.033), (-0.025, 0.0), (0.032, 0.054),
             (0.095, 0.104)]  # fmt: skip
    wave = band(-0.355, -0.335, y + 0.012 * np.sin(3 * FLOWERS * angle))
    return wave + sum(band(low, high, y) for low, high in edges)


def _flowers(angle: Array, y: Array) -> tuple[Array, Array]:
    """Petals and hearts of a row of flowers around the belly, each 1 where they are."""
    turn = angle / (2 * np.pi) * FLOWERS
    across = (turn - np.round(turn)) * (2 * np.pi * BELLY / FLOWERS)
    up = y + 0.165
    out, around = np.hypot(across, up), np.arctan2(up, across)
    petals = 1 - step(0.0, out - 0.055 * (0.62 + 0.38 * np.cos(6 * around)), 0.003)
    dots = 1 - step(0.012, np.hypot(np.abs(across) - np.pi * BELLY / FLOWERS, up), 0.003)
    hearts = 1 - step(0.016, out, 0.003)
    return petals * (1 - hearts), np.maximum(hearts, dots)
