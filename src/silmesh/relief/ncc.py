"""How alike two photographs are about a point, if the surface there is a given plane.

Normalised cross-correlation over a window of RADIUS pixels about a pixel of one view, of which
every second is taken, as on a chess board. The plane through the point X with the normal n carries
the window into another view by a homography, which over so few pixels is its value and its slopes
at the middle:

    x(p) = X(p) on the plane,  dX/du = z (k_u - x (n . k_u) / (n . x)),  x = K^-1 (u, v, 1)
    u' = p_0 / p_2,            du'/du = (dp_0/du - u' dp_2/du) / p_2,     p = K' (R' X + t')

Everything is in the axes of the first view's camera. Pixel centres are whole numbers here.
"""

import math

import numpy as np
from numba import njit

RADIUS = 3
FLAT = 1.0  # grey levels: a window of a smaller standard deviation shows nothing
OPTIONS = {"nogil": True, "cache": True, "error_model": "numpy", "fastmath": {"contract"}}


@njit(**OPTIONS)
def sample(image, u, v):
    """An image [height, width], bilinear, at a place within it."""
    c, r = int(u), int(v)
    u, v = u - np.float32(c), v - np.float32(r)
    above = image[r, c] + u * (image[r, c + 1] - image[r, c])
    below = image[r + 1, c] + u * (image[r + 1, c + 1] - image[r + 1, c])
    return above + v * (below - above)


@njit(**OPTIONS)
def gather(image, mask, c, r, values, weights):
    """The window about a pixel: values less their mean, weights (1 on the object), and their sums.

    Returns:
        sum of the weights, and standard deviation of the values
    """
    total = np.float32(0)
    mean = np.float32(0)
    k = 0
    for j in range(-RADIUS, RADIUS + 1):
        for i in range(-RADIUS + (j + RADIUS) % 2, RADIUS + 1, 2):
            row, column = r + j, c + i
            within = 0 <= row < image.shape[0] and 0 <= column < image.shape[1]
            w = np.float32(1) if within and mask[row, column] else np.float32(0)
            values[k] = image[row, column] if within else np.float32(0)
            weights[k] = w
            total += w
            mean += w * values[k]
            k += 1
    mean /= max(total, np.float32(1))
    square = np.float32(0)
    for k in range(len(values)):
        values[k] -= mean
        square += weights[k] * values[k] ** 2
    return total, math.sqrt(square / max(total, np.float32(1)))


@njit(**OPTIONS)
def find_detail(values, weights, total):
    """Standard deviation of a window from its best slope, which fits itself wherever it is moved.

    Args:
        values, weights, total: as ``gather`` makes them
    """
    square = across = down = np.float32(0)
    across2 = down2 = np.float32(1e-6)
    k = 0
    for j in range(-RADIUS, RADIUS + 1):
        for i in range(-RADIUS + (j + RADIUS) % 2, RADIUS + 1, 2):
            w = weights[k]
            square += w * values[k] ** 2
            across += w * values[k] * i
            down += w * values[k] * j
            across2 += w * i * i
            down2 += w * j * j
            k += 1
    left = square - across * across / across2 - down * down / down2
    return math.sqrt(max(left, np.float32(0)) / max(total, np.float32(1)))


@njit(**OPTIONS)
def correlate(values, weights, total, deviation, image, u, v, du, dv):
    """Normalised cross-correlation of a window with another image, -1 where that shows nothing.

    Args:
        values, weights, total, deviation: as ``gather`` makes them
        image: [height, width] float32
        u, v: where the window's middle lies in it
        du, dv: [2] how u and v change by a pixel across and by one down
    """
    reach = RADIUS * (abs(du[0]) + abs(du[1])), RADIUS * (abs(dv[0]) + abs(dv[1]))
    height, width = image.shape
    if not (reach[0] <= u < width - 1 - reach[0] and reach[1] <= v < height - 1 - reach[1]):
        return np.float32(-1)
    mean = np.float32(0)
    square = np.float32(0)
    product = np.float32(0)
    u, v = np.float32(u), np.float32(v)
    a, b, c, d = np.float32(du[0]), np.float32(du[1]), np.float32(dv[0]), np.float32(dv[1])
    k = 0
    for j in range(-RADIUS, RADIUS + 1):
        for i in range(-RADIUS + (j + RADIUS) % 2, RADIUS + 1, 2):
            value = sample(image, u + a * i + b * j, v + c * i + d * j)
            w = weights[k]
            mean += w * value
            square += w * value * value
            product += w * value * values[k]
            k += 1
    mean /= total
    other = math.sqrt(max(square / total - mean * mean, np.float32(0)))
    if other < FLAT:
        return np.float32(-1)
    return np.float32(product / (total * other * deviation))


@njit(**OPTIONS)
def carry(back, A, b, column, row, depth, normal, du, dv):
    """Where another view sees the middle of a window, and fills how that changes by a pixel.

    Args:
        back: [3, 3], inverse intrinsics of the first view
        A, b: [3, 3] and [3] from the first camera's axes to homogeneous pixels of the other view
        column, row: the middle
        depth: of its point, along the first camera's axis
        normal: [3] of the plane, in the first camera's axes
    Returns:
        u, v; NaN where the point is not in front of the other camera
    """
    x = back[0, 0] * column + back[0, 1] * row + back[0, 2]
    y = back[1, 1] * row + back[1, 2]
    X, Y = x * depth, y * depth
    p0 = A[0, 0] * X + A[0, 1] * Y + A[0, 2] * depth + b[0]
    p1 = A[1, 0] * X + A[1, 1] * Y + A[1, 2] * depth + b[1]
    p2 = A[2, 0] * X + A[2, 1] * Y + A[2, 2] * depth + b[2]
    if p2 <= 0:
        return np.nan, np.nan
    u, v = p0 / p2, p1 / p2
    facing = normal[0] * x + normal[1] * y + normal[2]
    for axis in range(2):
        dx, dy = back[0, axis], back[1, axis]
        slope = -depth * (normal[0] * dx + normal[1] * dy) / facing  # of the depth
        dX, dY = x * slope + depth * dx, y * slope + depth * dy
        d0 = A[0, 0] * dX + A[0, 1] * dY + A[0, 2] * slope
        d1 = A[1, 0] * dX + A[1, 1] * dY + A[1, 2] * slope
        d2 = A[2, 0] * dX + A[2, 1] * dY + A[2, 2] * slope
        du[axis], dv[axis] = (d0 - u * d2) / p2, (d1 - v * d2) / p2
    return u, v
