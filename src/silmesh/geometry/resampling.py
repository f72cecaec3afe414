"""An image seen at other places than its pixels: bilinear and bicubic, in numba.

Where the pixels of the new image lie in the old one is given at some of them, evenly spaced from
the first to the last along both sides; between these it is interpolated along lines.
"""

import numpy as np
from numba import njit

ROWS = 64  # of the new image at a time, which bounds the memory
SHARPNESS = -0.75  # the slope of the bicubic kernel one pixel away (Keys 1981), as in torch


def resample(
    image: np.ndarray, sources: np.ndarray, shape: tuple[int, int], cubic: bool = False
) -> np.ndarray:
    """An image at other places; zero beyond it.

    Args:
        image: [height, width] or [height, width, channels]; bool, uint8 or float32
        sources: [rows, columns, 2], x and y of places in it, in pixels: of every new pixel's centre
            if ``shape`` is [rows, columns], and else of some; NaN for nowhere, if of every one
        shape: height and width of the new image
        cubic: whether the old pixels are joined by cubic curves and not by lines
    Returns:
        [*shape] or [*shape, channels] of the same type; bool where at least half is
    """
    planes = image.view(np.uint8) if image.dtype == bool else image
    planes = planes.reshape(*image.shape[:2], -1)
    found = np.empty((*shape, planes.shape[2]), image.dtype)
    places = np.ascontiguousarray(sources, np.float64)
    for top in range(0, shape[0], ROWS):
        into = found[top : top + ROWS]
        values = np.empty(into.shape, np.float32)
        _resample(planes, places, top, shape[0], cubic, values)
        if image.dtype == bool:
            into[:] = values >= 0.5
        elif image.dtype == np.uint8:
            into[:] = values.round().clip(0, 255)
        else:
            into[:] = values
    return found.reshape(*shape, *image.shape[2:])


@njit(nogil=True, cache=True, error_model="numpy")
def _resample(image, sources, top, tall, cubic, out):
    """The rows from ``top`` on of a new image that is ``tall``."""
    width = out.shape[1]
    rows, columns = sources.shape[:2]
    down = (rows - 1) / max(tall - 1, 1)
    across = (columns - 1) / max(width - 1, 1)
    places = np.empty((columns, 2))
    for i in range(len(out)):
        y = min((top + i) * down, rows - 1.0)
        row = int(y)
        b = y - row
        places[:] = sources[row]
        if b > 0:  # what has no share is not looked at, and may be NaN
            for column in range(columns):
                for k in range(2):
                    places[column, k] += b * (sources[row + 1, column, k] - places[column, k])
        for j in range(width):
            x = min(j * across, columns - 1.0)
            column = int(x)
            a = x - column
            u, v = places[column]
            if a > 0:
                u += a * (places[column + 1, 0] - u)
                v += a * (places[column + 1, 1] - v)
            if cubic:
                _look_cubic(image, u - 0.5, v - 0.5, out[i, j])
            else:
                _look(image, u - 0.5, v - 0.5, out[i, j])


@njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _look(image, x, y, out):
    """Bilinear; NaN lies nowhere."""
    height, width, channels = image.shape
    if not (-1 < x < width and -1 < y < height):
        out[:] = 0
        return
    left, top = int(x + 1) - 1, int(y + 1) - 1
    a, b = x - left, y - top
    if 0 <= left < width - 1 and 0 <= top < height - 1:
        for k in range(channels):
            upper = (1 - a) * image[top, left, k] + a * image[top, left + 1, k]
            lower = (1 - a) * image[top + 1, left, k] + a * image[top + 1, left + 1, k]
            out[k] = (1 - b) * upper + b * lower
        return
    out[:] = 0
    for row in range(max(top, 0), min(top + 2, height)):
        down = b if row > top else 1 - b
        for column in range(max(left, 0), min(left + 2, width)):
            share = down * (a if column > left else 1 - a)
            for k in range(channels):
                out[k] += share * image[row, column, k]


@njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _look_cubic(image, x, y, out):
    """Bicubic; NaN lies nowhere."""
    height, width, channels = image.shape
    out[:] = 0
    if not (-2 < x < width + 1 and -2 < y < height + 1):
        return
    left, top = int(x + 2) - 2, int(y + 2) - 2
    a, b = x - left, y - top
    across = _far(1 + a), _near(a), _near(1 - a), _far(2 - a)
    down = _far(1 + b), _near(b), _near(1 - b), _far(2 - b)
    if 1 <= left < width - 2 and 1 <= top < height - 2:
        for k in range(channels):
            value = 0.0
            for i in range(4):
                row = top - 1 + i
                value += down[i] * (
                    across[0] * image[row, left - 1, k]
                    + across[1] * image[row, left, k]
                    + across[2] * image[row, left + 1, k]
                    + across[3] * image[row, left + 2, k]
                )
            out[k] = value
        return
    for i in range(4):
        for j in range(4):
            row, column = top - 1 + i, left - 1 + j
            if 0 <= row < height and 0 <= column < width:
                for k in range(channels):
                    out[k] += down[i] * across[j] * image[row, column, k]


@njit(nogil=True, cache=True, error_model="numpy")
def _near(d):
    """The bicubic kernel up to a pixel away."""
    return ((SHARPNESS + 2) * d - (SHARPNESS + 3)) * d * d + 1


@njit(nogil=True, cache=True, error_model="numpy")
def _far(d):
    """The same between one and two pixels away."""
    return (((d - 5) * d + 8) * d - 4) * SHARPNESS
