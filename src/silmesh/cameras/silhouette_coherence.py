"""Silhouette coherence: how far the rays through an outline miss the hull of the other views.

The ray through a point of an outline touches the object. So at some depth it must project into or
onto the silhouette of every other view. The residual of a ray is

    r = min(0, max over the ray of  min over the other views of  signed distance to their outline)

in pixels of the view whose silhouette it misses. It is 0 if cameras and silhouettes agree. This is
the silhouette coherence of Hernandez, Schmitt and Cipolla (*Silhouette coherence for camera
calibration under circular motion*, 2007), measured by a distance where they count hits. A residual
that is not 0 is a signed distance at one depth in one view; its derivatives are those of this
distance with depth and view held fixed.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from numba import njit
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.special import ndtri
from skimage.measure import find_contours

from silmesh.errors import InputError
from silmesh.geometry.camera import OBJECT_RADIUS, Cameras
from silmesh.geometry.frame import is_cut, whole_frames
from silmesh.geometry.signed_distance import signed_distance

REACH = 3 / 32  # signed distances are cut off beyond this share of the image's side
DEPTHS = 48  # depths at which each ray is sampled first
HALVINGS = 5  # times that the step is then halved about the best depth so far
OTHERS = 128  # views, at most, that a ray is held against
BLUR = 1.0  # pixels: standard deviation of the Gaussian that locates outlines between pixels
# Pixels by which the blurred outline may leave a pixel's centre on its wrong side; without this
# limit the blur would erase thin parts.
SHIFT = 0.35
RADIUS = 1.2 * OBJECT_RADIUS  # of the sphere in which rays are followed in a normalised world
EDGE = 1.0  # pixels: an outline this near the frame is taken to be the frame and not the object


@dataclass(frozen=True)
class Outlines:
    """Silhouettes, prepared for the residuals.

    Attributes:
        distances: [views, height, width] float32, signed distance to the outline, positive inside
        cut: [views] bool, whether the frame cuts the silhouette; what lies beyond is then unknown
        points: [views, samples, 2] pixels x, y, spread evenly along each outline
        known: [views, samples] bool, whether the outline there is the object's and not the frame's
        far: pixels, where signed distances are cut off
    """

    distances: np.ndarray
    cut: np.ndarray
    points: np.ndarray
    known: np.ndarray
    far: float

    def select(self, views: Sequence[int], every: int = 1) -> "Outlines":
        """Only these views, with every ``every``-th of their points."""
        return Outlines(
            self.distances[views],
            self.cut[views],
            self.points[views][:, ::every],
            self.known[views][:, ::every],
            self.far,
        )


def trace(
    silhouettes: np.ndarray,
    samples: int,
    views: Sequence[str],
    frames: np.ndarray | None = None,
    reach: float = REACH,
) -> Outlines:
    """Trace the outlines of silhouettes, [views, height, width] bool, at ``samples`` points each.

    Args:
        views: their names, for messages
        frames: [views, 4] left, top, right and bottom of the photographs within the images; the
            whole images if not given
        reach: share of the image's side beyond which distances are cut off

    Raises:
        InputError: a silhouette is empty or fills its image
    """
    for view, s in zip(views, silhouettes, strict=True):
        if s.all() or not s.any():
            what = "fills its image" if s.any() else "is empty"
            raise InputError(f"the silhouette of view {view!r} {what}; it has no outline")
    far = reach * max(silhouettes.shape[1:])
    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        distances = np.stack(list(pool.map(lambda s: _measure_distance(s, far), silhouettes)))
    points = np.stack([_spread_points(d, samples) for d in distances])
    if frames is None:
        frames = whole_frames(silhouettes)
    least, most = frames[:, None, :2] + EDGE, frames[:, None, 2:] - EDGE
    known = ((points > least) & (points < most)).all(axis=2)
    cut = is_cut(silhouettes, frames)
    for i in np.flatnonzero(cut):
        _forget_beyond(distances[i], frames[i])
    return Outlines(distances, cut, points, known, far)


def _forget_beyond(distance: np.ndarray, frame: Sequence[int]) -> None:
    """Set distances beyond a photograph's frame to NaN, which means unknown."""
    left, top, right, bottom = frame
    inside = distance[top:bottom, left:right].copy()
    distance[:] = np.nan
    distance[top:bottom, left:right] = inside


def _measure_distance(silhouette: np.ndarray, far: float) -> np.ndarray:
    """Signed distance to the outline, accurate to a fraction of a pixel near the outline.

    A Gaussian blur of a straight edge has the profile Phi(d / BLUR) at the distance d, with the
    normal distribution Phi. So d = BLUR Phi^-1(blurred), which averages the stairs of the pixels
    along the edge. Two pixels from the outline and beyond, the plain distance is as good.
    """
    plain = signed_distance(silhouette, far, 0.0)
    near = np.abs(plain) < 3
    blurred = gaussian_filter(silhouette.astype(np.float32), BLUR)[near]
    smooth = BLUR * ndtri(blurred.clip(1e-3, 1 - 1e-3))
    inside = silhouette[near]
    smooth = np.where(inside, np.maximum(smooth, -SHIFT), np.minimum(smooth, SHIFT))
    share = np.clip(2 - np.abs(smooth), 0, 1)
    plain[near] += share * (smooth - plain[near])
    return plain


