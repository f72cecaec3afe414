"""Pixels of an image between its own, bilinear, in numba."""

import numpy as np
from numba import njit


def sample_all(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """An image [height, width, 3] at pixels [n, 2], its edge repeated: [n, 3] float64."""
    found = np.empty((len(pixels), 3))
    _sample_all(image, pixels, found)
    return found


@njit(nogil=True, error_model="numpy")
def sample(image, x, y, out):
    """An image [height, width, 3] at one pixel, its edge repeated, into ``out`` [3]."""
    height, width = image.shape[:2]
    x, y = min(max(x - 0.5, 0.0), width - 1.0), min(max(y - 0.5, 0.0), height - 1.0)
    left, top = int(x), int(y)
    right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
    a, b = x - left, y - top
    for k in range(3):
        upper = (1 - a) * image[top, left, k] + a * image[top, right, k]
        lower = (1 - a) * image[bottom, left, k] + a * image[bottom, right, k]
        out[k] = (1 - b) * upper + b * lower


@njit(nogil=True, error_model="numpy")
def _sample_all(image, pixels, out):
    for i in range(len(pixels)):
        sample(image, pixels[i, 0], pixels[i, 1], out[i])
