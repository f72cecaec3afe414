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
from scipy.ndimage import binary_dilation

from silmesh.geometry.camera import OBJECT_RADIUS, Cameras
from silmesh.geometry.frame import is_cut, whole_frames

GRACE = 1  # pixels: a view does not deny points that project this close to its silhouette
REACH = 1.2 * OBJECT_RADIUS  # radius of the sphere about the origin in which rays are sampled
# A structuring element: the four neighbours of a pixel.
ROUND = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], bool)


def count_denials(
    silhouettes: np.ndarray,
    cameras: Cameras,
    of: Sequence[int],
    by: Sequence[int],
    most: int,
    stride: int = 1,
    frames: np.ndarray | None = None,
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
    Returns:
        [len(of), height / stride, width / stride] uint8, ``most`` where as many or
        more views deny every point
    """
    frames = whole_frames(silhouettes) if frames is None else frames
    denied = ~binary_dilation(silhouettes, ROUND[None], iterations=GRACE)
    cut = is_cut(silhouettes, frames)
    for i in np.flatnonzero(cut):
        left, top, right, bottom = frames[i]
        denied[i, :top] = denied[i, bottom:] = denied[i, :, :left] = denied[i, :, right:] = False
    P = cameras.projections.numpy()
    focal = cameras.K[:, 0, 0].numpy()
    step = float(np.median(cameras.centres.norm(dim=1).numpy() / focal)) * (1 + stride) / 2
    maps = []
    for i in of:
        others = np.array([j for j in by if j != i], np.int64)
        ray = np.linalg.inv(P[i, :, :3])
        eye = cameras.centres[i].numpy()
        maps.append(_count(denied, cut, P, others, ray, eye, step, REACH, most, stride))
    return np.stack(maps)


@njit(parallel=True, cache=True, error_model="numpy")
def _count(denied, cut, P, others, ray, eye, step, reach, most, stride):
    """The map of one view: ``ray`` [3, 3] maps a pixel to the direction of its ray from ``eye``."""
    _, height, width = denied.shape
    counts = np.empty(((height - 1) // stride + 1, (width - 1) // stride + 1), np.uint8)
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
            if half2 > 0:
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