def _spread_points(distance: np.ndarray, samples: int) -> np.ndarray:
    """Points at equal steps along the longest outline: [samples, 2] pixels x, y.

    The blur leaves nothing inside of a silhouette of a few pixels: its outline is then drawn around
    what is most inside.
    """
    closed = np.pad(distance, 1, constant_values=-0.5)
    level = 0.0 if closed.max() > 0 else float(closed.max()) - 0.05  # above what is padded
    outline = max(find_contours(closed, level), key=len) - 0.5  # rows, columns; centres at + 0.5
    length = np.concatenate([[0], np.linalg.norm(np.diff(outline, axis=0), axis=1).cumsum()])
    at = (np.arange(samples) + 0.5) / samples * length[-1]
    return np.stack([np.interp(at, length, outline[:, axis]) for axis in (1, 0)], axis=1)


@dataclass(frozen=True)
class Pose:
    """Cameras, as the kernels take them.

    Attributes:
        P: [views, 3, 4] projections to pixels
        centres: [views, 3]
        rays: [views, samples, 3], directions through the outlines' points, of unit depth
        middle: [views], depth of the object's middle in each camera
    """

    P: np.ndarray
    centres: np.ndarray
    rays: np.ndarray
    middle: np.ndarray


def make_pose(
    K: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    points: np.ndarray,
    maps: np.ndarray | None = None,
) -> Pose:
    """Prepare cameras and the points of outlines.

    Args:
        K: [3, 3] of all, or one each
        R: [views, 3, 3]
        t: [views, 3]
        points: [views, samples, 2] pixels
        maps: [views, 2, 2] scale (x, y) and shift (x, y) by which each view was cropped, if any was
    """
    P = K @ np.concatenate([R, t[:, :, None]], axis=2)
    if maps is not None:
        scale, shift = maps[:, 0], maps[:, 1]
        points = uncrop(points, maps)
        P[:, :2] = scale[:, :, None] * P[:, :2] + shift[:, :, None] * P[:, 2:]
    rays = np.concatenate([points, np.ones_like(points[..., :1])], axis=2)
    rays = rays @ np.linalg.inv(K).swapaxes(-1, -2)
    return Pose(P, -np.einsum("vji,vj->vi", R, t), rays @ R, np.ascontiguousarray(t[:, 2]))


def pose_of(cameras: Cameras, points: np.ndarray) -> Pose:
    """Cameras, each with its own K, and the points [views, samples, 2] of their outlines."""
    return make_pose(*(part.numpy() for part in (cameras.K, cameras.R, cameras.t)), points)


def uncrop(points: np.ndarray, maps: np.ndarray) -> np.ndarray:
    """Where points [views, n, 2] of cropped views lie in the images before the crop."""
    return (points - maps[:, 1, None]) / maps[:, 0, None]


@dataclass(frozen=True)
class Misses:
    """The residuals of all rays, and where each ray misses.

    Attributes:
        pixels: [views, samples], the residual r, 0 or negative
        depth: [views, samples], at which the ray misses least, relative to the object's middle
        view: [views, samples] int64, the view that it misses there; -1 if it misses none
    """

    pixels: np.ndarray
    depth: np.ndarray
    view: np.ndarray


def find_misses(outlines: Outlines, pose: Pose, radius: float) -> Misses:
    """Search every ray, from ``radius`` before the object's middle to ``radius`` behind it."""
    views, samples = outlines.known.shape
    pixels, depth = np.zeros((2, views, samples))
    view = np.full((views, samples), -1)
    order = _spread_turns(views)
    far, threads = outlines.far, torch.get_num_threads()

    def follow(part: np.ndarray) -> None:
        _follow(part, outlines.distances, outlines.cut, far, outlines.known, pose.P, pose.centres,
                pose.rays, pose.middle, radius, order, pixels, depth, view)  # fmt: skip

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(follow, [np.arange(i, views, threads) for i in range(threads)]))
    return Misses(pixels, depth, view)


def find_misses_of(cameras: Cameras, outlines: Outlines) -> Misses:
    """The residuals of cameras in the normalised world, which holds the object in its sphere."""
    return find_misses(outlines, pose_of(cameras, outlines.points), RADIUS)


def distance_between(outlines: Outlines) -> float:
    """Root mean square distance of all outlines from that of the first view, in pixels."""
    x, y = np.moveaxis(outlines.points[outlines.known], -1, 0) - 0.5
    off = map_coordinates(outlines.distances[0], (y, x), order=1, mode="nearest")
    return float(np.sqrt(np.nanmean(off**2)))


