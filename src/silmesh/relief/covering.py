"""What silhouettes ask of a field: every pixel of them is filled by something.

The ray of each pixel that the bound covers is followed through the grid. Where it meets nothing,
free space was seen through the object although no background shows there. The depths whose rays
pass the sample on it that comes nearest to being inside contradict the silhouettes, as those do
that gloss pretends, and count no more; what then is still missing is put back.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch
from numba import njit
from scipy.ndimage import binary_dilation

from silmesh.ahead import ahead
from silmesh.geometry.camera import Cameras
from silmesh.relief.depths import Depths
from silmesh.relief.free_space import BAND, Grid
from silmesh.relief.ncc import OPTIONS
from silmesh.relief.sights import Sights

WIDE = 3  # voxels by which what is missing grows before it strikes depths: a window's reach
STEP = 0.5  # voxels between samples of a ray
PUT_BACK = 0.1  # the field where something is put back, in BANDs
# A ray that comes squarely on a surface is DEEP inside, in BANDs, after so many voxels.
DEEP, SOON = 0.5, 3.0


def cover(
    field: np.ndarray,
    bound: np.ndarray,
    grid: Grid,
    silhouettes: np.ndarray,
    cameras: Cameras,
) -> tuple[np.ndarray, np.ndarray]:
    """Which places silhouettes miss, and which of their pixels are filled.

    Args:
        field, bound: [grid], positive inside
        silhouettes: [views, height, width] bool
        cameras: of these views
    Returns:
        [grid] bool, the samples that are to be put back; [views, height, width] bool
    """
    missing, filled = np.zeros(grid.shape, bool), np.zeros_like(silhouettes)

    def follow(i: int) -> None:
        _follow(field, bound, missing, filled[i], silhouettes[i], *_place(grid, cameras, i))

    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        list(pool.map(follow, range(len(cameras))))
    return missing, filled


def count_seers(
    field: np.ndarray, grid: Grid, silhouettes: np.ndarray, cameras: Cameras
) -> np.ndarray:
    """How many views see each sample of the surface, not grazing it: [grid] int.

    Arguments are those of ``cover``.
    """

    def watch(i: int) -> np.ndarray:
        seen = np.zeros(grid.shape, bool)
        _watch(field, seen, silhouettes[i], *_place(grid, cameras, i))
        return seen

    counts = np.zeros(grid.shape, np.int16)
    for seen in ahead(watch, range(len(cameras)), torch.get_num_threads()):
        counts += seen
    return counts


def strike(
    votes: np.ndarray, found: Depths, sights: Sights, missing: np.ndarray, grid: Grid
) -> int:
    """Take the votes of depths whose rays pass what silhouettes miss before they end, in place.

    Returns:
        how many depths lost theirs
    """
    wide = binary_dilation(missing, iterations=WIDE)

    def pass_through(i: int) -> int:
        placed = grid.place(sights.K[i], sights.R[i], sights.centres[i])
        return _strike(votes[i], found.depth[i], wide, *placed)

    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        return sum(pool.map(pass_through, range(len(votes))))


def _place(grid: Grid, cameras: Cameras, i: int) -> tuple[np.ndarray, np.ndarray]:
    """A view's camera, as ``Grid.place`` gives it."""
    return grid.place(cameras.K[i].numpy(), cameras.R[i].numpy(), cameras.centres[i].numpy())


@njit(**OPTIONS)
def _strike(votes, depth, missing, eye, to_grid):
    """The same for one view; ``eye`` and ``to_grid`` are as ``Grid.place`` gives them."""
    height, width = depth.shape
    struck = 0
    for r in range(height):
        for c in range(width):
            if not votes[r, c]:
                continue
            way = (c + 0.5) * to_grid[0] + (r + 0.5) * to_grid[1] + to_grid[2]
            step = STEP / np.sqrt((way * way).sum())
            at = depth[r, c] - 2 * BAND * step  # STEP is half a voxel
            while True:
                at -= step
                x = int(np.floor(eye[0] + at * way[0] + 0.5))
                y = int(np.floor(eye[1] + at * way[1] + 0.5))
                z = int(np.floor(eye[2] + at * way[2] + 0.5))
                beyond = min(x, y, z) < 0 or x >= missing.shape[0]
                if at <= 0 or beyond or y >= missing.shape[1] or z >= missing.shape[2]:
                    break
                if missing[x, y, z]:
                    votes[r, c] = 0
                    struck += 1
                    break
    return struck


@njit(**OPTIONS)
def _follow(field, bound, missing, filled, silhouette, eye, to_grid):
    """Mark pixels whose rays meet something, and the best sample of the others within the bound."""
    shape = field.shape
    height, width = silhouette.shape
    for r in range(height):
        for c in range(width):
            if not silhouette[r, c]:
                continue
            way = (c + 0.5) * to_grid[0] + (r + 0.5) * to_grid[1] + to_grid[2]
            first, last = _enter(way, eye, shape)
            best, known = -2.0, False
            i = j = k = 0
            at = first
            while at < last:
                x, y, z = _find_sample(eye, at, way)
                if bound[x, y, z] > 0:
                    known = True
                    if field[x, y, z] > best:
                        best = field[x, y, z]
                        i, j, k = x, y, z
                        if best > 0:
                            break
                at += STEP
            if best > 0:
                filled[r, c] = True
            elif known:
                missing[i, j, k] = True


@njit(**OPTIONS)
def _watch(field, seen, silhouette, eye, to_grid):
    """Mark what the rays of a silhouette's pixels come squarely on."""
    height, width = silhouette.shape
    for r in range(height):
        for c in range(width):
            if not silhouette[r, c]:
                continue
            way = (c + 0.5) * to_grid[0] + (r + 0.5) * to_grid[1] + to_grid[2]
            at, last = _enter(way, eye, field.shape)
            entered = -1.0
            i = j = k = 0
            while at < last:
                x, y, z = _find_sample(eye, at, way)
                if field[x, y, z] <= 0:
                    entered = -1.0
                elif entered < 0:
                    entered = at
                    i, j, k = x, y, z
                if field[x, y, z] > DEEP:
                    if at - entered <= SOON:
                        seen[i, j, k] = seen[x, y, z] = True
                    break
                at += STEP


@njit(**OPTIONS)
def _enter(way, eye, shape):
    """Where a ray enters and leaves the grid; its direction ``way`` gets length 1, in place."""
    way /= np.sqrt((way * way).sum())
    first, last = 0.0, np.inf
    for axis in range(3):
        if abs(way[axis]) < 1e-9:
            continue
        a = (0 - eye[axis]) / way[axis]
        b = (shape[axis] - 1.001 - eye[axis]) / way[axis]
        first, last = max(first, min(a, b)), min(last, max(a, b))
    return first, last


@njit(**OPTIONS)
def _find_sample(eye, at, way):
    """The sample that is nearest to a place of a ray within the grid."""
    return (
        int(eye[0] + at * way[0] + 0.5),
        int(eye[1] + at * way[1] + 0.5),
        int(eye[2] + at * way[2] + 0.5),
    )
