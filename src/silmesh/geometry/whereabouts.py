"""Where an object is that no photograph, or hardly any, shows whole: a coarse carving.

In a generous box every voxel is asked of every view: one that shows it within or next to its
silhouette sees it, one that shows it further outside than the voxel is large denies it, and one
beyond whose frame it lies says nothing if the frame cuts its silhouette. The object lies where many
see and hardly any of those that speak deny. The box is doubled until the object does not reach its
walls, and then drawn in around it. Where most photographs show one end of it, few see the others:
points of structure from motion that lie within the silhouettes tell of these.
"""

import numpy as np
import torch
from scipy import ndimage
from scipy.spatial import cKDTree

from silmesh.errors import InputError
from silmesh.geometry.camera import OBJECT_RADIUS, Cameras, Similarity
from silmesh.geometry.frame import open_frames

SAMPLES = 40  # voxels along a side of the box
DOUBLINGS, ROUNDS = 4, 3  # of the box, and of drawing it in
MARGIN = 1.2  # times as far as the places that many see may reach those at the object's ends
SEEING = 0.5  # of the views that see the most of all places: those that have to see a place
DENYING = 0.1  # of the views that speak of a place: those that may deny it
# A point is on the object if that share of the views, and no fewer than that, have it within their
# frames, hardly any of these a pixel or more outside its silhouette, and if it is not far from all
# others: from its eighth neighbour at most so many times as far as half of the points are.
SHOWING, FEWEST_SHOWING = 1 / 6, 3
NEIGHBOURS, LONELY = 8, 4.0
TAILS = 0.5, 99.5  # percentiles of their coordinates within which the points on the object count
FEWEST_POINTS = 60  # on the object, without which points tell nothing


def find_body(
    cameras: Cameras,
    silhouettes: np.ndarray,
    frames: np.ndarray | None,
    points: np.ndarray | None = None,
) -> Similarity:
    """The shift and scale that bring the object into the sphere of radius 0.5 at the origin.

    Args:
        cameras: in the input's world
        silhouettes: [views, height, width] bool, none empty
        frames: [views, 4] of the photographs within the images; the whole images if not given
        points: [n, 3] of structure from motion in that world, on the object and elsewhere

    Raises:
        InputError: the views have no place in common
    """
    filled = find_filled(cameras, silhouettes, frames)
    if points is not None:
        on_object = find_on_object(points, cameras, silhouettes, frames)
        filled = np.concatenate([filled, on_object])
    centre = (filled.min(axis=0) + filled.max(axis=0)) / 2
    radius = MARGIN * np.linalg.norm(filled - centre, axis=1).max()
    return Similarity(torch.as_tensor(centre), float(OBJECT_RADIUS / radius))


def find_on_object(
    points: np.ndarray, cameras: Cameras, silhouettes: np.ndarray, frames: np.ndarray | None
) -> np.ndarray:
    """Those of some points that are on the object, the outermost drawn in to the others: [k, 3].

    Of too few of them none. Arguments are those of ``find_body``.
    """
    _, spoken = open_frames(silhouettes, frames)
    shown, inside = np.zeros((2, len(points)))
    projected = cameras.project(torch.as_tensor(points)).numpy()
    for silhouette, part, seen in zip(silhouettes, spoken, projected, strict=True):
        pixel = np.floor(np.nan_to_num(seen, nan=-1))  # of what is behind the camera
        there = ((pixel >= part[:2]) & (pixel < part[2:])).all(axis=1)
        column, row = np.where(there, pixel.T, part[:2, None]).astype(int)
        shown += there
        inside += there & ndimage.binary_dilation(silhouette, np.ones((3, 3)))[row, column]
    enough = max(FEWEST_SHOWING, SHOWING * len(cameras))
    found = points[(shown >= enough) & (inside >= (1 - DENYING) * shown)]
    if len(found) < FEWEST_POINTS:
        return points[:0]
    apart = cKDTree(found).query(found, NEIGHBOURS + 1)[0][:, -1]
    found = found[apart <= LONELY * np.median(apart)]
    return np.clip(found, *np.percentile(found, TAILS, axis=0))


