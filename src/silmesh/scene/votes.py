"""Votes of the other views: along a pixel's ray, how few views deny that the object is there.

A view denies a point that projects outside its silhouette. The pixels of view i whose ray has a
point that no other view denies are the leave-one-out visual hull, rendered in i. The pixels whose
ray has a point that at most k views deny are a hull that tolerates k wrong silhouettes. Both come
from one map of view i,

    denials(u, v) = min over the points x of the ray through (u, v) of
                    the sum over the views j != i of [x is seen outside the silhouette of j]

which needs no grid of voxels: each ray is sampled at distances of about a pixel.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit, prange
from scipy.ndimage import binary_dilation, binary_erosion

from silmesh.geometry.camera import OBJECT_RADIUS, Cameras
from silmesh.geometry.frame import is_cut, whole_frames

GRACE = 1  # pixels: a view does not deny points that project this close to its silhouette
REACH = 1.2 * OBJECT_RADIUS  # radius of the sphere about the origin in which rays are sampled
SQUARE = np.ones((1, 3, 3), bool)
COARSE = 2  # pixels between the rays by which the outline of a hull is found


def count_denials(
    silhouettes: np.ndarray,
    cameras: Cameras,
    of: Sequence[int],
    by: Sequence[int],
    most: int,
    stride: int = 1,
    frames: np.ndarray | None = None,
    where: np.ndarray | None = None,
) -> np.ndarray:
    """For some views, the least number of other views that deny any point of each pixel's ray.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        of: the views to map
        by: the views that vote; a view has no vote about itself
        most: counts end here
        stride: every ``stride``-th pixel of each row and column is mapped
        frames: [views, 4] left, top, right and bottom of the photographs within the images; a view
            whose frame cuts the silhouette has no vote beyond the frame. The whole images if not
            given
        where: [len(of), height / stride, width / stride] bool, the pixels to map; all if not given
    Returns:
        [len(of), height / stride, width / stride] uint8, ``most`` where as many or
        more views deny every point, or where nothing is mapped
    """
    frames = whole_frames(silhouettes) if frames is None else frames
    denied = ~_grow(silhouettes, GRACE)
    cut = is_cut(silhouettes, frames)
    for i in np.flatnonzero(cut):
        left, top, right, bottom = frames[i]
        denied[i, :top] = denied[i, bottom:] = denied[i, :, :left] = denied[i, :, right:] = False
    P = cameras.projections.numpy()
    focal = cameras.K[:, 0, 0].numpy()
    step = float(np.median(cameras.centres.norm(dim=1).numpy() / focal)) * (1 + stride) / 2
    height, width = (-(-side // stride) for side in silhouettes.shape[1:])
    where = np.ones((len(of), height, width), bool) if where is None else where
    maps = []
    for i, wanted in zip(of, where, strict=True):
        others = np.array([j for j in by if j != i], np.int64)
        ray = np.linalg.inv(P[i, :, :3])
        eye = cameras.centres[i].numpy()
        maps.append(_count(denied, cut, P, others, ray, eye, step, REACH, most, stride, wanted))
    return np.stack(maps)


def _grow(silhouettes: np.ndarray, steps: int) -> np.ndarray:
    """Silhouettes [views, height, width] with so many steps to the four neighbours of their pixels.

    By shifts of all at once, several times as fast as a general dilation.
    """
    for _ in range(steps):
        grown = silhouettes.copy()
        grown[:, 1:] |= silhouettes[:, :-1]
        grown[:, :-1] |= silhouettes[:, 1:]
        grown[:, :, 1:] |= silhouettes[:, :, :-1]
        grown[:, :, :-1] |= silhouettes[:, :, 1:]
        silhouettes = grown
    return silhouettes


def find_allowed(
    silhouettes: np.ndarray,
    cameras: Cameras,
    of: Sequence[int],
    by: Sequence[int],
    frames: np.ndarray | None = None,
) -> np.ndarray:
    """Where no other view denies every point: the hull of the others, rendered in some views.

    First every second ray is cast, then those near the outline. Arguments are those of
    ``count_denials``.

    Returns:
        [len(of), height, width] bool
    """
    height, width = silhouettes.shape[1:]
    coarse = count_denials(silhouettes, cameras, of, by, 1, COARSE, frames) == 0
    coarse = coarse.repeat(COARSE, axis=1).repeat(COARSE, axis=2)[:, :height, :width]
    sure = binary_erosion(coarse, SQUARE, iterations=COARSE)
    where = binary_dilation(coarse, SQUARE, iterations=COARSE) & ~sure
    return sure | (count_denials(silhouettes, cameras, of, by, 1, 1, frames, where) == 0)


@njit(parallel=True, cache=True, error_model="numpy")
def _count(denied, cut, P, others, ray, eye, step, reach, most, stride, wanted):
    """The map of one view: ``ray`` [3, 3] maps a pixel to the direction of its ray from ``eye``."""
    counts = np.empty(wanted.shape, np.uint8)
    for line in prange(len(counts)):
        start, along = np.empty((len(others), 3)), np.empty((len(others), 3))
        for n in range(len(others)):
            m = P[others[n]]
            for k in range(3):
                start[n, k] = m[k, 0] * eye[0] + m[k, 1] * eye[1] + m[k, 2] * eye[2] + m[k, 3]
        for column in range(counts.shape[1]):
            u, v = stride * column + 0.5, stride * line + 0.5
            way = ray[:, 0] * u + ray[:, 1] * v + ray[:, 2]
            way /= np.sqrt((way * way).sum())
            middle = -(way * eye).sum()
            half2 = reach * reach - ((eye + middle * way) ** 2).sum()
            least = most
            if half2 > 0 and wanted[line, column]:
                half = np.sqrt(half2)
                for n in range(len(others)):
                    m = P[others[n]]
                    for k in range(3):
                        along[n, k] = m[k, 0] * way[0] + m[k, 1] * way[1] + m[k, 2] * way[2]
                samples = int(2 * half / step) + 2
                for s in range(samples):
                    at = max(middle - half + 2 * half * s / (samples - 1), 0.0)
                    least = min(least, _denying(denied, cut, others, start, along, at, least))
                    if least == 0:
                        break
            counts[line, column] = least
    return counts


@njit(cache=True, error_model="numpy")
def _denying(denied, cut, others, start, along, at, most):
    """How many views deny the point at the distance ``at`` along a ray, counted up to ``most``."""
    _, height, width = denied.shape
    count = 0
    for n in range(len(others)):
        depth = start[n, 2] + at * along[n, 2]
        column = (start[n, 0] + at * along[n, 0]) / depth
        row = (start[n, 1] + at * along[n, 1]) / depth
        if depth > 0 and 0 <= column < width and 0 <= row < height:
            count += denied[others[n], int(row), int(column)]
        elif not cut[others[n]]:
            count += 1
        if count >= most:
            return most
    return count
