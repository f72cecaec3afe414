"""The visual hull: the largest body that every silhouette allows (Laurentini 1994).

Each silhouette becomes an image of the signed distance to its outline, positive inside. The hull's
field at a world point is the minimum over the views of this distance at the point's projection. Its
zero level is the hull's surface, which is located more finely than the spacing of the grid. A hull
that tolerates k disagreeing views drops the k lowest distances before it takes the minimum.

The grid is filled in blocks, which are subdivided like an octree. A signed distance has slope 1, so
its value at a block's middle bounds it in the whole block. Most blocks are found to lie wholly
outside or inside; the others are subdivided, and only the views that can hold the minimum are
passed on to their parts.

A view whose photograph's frame cuts the silhouette says nothing beyond that frame, nor is the cut
an outline: distances are to the pixels of the other kind within the frame alone. Where hardly any
view shows the object whole, the hull would go on in the places that only few speak of, and it is
cut off at the sphere that holds the object.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from numba import njit
from skimage.measure import block_reduce, marching_cubes

from silmesh.geometry.camera import OBJECT_RADIUS, Cameras
from silmesh.geometry.frame import bound_object, open_frames
from silmesh.geometry.signed_distance import measure_within
from silmesh.geometry.small_images import LARGEST, shrink, shrink_frames

REACH = 1 / 16  # signed distances are cut off beyond this share of the image's side
COARSE = 48  # samples a side of the first grid, which only finds the hull's bounding box
BLOCKS = (16, 4, 2)  # samples a side of a block at each level of the subdivision
ENCLOSING = 2  # views that have to see a camera's place before it stands inside the object
STEEP = 1.4143  # greatest slope of a bilinearly interpolated signed distance: sqrt(2)


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

    @cached_property
    def solid(self) -> np.ndarray:
        """Where any of two samples along each axis lies in the hull, [n / 2, n / 2, n / 2] bool."""
        return block_reduce(self.field > 0, (2, 2, 2), np.max)

    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """The hull as a closed mesh: vertices [verts, 3] in the world, faces [faces, 3]."""
        closed = np.pad(self.field, 1, constant_values=-np.abs(self.field).max())
        verts, faces, _, _ = marching_cubes(closed, 0.0, gradient_direction="ascent")
        return self.origin + (verts - 1) * self.spacing, faces

    def coarser(self, every: int) -> "Hull":
        """The same field at every ``every``-th sample along each axis."""
        return Hull(self.field[::every, ::every, ::every], self.origin, every * self.spacing)


class _Outlines(NamedTuple):
    """All views, as the kernels take them.

    Attributes:
        distances: [views, height, width] float32, signed, cut off at ``far``
        cut: [views] bool, whether the frame cuts the silhouette
        spoken: [views, 4] left, top, right and bottom of the pixels that each view speaks of
        P: [views, 3, 4]
        ahead: [views], greatest change of the depth by a step of length 1 in the world
        across: [views], greatest movement of a projection at depth 1 by such a step, in pixels
        far: pixels, where distances are cut off
    """

    distances: np.ndarray
    cut: np.ndarray
    spoken: np.ndarray
    P: np.ndarray
    ahead: np.ndarray
    across: np.ndarray
    far: float


def carve(
    silhouettes: np.ndarray,
    cameras: Cameras,
    resolution: int = 128,
    tolerated: int = 0,
    frames: Sequence[Sequence[int]] | None = None,
) -> Hull:
    """Carve the visual hull out of the cube about the sphere that holds the object.

    Silhouettes of more than ``LARGEST`` pixels are shrunk first: the grid is coarser than they are.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        resolution: samples along each side of the box that the hull fills
        tolerated: how many views may see a point of the hull outside their silhouette
        frames: [views, 4] of the photographs within the images; the whole images if not given
    """
    if max(silhouettes.shape[1:]) > LARGEST:
        ratio = max(silhouettes.shape[1:]) / LARGEST
        frames = shrink_frames(silhouettes, LARGEST, frames)
        hull = carve(*shrink(silhouettes, cameras, LARGEST), resolution, tolerated, frames)
        return replace(hull, field=np.float32(ratio) * hull.field)
    low, high = np.full(3, -1.6 * OBJECT_RADIUS), np.full(3, 1.6 * OBJECT_RADIUS)
    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        outlines = _outlines(silhouettes, cameras, pool, frames)
        cell = _half_cell(cameras, (high - low) / (COARSE - 1))
        bounded = bound_object(silhouettes, frames)
        coarse = _sample(outlines, low, high, COARSE, tolerated, cell, pool)
        coarse = coarse if bounded else _cut_off(coarse, cameras)
        filled = np.argwhere(coarse.field > -min(0.95 * outlines.far, cell))
        if not len(filled):
            return coarse
        low = coarse.origin + (filled.min(axis=0) - 1) * coarse.spacing
        high = coarse.origin + (filled.max(axis=0) + 1) * coarse.spacing
        cell = 2 * _half_cell(cameras, (high - low) / (resolution - 1))
        hull = _sample(outlines, low, high, resolution, tolerated, cell, pool)
    return hull if bounded else _cut_off(hull, cameras)


def _cut_off(hull: Hull, cameras: Cameras) -> Hull:
    """The part of a hull that lies in the sphere that holds the object."""
    axes = [
        first + step * np.arange(n)
        for first, step, n in zip(hull.origin, hull.spacing, hull.field.shape, strict=True)
    ]
    squares = axes[0][:, None, None] ** 2 + axes[1][:, None] ** 2 + axes[2] ** 2
    pixels = float((cameras.K[:, 0, 0] / cameras.centres.norm(dim=1)).median())
    inside = pixels * (OBJECT_RADIUS - np.sqrt(squares))
    return replace(hull, field=np.minimum(hull.field, inside.astype(np.float32)))


def find_outlier_views(
    silhouettes: np.ndarray, cameras: Cameras, frames: Sequence[Sequence[int]] | None = None
) -> list[int]:
    """Find the views that contradict the others most.

    If the hull is empty, these are the views that empty it. Of the points that the fewest views
    reject, each is rejected by a set of views; the set that rejects the most points is returned.
    If the hull is not empty, it is the view that alone rejects the most points.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        frames: [views, 4] as ``carve`` takes them
    Returns:
        positions of views; none if every point outside is rejected by more than one view
    """
    low, spacing = np.full(3, -OBJECT_RADIUS), np.full(3, 2 * OBJECT_RADIUS / (COARSE - 1))
    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        outlines = _outlines(silhouettes, cameras, pool, frames)
    against = _votes_against(outlines, low, spacing, COARSE)
    fewest = max(1, int(against.sum(axis=1).min()))
    sets, count = np.unique(against[against.sum(axis=1) == fewest], axis=0, return_counts=True)
    return np.flatnonzero(sets[count.argmax()]).tolist() if len(sets) else []


def find_enclosed(
    silhouettes: np.ndarray, cameras: Cameras, frames: Sequence[Sequence[int]] | None = None
) -> list[int]:
    """The positions of the cameras that stand inside the hull of the other views.

    A view says nothing of its own camera's place. Of the others at least two have to see it, all of
    them within their silhouettes.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        frames: [views, 4] as ``carve`` takes them
    """
    near = np.flatnonzero(cameras.centres.norm(dim=1).numpy() <= OBJECT_RADIUS)
    if not len(near):
        return []
    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        outlines = _outlines(silhouettes, cameras, pool, frames)
    found = []
    for i in near:
        x, y, z = cameras.centres[i].tolist()
        others = np.delete(np.arange(len(cameras)), i)
        signed = np.array([_view_distance(outlines, v, x, y, z) for v in others])
        if np.isfinite(signed).sum() >= ENCLOSING and signed.min() > 0:
            found.append(int(i))
    return found


def _outlines(
    silhouettes: np.ndarray,
    cameras: Cameras,
    pool: ThreadPoolExecutor,
    frames: Sequence[Sequence[int]] | None,
) -> _Outlines:
    height, width = silhouettes.shape[1:]
    far = REACH * max(height, width)
    cut, spoken = open_frames(silhouettes, frames)

    def measure(i: int) -> np.ndarray:
        return measure_within(silhouettes[i], spoken[i], far)

    distances = np.stack(list(pool.map(measure, range(len(silhouettes)))))
    P = np.ascontiguousarray(cameras.projections.numpy())
    corners = np.array([[0, 0], [0, height], [width, 0], [width, height]])
    off = P[:, None, :2, :3] - corners[:, :, None] * P[:, None, 2:, :3]  # [views, 4, 2, 3]
    across = np.sqrt((off**2).sum(axis=(2, 3))).max(axis=1)  # convex in the pixel
    ahead = np.linalg.norm(P[:, 2, :3], axis=1)
    return _Outlines(distances, cut, spoken, P, ahead, across, far)


def _half_cell(cameras: Cameras, spacing: np.ndarray) -> float:
    """Pixels that half the diagonal of a cell of the grid spans in the closest view."""
    nearest = (cameras.centres.norm(dim=1) - OBJECT_RADIUS).clamp(min=1e-3)
    return float((cameras.K[:, 0, 0] / nearest).max()) * float(np.linalg.norm(spacing)) / 2


def _sample(
    outlines: _Outlines,
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

    def fill(start: int) -> None:
        corner = low + spacing * [start, 0, 0]
        _fill(field[start : start + BLOCKS[0]], outlines, corner, spacing, tolerated, band)

    list(pool.map(fill, range(0, resolution, BLOCKS[0])))
    return Hull(field, low, spacing)


@njit(nogil=True, cache=True, error_model="numpy")
def _fill(field, outlines, low, spacing, tolerated, band):
    """Fill every sample [x, y, z] with the (``tolerated`` + 1)-th lowest distance over the views.

    A sample that projects beyond a view's image is outside, unless the frame cuts the silhouette:
    then the view is skipped beyond its frame. A sample that all but ``tolerated`` views skip is
    outside.

    A block's parts are filled before the next block of its size. So one list of views a size is
    enough: those that can hold the minimum in the current block.
    """
    views, deepest, far = len(outlines.distances), len(BLOCKS) - 1, outlines.far
    deciding = np.empty((deepest + 2, views), np.int64)
    deciding[0] = np.arange(views)
    count = np.full(deepest + 2, views)
    lower = np.empty(views)
    lows = np.empty((BLOCKS[-1] ** 3, tolerated + 1))
    largest = 1
    for samples in field.shape:
        largest *= samples // BLOCKS[0] + 1
    parts = len(BLOCKS) * (BLOCKS[0] // BLOCKS[-1]) ** 3
    waiting = np.empty((largest + parts, 4), np.int64)
    left = _push(waiting, 0, 0, 0, 0, 0, field.shape)
    while left:
        left -= 1
        i, j, k, level = waiting[left]
        end = _end(i, j, k, BLOCKS[level], field.shape)
        half_x = 0.5 * (end[0] - 1 - i) * spacing[0]
        half_y = 0.5 * (end[1] - 1 - j) * spacing[1]
        half_z = 0.5 * (end[2] - 1 - k) * spacing[2]
        x = low[0] + i * spacing[0] + half_x
        y = low[1] + j * spacing[1] + half_y
        z = low[2] + k * spacing[2] + half_z
        radius = np.sqrt(half_x**2 + half_y**2 + half_z**2)
        here = deciding[level, : count[level]]
        least, most, ended = _bound(outlines, here, x, y, z, radius, band, lower, lows)
        if ended >= 0:  # the next block tests this view first
            here[0], here[ended] = here[ended], here[0]
            field[i : end[0], j : end[1], k : end[2]] = most
            continue
        if least > band:
            silent = least == np.inf  # of all views: outside, as sample by sample
            field[i : end[0], j : end[1], k : end[2]] = -far if silent else min(least, far)
            continue
        kept = 0
        for at in range(len(here)):
            if lower[at] <= most:
                deciding[level + 1, kept] = here[at]
                kept += 1
        count[level + 1] = kept
        if level == deepest:
            _fill_samples(field, i, j, k, deciding[level + 1, :kept], outlines, low, spacing, lows)
        else:
            left = _push(waiting, left, i, j, k, level + 1, end)


@njit(nogil=True, cache=True)
def _end(i, j, k, side, shape):
    """The end of a block along each axis, one past its last sample."""
    return min(i + side, shape[0]), min(j + side, shape[1]), min(k + side, shape[2])


@njit(nogil=True, cache=True)
def _push(waiting, left, i, j, k, level, end):
    """Push the blocks of a level between two samples onto the stack, and return its size."""
    side = BLOCKS[level]
    for a in range(i, end[0], side):
        for b in range(j, end[1], side):
            for c in range(k, end[2], side):
                waiting[left] = a, b, c, level
                left += 1
    return left


@njit(nogil=True, cache=True, error_model="numpy")
def _fill_samples(field, i, j, k, views, outlines, low, spacing, lows):
    """Fill a block of the smallest size sample by sample from these views."""
    side, far, m, last = BLOCKS[-1], outlines.far, outlines.P, lows.shape[1] - 1
    lows[:] = np.inf
    n, o, p = (
        min(side, field.shape[0] - i),
        min(side, field.shape[1] - j),
        min(side, field.shape[2] - k),
    )
    for v in views:
        nothing = np.inf if outlines.cut[v] else -far
        left, top, right, bottom = outlines.spoken[v]
        s = 0
        for a in range(i, i + n):
            x = low[0] + a * spacing[0]
            for b in range(j, j + o):
                y = low[1] + b * spacing[1]
                column = m[v, 0, 0] * x + m[v, 0, 1] * y + m[v, 0, 3]
                row = m[v, 1, 0] * x + m[v, 1, 1] * y + m[v, 1, 3]
                depth = m[v, 2, 0] * x + m[v, 2, 1] * y + m[v, 2, 3]
                for c in range(k, k + p):
                    z = low[2] + c * spacing[2]
                    near = 1 / (depth + m[v, 2, 2] * z)
                    u = (column + m[v, 0, 2] * z) * near - 0.5
                    w = (row + m[v, 1, 2] * z) * near - 0.5
                    value = nothing
                    if near > 0 and left <= u < right - 1 and top <= w < bottom - 1:
                        value = _interpolate(outlines.distances, v, u, w)
                    if value < lows[s, last]:
                        _keep_lowest(lows, s, value)
                    s += 1
    s = 0
    for a in range(i, i + n):
        for b in range(j, j + o):
            for c in range(k, k + p):
                field[a, b, c] = lows[s, last] if lows[s, last] < np.inf else -far
                s += 1


@njit(nogil=True, cache=True, error_model="numpy")
def _view_distance(outlines, v, x, y, z):
    """A view's signed distance at the projection of a point of the world."""
    m = outlines.P
    near = 1 / (m[v, 2, 0] * x + m[v, 2, 1] * y + m[v, 2, 2] * z + m[v, 2, 3])
    u = (m[v, 0, 0] * x + m[v, 0, 1] * y + m[v, 0, 2] * z + m[v, 0, 3]) * near - 0.5
    w = (m[v, 1, 0] * x + m[v, 1, 1] * y + m[v, 1, 2] * z + m[v, 1, 3]) * near - 0.5
    left, top, right, bottom = outlines.spoken[v]
    if near > 0 and left <= u < right - 1 and top <= w < bottom - 1:
        return _interpolate(outlines.distances, v, u, w)
    return np.inf if outlines.cut[v] else -outlines.far


