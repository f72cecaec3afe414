"""The visual hull: the largest body that every silhouette allows (Laurentini 1994).

Each silhouette becomes a signed distance to its outline, positive inside. The hull's field at a
world point is the least of these over the views at the point's projections, so its zero level is
the hull's surface, finer than the grid that it is sampled on.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from numba import njit
from scipy.ndimage import distance_transform_edt
from skimage.measure import marching_cubes

from silmesh.cameras.camera import OBJECT_RADIUS, Cameras

REACH = 1 / 16  # of the image's side: distances to the outline are cut off there
GRACE = 0.15  # pixels that every outline is moved outwards: each is only known to half a pixel,
# and the hull takes the worst of all views; without it thin parts vanish from small images
COARSE = 48  # samples a side of the first grid, which only finds the box that the hull fills


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


def carve(silhouettes: np.ndarray, cameras: Cameras, resolution: int = 128) -> Hull:
    """Carve the visual hull out of the cube about the sphere that holds the object.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        resolution: samples along each side of the box that the hull fills
    """
    far = REACH * max(silhouettes.shape[1:])
    P = cameras.projections.numpy()
    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        distances = np.stack(list(pool.map(lambda s: signed_distance(s, far), silhouettes)))
        low, high = np.full(3, -1.6 * OBJECT_RADIUS), np.full(3, 1.6 * OBJECT_RADIUS)
        coarse = _sample(distances, P, low, high, COARSE, pool)
        filled = np.argwhere(coarse.field > -min(0.95 * far, _half_cell(cameras, coarse.spacing)))
        if not len(filled):
            return coarse
        low = coarse.origin + (filled.min(axis=0) - 1) * coarse.spacing
        high = coarse.origin + (filled.max(axis=0) + 1) * coarse.spacing
        return _sample(distances, P, low, high, resolution, pool)


def signed_distance(silhouette: np.ndarray, far: float, grace: float = GRACE) -> np.ndarray:
    """Distance of each pixel's centre to the outline between pixels, positive inside.

    Args:
        silhouette: [height, width] bool
        far: where distances are cut off, in pixels
        grace: how far the outline is moved outwards, in pixels
    Returns:
        [height, width] float32
    """
    if silhouette.all() or not silhouette.any():
        return np.full(silhouette.shape, far if silhouette.any() else -far, np.float32)
    inside, outside = distance_transform_edt(silhouette), distance_transform_edt(~silhouette)
    signed = np.where(silhouette, inside - 0.5, 0.5 - outside) + grace
    return signed.clip(-far, far).astype(np.float32)


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
    pool: ThreadPoolExecutor,
) -> Hull:
    """Sample the field on a grid over a box, a slab of constant x at a time."""
    field = np.empty((resolution,) * 3, np.float32)
    spacing = (high - low) / (resolution - 1)
    far = distances.max()
    cut = np.array([(d[[0, -1]] > 0).any() or (d[:, [0, -1]] > 0).any() for d in distances])
    slabs = np.array_split(np.arange(resolution), min(resolution, 4 * torch.get_num_threads()))

    def fill(slab: np.ndarray) -> None:
        corner = low + spacing * [slab[0], 0, 0]
        _fill(field[slab[0] : slab[-1] + 1], distances, cut, far, P, corner, spacing)

    list(pool.map(fill, slabs))
    return Hull(field, low, spacing)


@njit(nogil=True, cache=True, error_model="numpy")
def _fill(field, distances, cut, far, P, low, spacing):
    """The least signed distance over the views at every sample of ``field`` [x, y, z].

    A sample that a view puts further outside than ``far`` stays there. One that lies beyond a
    view's frame is outside, unless the frame cuts the silhouette: then the view says nothing. A
    sample of which no view says anything is outside.
    """
    views, height, width = distances.shape
    for i in range(field.shape[0]):
        x = low[0] + i * spacing[0]
        for j in range(field.shape[1]):
            y = low[1] + j * spacing[1]
            for k in range(field.shape[2]):
                z = low[2] + k * spacing[2]
                least = np.inf
                for v in range(views):
                    m = P[v]
                    depth = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
                    column = (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) / depth - 0.5
                    row = (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) / depth - 0.5
                    if depth > 0 and 0 <= column < width - 1 and 0 <= row < height - 1:
                        c, r = int(column), int(row)
                        u, w = column - c, row - r
                        image = distances[v]
                        above = image[r, c] * (1 - u) + image[r, c + 1] * u
                        below = image[r + 1, c] * (1 - u) + image[r + 1, c + 1] * u
                        least = min(least, above * (1 - w) + below * w)
                    elif not cut[v]:
                        least = -far
                    if least <= -far:
                        break
                field[i, j, k] = least if least < np.inf else -far