def find_filled(cameras: Cameras, silhouettes: np.ndarray, frames: np.ndarray | None) -> np.ndarray:
    """Points [n, 3] on a regular grid that the object fills as far as most views see.

    Arguments and errors are those of ``find_body``.
    """
    cut, spoken = open_frames(silhouettes, frames)
    signed = [_measure(s, part) for s, part in zip(silhouettes, spoken, strict=True)]
    centre = cameras.meet(_centroids(silhouettes)).numpy()
    distance = np.linalg.norm(cameras.centres.numpy() - centre, axis=1)
    middle, half = centre, np.full(3, float(np.median(distance)))
    for _ in range(DOUBLINGS):
        voxels = _Voxels(middle, half)
        filled = voxels.fill(cameras, signed, cut, spoken)
        if not voxels.reach_walls(filled):
            break
        half = 2 * half
    for _ in range(ROUNDS):
        if not filled.any():
            raise InputError(
                "the frame cuts the object in most photographs, and there is no place that "
                f"{SEEING:.0%} of the cameras see within their silhouettes and the others do not "
                "deny: the cameras and the silhouettes should be of the same photographs"
            )
        voxels = _Voxels(*voxels.box(filled))
        filled = voxels.fill(cameras, signed, cut, spoken)
    return voxels.points[filled.ravel()]


class _Voxels:
    """A box of SAMPLES voxels a side about a middle [3], half as wide as twice ``half`` [3]."""

    def __init__(self, middle: np.ndarray, half: np.ndarray):
        self._steps = 2 * half / SAMPLES
        index = np.indices((SAMPLES,) * 3).reshape(3, -1).T
        self.points = middle - half + (index + 0.5) * self._steps
        self._reach = float(np.linalg.norm(self._steps)) / 2

    def fill(
        self,
        cameras: Cameras,
        signed: list[np.ndarray],
        cut: np.ndarray,
        spoken: np.ndarray,
    ) -> np.ndarray:
        """Which voxels the object may fill, in one piece: [SAMPLES, SAMPLES, SAMPLES] bool."""
        seeing, denying = (np.zeros(len(self.points)) for _ in range(2))
        for i, P in enumerate(cameras.projections.numpy()):
            seen = self.points @ P[:, :3].T + P[:, 3]
            ahead = seen[:, 2] > self._reach
            depth = np.where(ahead, seen[:, 2], 1)
            pixel = np.floor(seen[:, :2] / depth[:, None])
            there = ahead & ((pixel >= spoken[i, :2]) & (pixel < spoken[i, 2:])).all(axis=1)
            column, row = np.where(there, pixel.T, spoken[i, :2, None]).astype(int)
            near = signed[i][row, column] > -self._reach * float(cameras.K[i, 0, 0]) / depth
            seeing += there & near
            denying += (there & ~near) | (~there & ~cut[i])
        enough = seeing >= max(2, SEEING * seeing.max())
        return _largest(
            (enough & (denying <= DENYING * (seeing + denying))).reshape((SAMPLES,) * 3)
        )

    def reach_walls(self, filled: np.ndarray) -> bool:
        """Whether a voxel at the box's walls is filled, or none at all."""
        return not filled.any() or filled.sum() > filled[1:-1, 1:-1, 1:-1].sum()

    def box(self, filled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Middle and half-lengths of the box about the filled voxels, and one more."""
        points = self.points[filled.ravel()]
        low, high = points.min(axis=0) - self._steps, points.max(axis=0) + self._steps
        return (low + high) / 2, (high - low) / 2


def _measure(silhouette: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Signed distance to the outline by the pixels of a part alone, positive inside."""
    left, top, right, bottom = part
    within = silhouette[top:bottom, left:right]
    signed = np.zeros(silhouette.shape, np.float32)
    outside = -ndimage.distance_transform_edt(~within)
    signed[top:bottom, left:right] = np.where(within, 1, outside)
    return signed


def _largest(filled: np.ndarray) -> np.ndarray:
    """The largest piece of voxels."""
    pieces, count = ndimage.label(filled)
    if count < 2:
        return filled
    return pieces == 1 + np.bincount(pieces.ravel())[1:].argmax()


def _centroids(silhouettes: np.ndarray) -> torch.Tensor:
    """The silhouettes' centroids, in pixels: [views, 2] float64."""
    middles = [np.argwhere(s)[:, ::-1].mean(axis=0) + 0.5 for s in silhouettes]
    return torch.as_tensor(np.stack(middles))