@njit(nogil=True, cache=True)
def _interpolate(images, v, u, w):
    """Interpolate an image bilinearly; centres of pixels have integer coordinates here."""
    c, r = int(u), int(w)
    u, w = u - c, w - r
    above = images[v, r, c] * (1 - u) + images[v, r, c + 1] * u
    below = images[v, r + 1, c] * (1 - u) + images[v, r + 1, c + 1] * u
    return above * (1 - w) + below * w


@njit(nogil=True, cache=True, error_model="numpy")
def _bound(outlines, deciding, x, y, z, radius, band, lower, lows):
    """Bound the field in a ball of the world, over the views ``deciding``.

    Returns the least and the greatest value, and the position of the view that ended the search:
    the first after which the greatest value lies below the band, or -1 if there is none.

    A step s from X moves u = (m_0 X) / (m_2 X) by (m_0 - u m_2) s / (m_2 (X + s)).

    Args:
        lower: [views], is filled with the lower bound of each view's distance
        lows: [2 or more, tolerated + 1], scratch space
    """
    m, far, images = outlines.P, outlines.far, outlines.distances
    lows[:2] = np.inf
    last = lows.shape[1] - 1
    for at in range(len(deciding)):
        v = deciding[at]
        depth = m[v, 2, 0] * x + m[v, 2, 1] * y + m[v, 2, 2] * z + m[v, 2, 3]
        near = 1 / depth
        u = (m[v, 0, 0] * x + m[v, 0, 1] * y + m[v, 0, 2] * z + m[v, 0, 3]) * near - 0.5
        w = (m[v, 1, 0] * x + m[v, 1, 1] * y + m[v, 1, 2] * z + m[v, 1, 3]) * near - 0.5
        nearest = depth - radius * outlines.ahead[v]
        nothing = np.inf if outlines.cut[v] else -far
        reach = radius * outlines.across[v] / nearest
        left, top, right, bottom = outlines.spoken[v]
        inside = min(min(u - left, right - 1 - u), min(w - top, bottom - 1 - w))
        if nearest > 0 and inside < -reach:
            least = most = nothing
        elif nearest <= 0 or inside <= reach:
            least, most = -far, max(far, nothing)
        else:
            here = _interpolate(images, v, u, w)
            least, most = here - STEEP * reach, here + STEEP * reach
        lower[at] = least
        if least < lows[0, last]:
            _keep_lowest(lows, 0, least)
        if most < lows[1, last]:
            _keep_lowest(lows, 1, most)
            if lows[1, last] < -band:
                return lows[0, last], lows[1, last], at
    return lows[0, last], lows[1, last], -1


@njit(nogil=True, cache=True)
def _keep_lowest(lows, row, value):
    """Insert a value into a row of the lowest values so far, which is in rising order."""
    for i in range(lows.shape[1]):
        if value < lows[row, i]:
            lows[row, i], value = value, lows[row, i]


@njit(nogil=True, cache=True, error_model="numpy")
def _votes_against(outlines, low, spacing, resolution):
    """Whether each view rejects each sample of a cubic grid: [samples, views] bool."""
    against = np.empty((resolution**3, len(outlines.distances)), np.bool_)
    for s in range(resolution**3):
        index = np.array([s // resolution**2, s // resolution % resolution, s % resolution])
        x, y, z = low + index * spacing
        for v in range(len(outlines.distances)):
            against[s, v] = _view_distance(outlines, v, x, y, z) < 0
    return against