def measure_at(outlines: Outlines, misses: Misses, rays: Pose, others: Pose) -> np.ndarray:
    """The signed distances at the depths and in the views of ``misses``: [views, samples] pixels.

    Args:
        rays: cameras of the views whose rays these are
        others: cameras of the views that the rays miss
    """
    at = np.zeros_like(misses.pixels)
    _measure(outlines.distances, outlines.far, others.P, rays.centres, rays.rays, rays.middle,
             misses.depth, misses.view, at)  # fmt: skip
    return at


def _spread_turns(views: int) -> np.ndarray:
    """Offsets from a view to the others, quarter turns first: they carve most.

    All of them up to ``OTHERS`` views; of more an even choice, so that time grows with the views
    and not with their square.
    """
    steps = [round(i * views / k) for k in (4, 16, 64, OTHERS) for i in range(1, k)]
    return np.array([s for s in dict.fromkeys(steps) if 0 < s < views])


@njit(nogil=True, cache=True, error_model="numpy")
def _sample(images, P, v, x, y, z):
    """The distance of view v at a point's projection, bilinear; NaN beyond the frame."""
    _, height, width = images.shape
    depth = P[v, 2, 0] * x + P[v, 2, 1] * y + P[v, 2, 2] * z + P[v, 2, 3]
    column = (P[v, 0, 0] * x + P[v, 0, 1] * y + P[v, 0, 2] * z + P[v, 0, 3]) / depth - 0.5
    row = (P[v, 1, 0] * x + P[v, 1, 1] * y + P[v, 1, 2] * z + P[v, 1, 3]) / depth - 0.5
    if not (depth > 0 and 0 <= column < width - 1 and 0 <= row < height - 1):
        return np.nan
    c, r = int(column), int(row)
    u, w = column - c, row - r
    above = images[v, r, c] * (1 - u) + images[v, r, c + 1] * u
    below = images[v, r + 1, c] * (1 - u) + images[v, r + 1, c + 1] * u
    return above * (1 - w) + below * w


@njit(nogil=True, cache=True, error_model="numpy")
def _find_least(distances, cut, far, P, order, v, x, y, z, best):
    """The least distance of a point over all views but ``v``, at most 0, and the view that has it.

    The search ends as soon as the distance is not above ``best``.
    """
    least, view = 0.0, -1
    for turn in order:
        j = (v + turn) % len(distances)
        value = _sample(distances, P, j, x, y, z)
        if np.isnan(value):
            if cut[j]:
                continue
            value = -far
        if value < least:
            least, view = value, j
            if least <= best:
                break
    return least, view


@njit(nogil=True, cache=True, error_model="numpy")
def _follow(
    part, distances, cut, far, known, P, centres, rays, middle, radius, order,
    pixels, depth, view,
):  # fmt: skip
    """Fill the rows ``part`` of the last three arrays, which are those of ``Misses``.

    A ray is sampled first at even depths, from the middle outwards, since a good depth that is met
    early rules out the others sooner. Then the step about the best depth is halved repeatedly.
    """
    for v in part:
        for s in range(rays.shape[1]):
            if not known[v, s]:
                continue
            best, best_depth, best_view = -np.inf, 0.0, -1
            step, base = 2 * radius / DEPTHS, 0.0
            for k in range(DEPTHS + 2 * HALVINGS):
                if best == 0:
                    break
                if k < DEPTHS:
                    aside = k // 2 if k % 2 == 0 else -(k + 1) // 2
                    offset = step * (aside + 0.5)
                elif (k - DEPTHS) % 2 == 0:
                    step, base = step / 2, best_depth
                    offset = base - step
                else:
                    offset = base + step
                along = middle[v] + offset
                least, least_view = _find_least(
                    distances, cut, far, P, order, v,
                    centres[v, 0] + along * rays[v, s, 0],
                    centres[v, 1] + along * rays[v, s, 1],
                    centres[v, 2] + along * rays[v, s, 2], best,
                )  # fmt: skip
                if least > best:
                    best, best_depth, best_view = least, offset, least_view
            pixels[v, s], depth[v, s], view[v, s] = best, best_depth, best_view


@njit(nogil=True, cache=True, error_model="numpy")
def _measure(distances, far, P, centres, rays, middle, depth, view, at):
    """Fill ``at``: the distance in one view at one depth of each ray; 0 for no view."""
    for v in range(rays.shape[0]):
        for s in range(rays.shape[1]):
            j = view[v, s]
            if j < 0:
                continue
            along = middle[v] + depth[v, s]
            x = centres[v, 0] + along * rays[v, s, 0]
            y = centres[v, 1] + along * rays[v, s, 1]
            z = centres[v, 2] + along * rays[v, s, 2]
            value = _sample(distances, P, j, x, y, z)
            at[v, s] = -far if np.isnan(value) else value
