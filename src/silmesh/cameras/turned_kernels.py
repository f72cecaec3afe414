"""The residuals by which rotations between two sets of silhouettes are sought, compiled.

What they are, and of which sets, is said in ``cameras.turned``.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from silmesh.geometry.camera import OBJECT_RADIUS

HALF = 1.2 * OBJECT_RADIUS  # half the side of the grids, whose middle is the world's origin
DEPTHS = 96  # of a ray's samples, from one side of the grid to the other
NEAR = 0.02  # a depth is looked at if the ray's own hull is missed by so much more than at best
LIKELY = 1 / 3, 3.0  # bounds of the scale


class Side(NamedTuple):
    """A set, as the kernels take it.

    Attributes:
        field: [n, n, n] float32 over x, y, z, signed distance to its hull in world units
        points: [samples, 3] on its rays
        own: [samples], the field there without the ray's own view
        first: [rays + 1], where the samples of each ray begin
        seen_by: [rays], the view of each
    """

    field: np.ndarray
    points: np.ndarray
    own: np.ndarray
    first: np.ndarray
    seen_by: np.ndarray


@njit(nogil=True, cache=True, error_model="numpy")
def _look_at(images, cut, far, P, v, x, y, z):
    """A view's signed distance at a point's projection; +inf where it says nothing."""
    _, height, width = images.shape
    m = P[v]
    depth = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
    column = (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) / depth - 0.5
    row = (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) / depth - 0.5
    if depth > 0 and 0 <= column < width - 1 and 0 <= row < height - 1:
        c, r = int(column), int(row)
        u, w = column - c, row - r
        above = images[v, r, c] * (1 - u) + images[v, r, c + 1] * u
        below = images[v, r + 1, c] * (1 - u) + images[v, r + 1, c + 1] * u
        value = above * (1 - w) + below * w
        if not np.isnan(value):
            return value
    return np.inf if cut[v] else -far


@njit(nogil=True, cache=True, error_model="numpy")
def sample_slab(slab, images, cut, far, P, x, axis):
    """Fill [n, n] samples of the field of all views at one x."""
    for b in range(len(axis)):
        for c in range(len(axis)):
            least = far
            for v in range(len(P)):
                value = _look_at(images, cut, far, P, v, x, axis[b], axis[c])
                if value < least:
                    least = value
                    if least <= -far:
                        break
            slab[b, c] = least


@njit(nogil=True, cache=True, error_model="numpy")
def gather(images, cut, far, P, some, centres, along, known):
    """The samples of the rays that nearly touch their own hull: ``Side`` without its field."""
    views, rays = known.shape
    most = views * rays * DEPTHS
    points, own = np.empty((most, 3)), np.empty(most)
    first, view = np.zeros(views * rays + 1, np.int64), np.zeros(views * rays, np.int64)
    values = np.empty(DEPTHS)
    count, n = 0, 0
    for i in range(views):
        middle = np.sqrt((centres[i] ** 2).sum())
        for s in range(rays):
            if not known[i, s]:
                continue
            best = -np.inf
            for k in range(DEPTHS):
                at = middle + HALF * (2 * k / (DEPTHS - 1) - 1)
                x = centres[i, 0] + at * along[i, s, 0]
                y = centres[i, 1] + at * along[i, s, 1]
                z = centres[i, 2] + at * along[i, s, 2]
                least = far
                for v in range(len(P)):
                    if v != some[i]:
                        value = _look_at(images, cut, far, P, v, x, y, z)
                        if value < least:
                            least = value
                values[k] = least
                best = max(best, least)
            best = min(best, 0.0)
            for k in range(DEPTHS):
                if values[k] >= best - NEAR:
                    at = middle + HALF * (2 * k / (DEPTHS - 1) - 1)
                    points[n] = centres[i] + at * along[i, s]
                    own[n] = min(0.0, values[k] - best)  # what its own set misses is not asked
                    n += 1
            view[count] = some[i]
            count += 1
            first[count] = n
    return points[:n], own[:n], first[: count + 1], view[:count]


@njit(nogil=True, cache=True, error_model="numpy")
def _interpolate(field, x, y, z, slope):
    """The field at a point of the world, and its slope there; beyond the grid, at its border."""
    n = field.shape[0]
    step = 2 * HALF / (n - 1)
    a, b, c = (x + HALF) / step, (y + HALF) / step, (z + HALF) / step
    a, b, c = min(max(a, 0.0), n - 1.001), min(max(b, 0.0), n - 1.001), min(max(c, 0.0), n - 1.001)
    i, j, k = int(a), int(b), int(c)
    u, v, w = a - i, b - j, c - k
    f000, f001 = field[i, j, k], field[i, j, k + 1]
    f010, f011 = field[i, j + 1, k], field[i, j + 1, k + 1]
    f100, f101 = field[i + 1, j, k], field[i + 1, j, k + 1]
    f110, f111 = field[i + 1, j + 1, k], field[i + 1, j + 1, k + 1]
    g00, g01 = f000 + u * (f100 - f000), f001 + u * (f101 - f001)
    g10, g11 = f010 + u * (f110 - f010), f011 + u * (f111 - f011)
    low, high = g00 + v * (g10 - g00), g01 + v * (g11 - g01)
    slope[0] = (
        (1 - w) * ((1 - v) * (f100 - f000) + v * (f110 - f010))
        + w * ((1 - v) * (f101 - f001) + v * (f111 - f011))
    ) / step
    slope[1] = ((1 - w) * (g10 - g00) + w * (g11 - g01)) / step
    slope[2] = (high - low) / step
    return low + w * (high - low)


@njit(nogil=True, cache=True, error_model="numpy")
def _find_residual(side, field, ray, A, b, where, slope):
    """A ray's residual in the other set's field, whose world has A X + b for a point X.

    Fills ``where`` with the point X and ``slope`` with the field's slope in the other world; that
    is 0 if the ray's own set decides.
    """
    best, best_own = -np.inf, False
    here = np.zeros(3)
    for n in range(side.first[ray], side.first[ray + 1]):
        p = side.points[n]
        x = A[0, 0] * p[0] + A[0, 1] * p[1] + A[0, 2] * p[2] + b[0]
        y = A[1, 0] * p[0] + A[1, 1] * p[1] + A[1, 2] * p[2] + b[1]
        z = A[2, 0] * p[0] + A[2, 1] * p[1] + A[2, 2] * p[2] + b[2]
        value = _interpolate(field, x, y, z, here)
        own = side.own[n] < value
        value = min(value, side.own[n])
        if value > best:
            best, best_own = value, own
            where[:] = p
            slope[:] = here
            if best >= 0:
                break
    if best_own or best >= 0:
        slope[:] = 0
    return min(best, 0.0)


@njit(nogil=True, cache=True, error_model="numpy")
def _add_up(one, two, Q, s, c, H, g):
    """The sum of squares of all rays' residuals; fills the normal equations H [7, 7] and g [7].

    The steps are w, sigma and tau of X' = exp(w) (1 + sigma) X + tau after X = s Q Y + c.
    """
    H[:], g[:] = 0, 0
    where, slope, J = np.zeros(3), np.zeros(3), np.zeros(7)
    total = 0.0
    back = np.ascontiguousarray(Q.T) / s
    shift = -back @ c
    for ray in range(len(one.seen_by)):
        r = _find_residual(one, two.field, ray, back, shift, where, slope)
        total += r * r
        if r < 0:
            _add_ray(r, where, -(Q @ slope) / s, J, H, g)
    ahead = s * Q
    for ray in range(len(two.seen_by)):
        r = _find_residual(two, one.field, ray, ahead, c, where, slope)
        total += r * r
        if r < 0:
            _add_ray(r, ahead @ where + c, slope, J, H, g)
    return total


@njit(nogil=True, cache=True)
def _add_ray(r, X, G, J, H, g):
    """Add a residual whose change is G (w x X + sigma X + tau)."""
    J[0] = X[1] * G[2] - X[2] * G[1]
    J[1] = X[2] * G[0] - X[0] * G[2]
    J[2] = X[0] * G[1] - X[1] * G[0]
    J[3] = X[0] * G[0] + X[1] * G[1] + X[2] * G[2]
    J[4:] = G
    for i in range(7):
        g[i] += J[i] * r
        for j in range(7):
            H[i, j] += J[i] * J[j]


@njit(nogil=True, cache=True, error_model="numpy")
def descend(one, two, Q, s, c, steps):
    """Levenberg and Marquardt from a similarity: the similarity, and the mean square residual."""
    H, g = np.zeros((7, 7)), np.zeros(7)
    H_new, g_new = np.zeros((7, 7)), np.zeros(7)
    damping = 1e-3
    cost = _add_up(one, two, Q, s, c, H, g)
    for _ in range(steps):
        A = H.copy()
        for i in range(7):
            A[i, i] = A[i, i] * (1 + damping) + 1e-6
        step = -np.linalg.solve(A, g)
        E = _turn(step[:3])
        grown = 1 + max(-0.3, min(0.3, step[3]))
        Q_new, s_new, c_new = E @ Q, grown * s, grown * (E @ c) + step[4:]
        if not LIKELY[0] < s_new < LIKELY[1]:
            break
        cost_new = _add_up(one, two, Q_new, s_new, c_new, H_new, g_new)
        if cost_new < cost:
            gain = 1 - cost_new / cost
            Q, s, c, cost = Q_new, s_new, c_new, cost_new
            H[:], g[:] = H_new, g_new
            damping = max(damping / 5, 1e-6)
            if gain < 1e-5:
                break
        else:
            damping *= 8
            if damping > 1e4:
                break
    return Q, s, c, cost / (len(one.seen_by) + len(two.seen_by))


@njit(nogil=True, cache=True, error_model="numpy")
def _turn(w):
    """The rotation by a vector, Rodrigues' formula."""
    angle = np.sqrt((w**2).sum())
    x, y, z = w / max(angle, 1e-12)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K)


@njit(nogil=True, cache=True, error_model="numpy")
def judge(one, two, Q, s, c, views_of_one, views_of_two):
    """Mean square residual of each view's rays: [views of the first and then the second]."""
    squares, rays = np.zeros(views_of_one + views_of_two), np.zeros(views_of_one + views_of_two)
    where, slope = np.zeros(3), np.zeros(3)
    back = np.ascontiguousarray(Q.T) / s
    shift = -back @ c
    for ray in range(len(one.seen_by)):
        r = _find_residual(one, two.field, ray, back, shift, where, slope)
        squares[one.seen_by[ray]] += r * r
        rays[one.seen_by[ray]] += 1
    for ray in range(len(two.seen_by)):
        r = _find_residual(two, one.field, ray, s * Q, c, where, slope)
        squares[views_of_one + two.seen_by[ray]] += r * r
        rays[views_of_one + two.seen_by[ray]] += 1
    return squares / np.maximum(rays, 1)
