"""The visual hull: the largest body that every silhouette allows (Laurentini 1994).

Each silhouette becomes a signed distance to its outline, positive inside. The hull's field at a
world point is the least of these over the views at the point's projections, so its zero level is
the hull's surface, finer than the grid that it is sampled on. A hull that tolerates k disagreeing
views takes the least but k.

The grid is filled in blocks. A signed distance changes no faster than one moves, so its value at a
block's middle bounds it in all of the block: most blocks lie wholly outside or wholly inside, and
in the others few views can be the ones that decide.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from numba import njit
from skimage.measure import marching_cubes

from silmesh.cameras.camera import OBJECT_RADIUS, Cameras

REACH = 1 / 16  # of the image's side: distances to the outline are cut off there
GRACE = 0.15  # pixels that every outline is moved outwards: each is only known to half a pixel,
# and the hull takes the worst of all views; without it thin parts vanish from small images
COARSE = 48  # samples a side of the first grid, which only finds the box that the hull fills
BLOCK = 4  # samples a side of a block
STEEP = 1.4143  # the most that a distance changes a pixel once it is interpolated


@dataclass(frozen=True)
class Hull:
    """A sampled field whose zero level is the hull's surface, positive inside.

    Attributes:
        field: [n, n, n] float32 over x, y, z, in pixels
        origin: [3], the world point of the first sample
        spacing: [3], between samples
    """

    field: np.ndarray
    origin: np.ndarray
    spacing: np.ndarray

    @property
    def empty(self) -> bool:
        """Whether no sample lies in the hull: the cameras and silhouettes contradict each other."""
        return not (self.field > 0).any()

    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """The hull as a closed mesh: vertices [verts, 3] in the world, faces [faces, 3]."""
        closed = np.pad(self.field, 1, constant_values=-np.abs(self.field).max())
        verts, faces, _, _ = marching_cubes(closed, 0.0, gradient_direction="ascent")
        return self.origin + (verts - 1) * self.spacing, faces

    def coarser(self, every: int) -> "Hull":
        """The same field on every so many-th sample along each axis."""
        return Hull(self.field[::every, ::every, ::every], self.origin, every * self.spacing)


def carve(
    silhouettes: np.ndarray, cameras: Cameras, resolution: int = 128, tolerated: int = 0
) -> Hull:
    """Carve the visual hull out of the cube about the sphere that holds the object.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        resolution: samples along each side of the box that the hull fills
        tolerated: how many views may put a point of the hull outside
    """
    far = REACH * max(silhouettes.shape[1:])
    P = cameras.projections.numpy()
    low, high = np.full(3, -1.6 * OBJECT_RADIUS), np.full(3, 1.6 * OBJECT_RADIUS)
    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        distances = _distances(silhouettes, far, pool)
        cell = _half_cell(cameras, (high - low) / (COARSE - 1))
        coarse = _sample(distances, P, low, high, COARSE, tolerated, cell, pool)
        filled = np.argwhere(coarse.field > -min(0.95 * far, cell))
        if not len(filled):
            return coarse
        low = coarse.origin + (filled.min(axis=0) - 1) * coarse.spacing
        high = coarse.origin + (filled.max(axis=0) + 1) * coarse.spacing
        cell = 2 * _half_cell(cameras, (high - low) / (resolution - 1))
        return _sample(distances, P, low, high, resolution, tolerated, cell, pool)


def find_doubtful(silhouettes: np.ndarray, cameras: Cameras) -> list[int]:
    """The fewest views without which the most would be in the hull that is not.

    Where the hull is empty these are the views that empty it: those that put outside what the
    fewest views put outside. Else it is the view that alone cuts off the most.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
    Returns:
        positions of views; none if no view is alone in what it cuts off
    """
    far = REACH * max(silhouettes.shape[1:])
    low, spacing = np.full(3, -OBJECT_RADIUS), np.full(3, 2 * OBJECT_RADIUS / (COARSE - 1))
    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        distances = _distances(silhouettes, far, pool)
    P = cameras.projections.numpy()
    against = _votes_against(distances, _cut(distances), P, low, spacing, COARSE)
    fewest = max(1, int(against.sum(axis=1).min()))
    sets, count = np.unique(against[against.sum(axis=1) == fewest], axis=0, return_counts=True)
    return np.flatnonzero(sets[count.argmax()]).tolist() if len(sets) else []


def signed_distance(silhouette: np.ndarray, far: float, grace: float = GRACE) -> np.ndarray:
    """Distance of each pixel's centre to the outline between pixels, positive inside.

    Args:
        silhouette: [height, width] bool
        far: where distances are cut off, in pixels
        grace: how far the outline is moved outwards, in pixels
    Returns:
        [height, width] float32
    """
    to_other = _to_other(np.ascontiguousarray(silhouette), int(np.ceil(far)) + 2)
    signed = np.where(silhouette, to_other - 0.5, 0.5 - to_other) + grace
    return signed.clip(-far, far).astype(np.float32)


@njit(nogil=True, cache=True)
def _to_other(silhouette, most):
    """Distance from each pixel's centre to the nearest of the other kind, cut off at ``most``.

    Down and up each column first; then along the rows, where a column that stands k aside offers
    k^2 + (its own distance)^2. Only the columns about those that offer anything need be asked.
    """
    height, width = silhouette.shape
    along = np.full((height, width), most, np.int64)
    for r in range(1, height):
        for c in range(width):
            if silhouette[r, c] != silhouette[r - 1, c]:
                along[r, c] = 1
            else:
                along[r, c] = min(along[r - 1, c] + 1, most)
    for r in range(height - 2, -1, -1):
        for c in range(width):
            if silhouette[r, c] != silhouette[r + 1, c]:
                along[r, c] = 1
            else:
                along[r, c] = min(along[r + 1, c] + 1, along[r, c])
    distance = np.full((height, width), float(most))
    for r in range(height):
        first, last = width, -1
        for c in range(width):
            if along[r, c] < most or (c and silhouette[r, c] != silhouette[r, c - 1]):
                first, last = min(first, c - 1), c
        for c in range(max(0, first - most), min(width, last + most + 1)):
            best = along[r, c] ** 2
            k = 1
            while k * k < best:
                for other in (c - k, c + k):
                    if 0 <= other < width:
                        same = silhouette[r, other] == silhouette[r, c]
                        best = min(best, k * k + (along[r, other] ** 2 if same else 0))
                k += 1
            distance[r, c] = np.sqrt(best)
    return distance


def _distances(silhouettes: np.ndarray, far: float, pool: ThreadPoolExecutor) -> np.ndarray:
    return np.stack(list(pool.map(lambda s: signed_distance(s, far), silhouettes)))


def _cut(distances: np.ndarray) -> np.ndarray:
    """Whether the frame cuts a view's silhouette: [views] bool."""
    return np.array([(d[[0, -1]] > 0).any() or (d[:, [0, -1]] > 0).any() for d in distances])


