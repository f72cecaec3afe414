"""An image seen at other places than its pixels: bilinear and bicubic, in numba.

Where the pixels of the new image lie in the old one is given at some of them, evenly spaced from
the first to the last along both sides; between these it is interpolated along lines.
"""

import numpy as np
from numba import njit

from silmesh.geometry.frame import find_box

ROWS = 64  # of the new image at a time, which bounds the memory
SHARPNESS = np.float32(-0.75)  # slope of the bicubic kernel a pixel away (Keys 1981), as in torch


def resample(
    image: np.ndarray,
    sources: np.ndarray,
    shape: tuple[int, int],
    cubic: bool = False,
    part: tuple[int, int, int, int] | None = None,
) -> np.ndarray:
    """An image at other places; zero beyond it.

    Args:
        image: [height, width] or [height, width, channels]; bool, uint8 or float32
        sources: [rows, columns, 2], x and y of places in it, in pixels: of every new pixel's centre
            if ``shape`` is [rows, columns], and else of some; NaN for nowhere, if of every one
        shape: height and width of the new image
        cubic: whether the old pixels are joined by cubic curves and not by lines
        part: left, top, right and bottom of what is asked of the new image, which is zero beyond;
            all if not given
    Returns:
        [*shape] or [*shape, channels] of the same type; bool where at least half is
    """
    places = np.ascontiguousarray(sources, np.float64)
    if image.dtype == bool:
        image, places = _crop(image, places)
    planes = np.atleast_3d(image.view(np.uint8) if image.dtype == bool else image)
    found = np.zeros((*shape, planes.shape[2]), image.dtype)
    left, top, right, bottom = part or (0, 0, shape[1], shape[0])
    for start in range(top, bottom, ROWS):
        into = found[start : min(start + ROWS, bottom), left:right]
        values = np.empty(into.shape, np.float32)
        _resample(planes, places, (start, left), shape, cubic, values)
        if image.dtype == bool:
            into[:] = values >= 0.5
        elif image.dtype == np.uint8:
            into[:] = values.round().clip(0, 255)
        else:
            into[:] = values
    return found.reshape(*shape, *image.shape[2:])


def _crop(image: np.ndarray, sources: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The part of a mask that is not empty, and the places in it: beyond it a mask is zero too."""
    left, top, right, bottom = find_box(image)
    return image[top:bottom, left:right], sources - [left, top]


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _resample(image, sources, corner, shape, cubic, out):
    """What lies from a corner, row and column, on in a new image of a shape."""
    down = (sources.shape[0] - 1) / max(shape[0] - 1, 1)
    across = (sources.shape[1] - 1) / max(shape[1] - 1, 1)
    places = np.empty((out.shape[1], 2))
    for i in range(len(out)):
        _follow(sources, (corner[0] + i) * down, corner[1], across, places)
        if cubic:
            _look_cubic(image, places, out[i])
        else:
            _look(image, places, out[i])


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _follow(sources, y, first, across, out):
    """Where the pixels of a row lie in the old image, counted from the middle of its first."""
    rows, columns = sources.shape[:2]
    y = min(y, rows - 1.0)
    row = int(y)
    b = y - row
    line = sources[row].copy()
    if b > 0:  # what has no share is not looked at, and may be NaN
        for column in range(columns):
            for k in range(2):
                line[column, k] += b * (sources[row + 1, column, k] - line[column, k])
    for j in range(len(out)):
        x = min((first + j) * across, columns - 1.0)
        column = int(x)
        a = x - column
        u, v = line[column]
        if a > 0:
            u += a * (line[column + 1, 0] - u)
            v += a * (line[column + 1, 1] - v)
        out[j, 0], out[j, 1] = u - 0.5, v - 0.5


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _look(image, places, out):
    """A row, bilinear; NaN lies nowhere."""
    height, width, channels = image.shape
    for j in range(len(out)):
        x, y = places[j]
        if not (-1 < x < width and -1 < y < height):
            for k in range(channels):
                out[j, k] = 0
            continue
        left, top = int(x + 1) - 1, int(y + 1) - 1
        a, b = np.float32(x - left), np.float32(y - top)
        if 0 <= left < width - 1 and 0 <= top < height - 1:
            for k in range(channels):
                upper = np.float32(image[top, left, k])
                lower = np.float32(image[top + 1, left, k])
                upper += a * (np.float32(image[top, left + 1, k]) - upper)
                lower += a * (np.float32(image[top + 1, left + 1, k]) - lower)
                out[j, k] = upper + b * (lower - upper)
            continue
        for k in range(channels):
            out[j, k] = 0
        for row in range(max(top, 0), min(top + 2, height)):
            down = b if row > top else 1 - b
            for column in range(max(left, 0), min(left + 2, width)):
                share = down * (a if column > left else 1 - a)
                for k in range(channels):
                    out[j, k] += share * image[row, column, k]


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _look_cubic(image, places, out):
    """A row, bicubic; NaN lies nowhere."""
    height, width, channels = image.shape
    for j in range(len(out)):
        x, y = places[j]
        # The edge has a function of its own, or sums and shares would not stay in registers here.
        if not (1 <= x < width - 2 and 1 <= y < height - 2):
            _look_at_edge(image, x, y, out[j])
            continue
        left, top = int(x), int(y)
        a, b, c, d = _weigh(np.float32(x - left))
        first, second, third, last = _weigh(np.float32(y - top))
        for k in range(channels):
            out[j, k] = (
                first * _look_across(image[top - 1], left, a, b, c, d, k)
                + second * _look_across(image[top], left, a, b, c, d, k)
                + third * _look_across(image[top + 1], left, a, b, c, d, k)
                + last * _look_across(image[top + 2], left, a, b, c, d, k)
            )


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _look_across(row, left, a, b, c, d, k):
    """A channel of four pixels of a row, from the one before ``left`` on, in these shares."""
    return (
        a * np.float32(row[left - 1, k])
        + b * np.float32(row[left, k])
        + c * np.float32(row[left + 1, k])
        + d * np.float32(row[left + 2, k])
    )


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _look_at_edge(image, x, y, out):
    """One place, bicubic, some of whose pixels may lie beyond the image; NaN lies nowhere."""
    height, width, channels = image.shape
    out[:] = 0
    if not (-2 < x < width + 1 and -2 < y < height + 1):
        return
    left, top = int(x + 2) - 2, int(y + 2) - 2
    across, down = _weigh(np.float32(x - left)), _weigh(np.float32(y - top))
    for i in range(4):
        for n in range(4):
            row, column = top - 1 + i, left - 1 + n
            if 0 <= row < height and 0 <= column < width:
                for k in range(channels):
                    out[k] += down[i] * across[n] * image[row, column, k]


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _weigh(d):
    """The bicubic weights of the four pixels about a place, float32, d beyond the second."""
    one = np.float32(1)
    return _far(one + d), _near(d), _near(one - d), _far(np.float32(2) - d)


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _near(d):
    """The bicubic kernel up to a pixel away."""
    return ((SHARPNESS + np.float32(2)) * d - (SHARPNESS + np.float32(3))) * d * d + np.float32(1)


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _far(d):
    """The same between one and two pixels away."""
    return (((d - np.float32(5)) * d + np.float32(8)) * d - np.float32(4)) * SHARPNESS
