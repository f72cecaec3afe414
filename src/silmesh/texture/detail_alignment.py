"""Cameras refined by the photographs: each is moved until its detail falls on that of the others.

Points on the surface have the mean detail of the views that see them; each camera, by six numbers,
minimises the weighted squares of the differences between its own detail and the mean of the others
(Zhou and Koltun 2014, their rigid part):

    sum over points of  w (D_i(x(xi)) - mean)^2  +  HOLD <|grad D|^2> w |x(xi) - x(0)|^2

x is where the camera sees a point after a turn and a shift xi in its own axes. D is a band of the
grey image that has neither light and shade nor noise; a coarse band comes first. The last term
holds cameras where the photographs say nothing. Points lie in cells of which half are not used to
move a camera but to judge it: one that agrees no better there stays where it was.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numba import njit
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from silmesh.geometry.camera import Cameras
from silmesh.texture.bands import average_blocks

LONGEST = 800  # pixels of the images that are compared
BANDS = ((2.5, 10.0), (1.0, 5.0))  # widths of the Gaussians whose difference is a band, in pixels
STEPS = 6  # in each band
HOLD = 0.03
CELLS = 16  # cells a side of the mesh's box
FEWEST = 100  # points by which a camera is moved
BETTER = 0.98  # of its error before, that a camera's is to fall to
NOTHING = 0.01  # grey levels: a smaller error before is the rounding of numbers
FARTHEST = 8.0  # pixels of these images that a point may move in a step of all


@dataclass(frozen=True)
class Details:
    """One photograph's detail, and the points it is compared at.

    Attributes:
        bands: for each band [height, width] float32
        scale: [2] pixels of it a pixel of the photograph, across and down
        weights: [points], 0 for those it does not see well
    """

    bands: tuple[np.ndarray, ...]
    scale: np.ndarray
    weights: np.ndarray


def take_details(
    photograph: np.ndarray, silhouette: np.ndarray, weights: np.ndarray, scale: np.ndarray
) -> Details:
    """The detail of a photograph [height, width, 3] within its silhouette [height, width].

    Args:
        weights: [points], as ``Details`` has them
        scale: [2] pixels of the photograph at its own size a pixel of this one, across and down
    """
    step = max(1, -(-max(silhouette.shape) // LONGEST))
    grey = photograph.astype(np.float32) @ np.full(3, 1 / 3, np.float32) * silhouette
    count = silhouette.astype(np.float32)
    if step > 1:
        grey, count = (average_blocks(image, step) for image in (grey, count))
    smooth = {}
    for width in {width for band in BANDS for width in band}:
        under = np.maximum(gaussian_filter(count, width, truncate=3), 1e-3)
        smooth[width] = gaussian_filter(grey, width, truncate=3) / under
    inside = count >= 0.5
    bands = tuple(np.where(inside, smooth[a] - smooth[b], 0) for a, b in BANDS)
    return Details(bands, 1 / (scale * step), weights)


class Alignment:
    """The cameras of some views, and how they move.

    Args:
        cameras: in pixels of the photographs
        points: [points, 3] on the surface
        details: of each view
    """

    def __init__(self, cameras: Cameras, points: np.ndarray, details: Sequence[Details]):
        self._cameras, self._details = cameras, details
        self._local = np.einsum("vij,nj->vni", cameras.R.numpy(), points)
        self._local += cameras.t.numpy()[:, None]
        scales = np.array([[*d.scale, 1] for d in details])
        self._K = scales[:, :, None] * cameras.K.numpy()
        self._weights = np.stack([d.weights for d in details])
        box = points.min(axis=0), np.ptp(points, axis=0).max() + 1e-12
        cells = ((points - box[0]) / box[1] * CELLS).astype(int)
        self._judges = cells.sum(axis=1) % 2 == 1
        self.moves = np.zeros((len(cameras), 6))

    def run(self) -> tuple[Cameras, dict]:
        """Move the cameras; give them back with what is to be said of it."""
        for band in range(len(BANDS)):
            for _ in range(STEPS):
                self._step(band)
        moved, last = self.moves, len(BANDS) - 1
        after = self._judge(last)
        self.moves = np.zeros_like(moved)
        before = self._judge(last)
        better = (after < BETTER * before) & (before > NOTHING)
        pixels = self._shifts(moved)
        if np.sum(after) >= BETTER * np.sum(before):
            better[:] = False
        self.moves = np.where(better[:, None], moved, 0)
        after = self._judge(last)
        notes = {
            "moved": int(better.sum()),
            "pixels": round(float(np.median(pixels[better])), 2) if better.any() else 0.0,
            "error_before": round(float(np.mean(before)), 3),
            "error_after": round(float(np.mean(after)), 3),
        }
        return self._apply(), notes

    def _apply(self) -> Cameras:
        turns = Rotation.from_rotvec(self.moves[:, :3]).as_matrix()
        R = turns @ self._cameras.R.numpy()
        t = np.einsum("vij,vj->vi", turns, self._cameras.t.numpy()) + self.moves[:, 3:]
        return replace(self._cameras, R=torch.tensor(R), t=torch.tensor(t))

    def _move(self, i: int, move: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points in the axes of a camera that has moved, and their pixels."""
        local = self._local[i] @ Rotation.from_rotvec(move[:3]).as_matrix().T + move[3:]
        seen = local @ self._K[i].T
        return local, seen[:, :2] / seen[:, 2:]

    def _shifts(self, moves: np.ndarray) -> np.ndarray:
        """Median pixels of the photographs that the points of each view move by."""
        found = []
        for i, move in enumerate(moves):
            seen = self._weights[i] > 0
            apart = self._move(i, move)[1] - self._move(i, 0 * move)[1]
            apart = np.linalg.norm(apart[seen] / self._details[i].scale, axis=1)
            found.append(np.median(apart) if len(apart) else 0.0)
        return np.array(found)

    def _sample(self, band: int) -> np.ndarray:
        """Detail and its gradient at all points: [views, points, 3]."""
        found = np.zeros((*self._weights.shape, 3))
        for i, detail in enumerate(self._details):
            seen = np.flatnonzero(self._weights[i])
            pixels = self._move(i, self.moves[i])[1][seen]
            values = np.empty((len(seen), 3))
            _differ(detail.bands[band], pixels, values)
            found[i, seen] = values
        return found

    def _compare(self, band: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Differences to the mean of the others, their weights, and gradients, of all points."""
        sampled = self._sample(band)
        weighted = self._weights * sampled[..., 0]
        others = self._weights.sum(axis=0) - self._weights
        mean = (weighted.sum(axis=0) - weighted) / np.maximum(others, 1e-9)
        apart = sampled[..., 0] - mean
        weights = self._weights * others / (self._weights + others + 1e-9)
        spread = np.sqrt((weights * apart**2).sum() / max(weights.sum(), 1e-9)) + 1e-6
        return apart, weights / (1 + (apart / (1.5 * spread)) ** 2), sampled[..., 1:]

    def _judge(self, band: int) -> np.ndarray:
        """Each view's mean difference at the points that do not move it, 0 without any: [views]."""
        apart, _, _ = self._compare(band)
        weights = self._weights * self._judges
        return (weights * np.abs(apart)).sum(axis=1) / np.maximum(weights.sum(axis=1), 1e-12)

    def _step(self, band: int) -> None:
        """One Gauss-Newton step of every camera."""
        apart, weights, gradients = self._compare(band)
        moves = self.moves.copy()
        for i in range(len(moves)):
            used = np.flatnonzero((weights[i] > 0) & ~self._judges)
            if len(used) < FEWEST:
                continue
            local, pixels = self._move(i, self.moves[i])
            held = (pixels - self._move(i, np.zeros(6))[1])[used]
            J = _differentiate(local[used], self._K[i])
            w, g = weights[i, used], gradients[i, used]
            hold = HOLD * (w @ (g**2).sum(axis=1)) / max(w.sum(), 1e-12)
            along = np.einsum("nk,nkp->np", g, J)
            left = along.T @ (w[:, None] * along) + hold * np.einsum("n,nkp,nkq->pq", w, J, J)
            right = along.T @ (w * apart[i, used]) + hold * np.einsum("n,nkp,nk->p", w, J, held)
            if not np.trace(left) > 0:  # the photographs have no detail there
                continue
            change = -np.linalg.solve(left + 1e-9 * np.trace(left) * np.eye(6), right)
            far = np.abs(J @ change).max()
            moves[i] += change * min(1.0, FARTHEST / max(far, 1e-12))
        self.moves = moves


def _differentiate(local: np.ndarray, K: np.ndarray) -> np.ndarray:
    """How pixels change with a turn and a shift in the camera's axes: [n, 2, 6]."""
    x, y, z = local.T
    along = np.zeros((len(local), 2, 3))
    along[:, 0, 0], along[:, 0, 1] = K[0, 0] / z, K[0, 1] / z
    along[:, 0, 2] = -(K[0, 0] * x + K[0, 1] * y) / z**2
    along[:, 1, 1], along[:, 1, 2] = K[1, 1] / z, -K[1, 1] * y / z**2
    return np.concatenate([np.cross(local[:, None], along), along], axis=2)


@njit(nogil=True, cache=True, error_model="numpy")
def _differ(image, pixels, out):
    """An image's bilinear values at pixels, and their gradients over two pixels."""
    height, width = image.shape
    for i in range(len(pixels)):
        x, y = pixels[i, 0] - 0.5, pixels[i, 1] - 0.5
        x, y = min(max(x, 1.0), width - 3.0), min(max(y, 1.0), height - 3.0)
        j, k = int(x), int(y)
        a, b = x - j, y - k
        out[i, :] = 0
        for row in range(2):
            for column in range(2):
                share = (a if column else 1 - a) * (b if row else 1 - b)
                r, c = k + row, j + column
                out[i, 0] += share * image[r, c]
                out[i, 1] += share * (image[r, c + 1] - image[r, c - 1]) / 2
                out[i, 2] += share * (image[r + 1, c] - image[r - 1, c]) / 2