def _half_cell(cameras: Cameras, spacing: np.ndarray) -> float:
    """How many pixels half a cell's diagonal spans in the closest view."""
    nearest = (cameras.centres.norm(dim=1) - OBJECT_RADIUS).clamp(min=1e-3)
    return float((cameras.K[:, 0, 0] / nearest).max()) * float(np.linalg.norm(spacing)) / 2


def _sample(
    distances: np.ndarray,
    P: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    resolution: int,
    tolerated: int,
    band: float,
    pool: ThreadPoolExecutor,
) -> Hull:
    """Sample the field on a grid over a box, exactly within ``band`` pixels of its zero level.

    Threads take slabs of constant x, of whole blocks.
    """
    field = np.empty((resolution,) * 3, np.float32)
    spacing = (high - low) / (resolution - 1)
    far, cut = distances.max(), _cut(distances)
    starts = range(0, resolution, BLOCK)

    def fill(start: int) -> None:
        corner = low + spacing * [start, 0, 0]
        slab = field[start : start + BLOCK]
        _fill(slab, distances, cut, far, P, corner, spacing, tolerated, band)

    list(pool.map(fill, starts))
    return Hull(field, low, spacing)


@njit(nogil=True, cache=True, error_model="numpy")
def _fill(field, distances, cut, far, P, low, spacing, tolerated, band):
    """The least signed distance but ``tolerated`` over the views at every sample [x, y, z].

    A sample that lies beyond a view's frame is outside, unless the frame cuts the silhouette: then
    the view says nothing. A sample of which too few views say anything is outside.
    """
    views = len(distances)
    lower, upper = np.empty(views), np.empty(views)
    low_bounds, high_bounds = np.empty(tolerated + 1), np.empty(tolerated + 1)
    lows = np.empty((BLOCK**3, tolerated + 1))
    n, corner = np.empty(3, np.int64), np.empty(3)
    for i in range(0, field.shape[0], BLOCK):
        for j in range(0, field.shape[1], BLOCK):
            for k in range(0, field.shape[2], BLOCK):
                block = field[i : i + BLOCK, j : j + BLOCK, k : k + BLOCK]
                radius = 0.0
                for axis, first in enumerate((i, j, k)):
                    n[axis] = block.shape[axis]
                    corner[axis] = low[axis] + first * spacing[axis]
                    radius += (0.5 * (n[axis] - 1) * spacing[axis]) ** 2
                middle = corner + 0.5 * (n - 1) * spacing
                low_bounds[:], high_bounds[:] = np.inf, np.inf
                for v in range(views):
                    lower[v], upper[v] = _bounds(
                        distances[v], cut[v], far, P[v], middle, np.sqrt(radius)
                    )
                    _keep_lowest(low_bounds, lower[v])
                    _keep_lowest(high_bounds, upper[v])
                    if high_bounds[tolerated] < -band:
                        break
                if high_bounds[tolerated] < -band:
                    block[:] = high_bounds[tolerated]
                    continue
                if low_bounds[tolerated] > band:
                    block[:] = min(low_bounds[tolerated], far)
                    continue
                lows[:] = np.inf
                for v in range(views):
                    if lower[v] <= high_bounds[tolerated]:
                        _look_at_block(lows, distances[v], cut[v], far, P[v], corner, spacing, n)
                _write_block(block, lows[:, tolerated], far)


