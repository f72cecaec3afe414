"""Pixels of an image between its own, bilinear, and a photograph laid on texels, in numba."""

import numpy as np
from numba import njit


def sample_all(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """An image [height, width, 3] at pixels [n, 2], its edge repeated: [n, 3] float64."""
    found = np.empty((len(pixels), 3))
    _sample_all(image, pixels, found)
    return found


@njit(nogil=True, cache=True, error_model="numpy")
def _sample(image, x, y, out):
    height, width = image.shape[:2]
    x, y = min(max(x - 0.5, 0.0), width - 1.0), min(max(y - 0.5, 0.0), height - 1.0)
    left, top = int(x), int(y)
    right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
    a, b = x - left, y - top
    for k in range(3):
        upper = (1 - a) * image[top, left, k] + a * image[top, right, k]
        lower = (1 - a) * image[bottom, left, k] + a * image[bottom, right, k]
        out[k] = (1 - b) * upper + b * lower


@njit(nogil=True, cache=True, error_model="numpy")
def _sample_all(image, pixels, out):
    for i in range(len(pixels)):
        _sample(image, pixels[i, 0], pixels[i, 1], out[i])


@njit(nogil=True, cache=True, error_model="numpy")
def add_view(
    on, corners, faces, verts, shares, P, numbers, depth, margin, photograph, slow, gain, slow_out,
    fast_out,
):  # fmt: skip
    """Add what one view says of some texels to sums of colours and weights.

    Args:
        on, corners: [texels] the triangle of each, and [texels, 3] the weights of its corners
        faces, verts: [faces, 3] and [verts, 3], of the mesh
        shares: [2, verts] weights of the slow colours and of the detail
        P: [3, 4] projection to pixels of the photograph
        numbers: pixels of the maps a pixel of the photograph; slack of the depth; distances to an
            outline between which a view's weight rises; pixels of the photograph a slow pixel,
            across and down
        depth, margin: [height, width] maps of ``visibility.Sight``
        photograph: [height, width, 3] uint8
        slow: [height, width, 3], its slow band
        gain: [3] that its colours are multiplied by
        slow_out, fast_out: [texels, 4] sums of weighted colours, and of their weights
    """
    scale, slack, near, far, across, down = numbers
    height, width = depth.shape
    fine, coarse = np.empty(3), np.empty(3)
    for i in range(len(on)):
        a, b, c = faces[on[i]]
        u, v, w = corners[i]
        weight = u * shares[0, a] + v * shares[0, b] + w * shares[0, c]
        if weight <= 0:
            continue
        detail = u * shares[1, a] + v * shares[1, b] + w * shares[1, c]
        X = u * verts[a, 0] + v * verts[b, 0] + w * verts[c, 0]
        Y = u * verts[a, 1] + v * verts[b, 1] + w * verts[c, 1]
        Z = u * verts[a, 2] + v * verts[b, 2] + w * verts[c, 2]
        z = P[2, 0] * X + P[2, 1] * Y + P[2, 2] * Z + P[2, 3]
        x = (P[0, 0] * X + P[0, 1] * Y + P[0, 2] * Z + P[0, 3]) / z
        y = (P[1, 0] * X + P[1, 1] * Y + P[1, 2] * Z + P[1, 3]) / z
        row, column = int(np.floor(y * scale)), int(np.floor(x * scale))
        if not (0 <= row < height and 0 <= column < width) or z > depth[row, column] + slack:
            continue
        rise = min(1.0, (margin[row, column] / scale - near) / (far - near))
        if rise <= 0:
            continue
        _sample(slow, x / across, y / down, coarse)
        weight *= rise
        slow_out[i, 3] += weight
        for k in range(3):
            slow_out[i, k] += weight * gain[k] * coarse[k]
        if detail > 0:
            detail *= rise
            _sample(photograph, x, y, fine)
            fast_out[i, 3] += detail
            for k in range(3):
                fast_out[i, k] += detail * gain[k] * (fine[k] - coarse[k])