@njit(nogil=True, cache=True, error_model="numpy")
def _look_at_block(lows, image, cut, far, m, corner, spacing, n):
    """Put a view's signed distances at a block's samples among the lowest of each sample."""
    height, width = image.shape
    nothing = np.inf if cut else -far
    column_step, row_step, depth_step = (
        m[0, 2] * spacing[2],
        m[1, 2] * spacing[2],
        m[2, 2] * spacing[2],
    )
    s = 0
    for i in range(n[0]):
        x = corner[0] + i * spacing[0]
        for j in range(n[1]):
            y = corner[1] + j * spacing[1]
            column = m[0, 0] * x + m[0, 1] * y + m[0, 2] * corner[2] + m[0, 3]
            row = m[1, 0] * x + m[1, 1] * y + m[1, 2] * corner[2] + m[1, 3]
            depth = m[2, 0] * x + m[2, 1] * y + m[2, 2] * corner[2] + m[2, 3]
            for k in range(n[2]):
                near = 1 / (depth + k * depth_step)
                u = (column + k * column_step) * near - 0.5
                w = (row + k * row_step) * near - 0.5
                value = nothing
                if near > 0 and 0 <= u < width - 1 and 0 <= w < height - 1:
                    value = _between(image, u, w)
                if value < lows[s, -1]:
                    _keep_lowest(lows[s], value)
                s += 1


@njit(nogil=True, cache=True)
def _write_block(block, values, far):
    """Put a block's samples where they belong; that of which too few views spoke is outside."""
    s = 0
    for i in range(block.shape[0]):
        for j in range(block.shape[1]):
            for k in range(block.shape[2]):
                block[i, j, k] = values[s] if values[s] < np.inf else -far
                s += 1


@njit(nogil=True, cache=True)
def _between(image, u, w):
    """An image between the centres of its pixels, which lie at whole numbers here."""
    c, r = int(u), int(w)
    u, w = u - c, w - r
    above = image[r, c] * (1 - u) + image[r, c + 1] * u
    below = image[r + 1, c] * (1 - u) + image[r + 1, c + 1] * u
    return above * (1 - w) + below * w


@njit(nogil=True, cache=True, error_model="numpy")
def _bounds(image, cut, far, m, middle, radius):
    """The least and the largest signed distance of a view in a ball of the world.

    A step s from X moves u = (m_0 X) / (m_2 X) by (m_0 - u m_2) s / (m_2 (X + s)).
    """
    height, width = image.shape
    column, row, depth = m[0, 3], m[1, 3], m[2, 3]
    for axis in range(3):
        column += m[0, axis] * middle[axis]
        row += m[1, axis] * middle[axis]
        depth += m[2, axis] * middle[axis]
    u, v = column / depth, row / depth
    ahead = 0.0
    steep = 0.0
    for axis in range(3):
        ahead += m[2, axis] ** 2
        steep += (m[0, axis] - u * m[2, axis]) ** 2 + (m[1, axis] - v * m[2, axis]) ** 2
    nearest = depth - radius * np.sqrt(ahead)
    nothing = np.inf if cut else -far
    if nearest <= 0:
        return -far, max(far, nothing)
    reach = radius * np.sqrt(steep) / nearest
    inside = min(min(u - 0.5, width - 1.5 - u), min(v - 0.5, height - 1.5 - v))
    if inside < -reach:
        return nothing, nothing
    if inside <= reach:
        return -far, max(far, nothing)
    here = _between(image, u - 0.5, v - 0.5)
    return here - STEEP * reach, here + STEEP * reach


@njit(nogil=True, cache=True)
def _keep_lowest(lows, value):
    """Put a value among the lowest so far, in rising order, if it is one of them."""
    for i in range(len(lows)):
        if value < lows[i]:
            lows[i], value = value, lows[i]


@njit(nogil=True, cache=True, error_model="numpy")
def _votes_against(distances, cut, P, low, spacing, resolution):
    """Whether each view puts each sample of a cubic grid outside: [samples, views] bool."""
    against = np.empty((resolution**3, len(distances)), np.bool_)
    lows, one = np.empty((1, 1)), np.ones(3, np.int64)
    for s in range(resolution**3):
        index = np.array([s // resolution**2, s // resolution % resolution, s % resolution])
        corner = low + index * spacing
        for v in range(len(distances)):
            lows[0, 0] = np.inf
            _look_at_block(lows, distances[v], cut[v], 1.0, P[v], corner, spacing, one)
            against[s, v] = lows[0, 0] < 0
    return against
