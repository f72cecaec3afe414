"""What depths say of the space before and about them, on a grid, with the mesh as the outer bound.

The mesh is as coarse as its triangles, so the surface may lie before it by as much as depths may
(``silmesh.relief.depths.MARGIN``). If it could only lie behind it, noise would wear it down.

Every depth that counts says that the ray before it is free, and where the surface lies: along the
normal of its plane a voxel has the signed distance s, positive inside. What views see is averaged,
cut off at +-1 for the distance BAND (Curless and Levoy 1996); what lies further behind a depth
it says nothing of. Where few speak, the mesh does. The field u then minimises

    sum over voxels of w (u - s)^2 + SMOOTH sum over neighbours of (v - v')^2,  v = u - KEPT b

with b the mesh's own distance. Smoothness of u alone would round the edges of thin wings; of u - b
it would keep each crease between the mesh's triangles.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
import trimesh
from numba import njit
from scipy.ndimage import binary_dilation, label
from scipy.spatial import cKDTree

from silmesh.relief.depths import MARGIN, Depths
from silmesh.relief.ncc import OPTIONS
from silmesh.relief.sights import Sights

BAND = 3.0  # voxels
SAMPLES = 6  # of the mesh on the face of a voxel
SQUARELY = 0.3  # cosine between normal and ray below which a plane's distance is not believed more
ENOUGH = 3.0  # weight of views from which the mesh says nothing any more
MESH = 1.0  # weight of the mesh where no view speaks
HELD = 1.0  # weight of the views that end at a place, below which a depth counts no more
SURER = 2.0  # weight of the views that end at a place over that of those that see through it
SMOOTH = 2.0
KEPT = 0.5  # of how the mesh bends
ROUNDS = 40


@dataclass(frozen=True)
class Grid:
    """Cubes over a box.

    Attributes:
        origin: [3], the world point of the first sample
        spacing: between samples
        shape: samples along x, y and z
    """

    origin: np.ndarray
    spacing: float
    shape: tuple[int, int, int]

    @staticmethod
    def over(mesh: trimesh.Trimesh, resolution: int) -> "Grid":
        """About a mesh, whose longest side has so many samples."""
        spacing = float(mesh.extents.max()) / resolution
        margin = int(BAND) + 2
        shape = tuple(int(n) for n in np.ceil(mesh.extents / spacing).astype(int) + 2 * margin)
        return Grid(mesh.bounds[0] - margin * spacing, spacing, shape)

    def points(self, index: np.ndarray) -> np.ndarray:
        """World points of samples [n, 3]."""
        return self.origin + index * self.spacing

    def place(
        self, K: np.ndarray, R: np.ndarray, centre: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Where a camera stands among the samples, and what takes pixels to a depth of 1 there.

        Args:
            K, R, centre: [3, 3], [3, 3] and [3], of the camera
        Returns:
            [3]; [3, 3], by which (column, row, 1) is multiplied from the left
        """
        return (centre - self.origin) / self.spacing, np.linalg.inv(K).T @ R / self.spacing


def measure(mesh: trimesh.Trimesh, grid: Grid) -> np.ndarray:
    """Signed distance to a closed mesh over BAND voxels, cut off at +-1: [grid] float32.

    It is that to the nearest of many samples of the surface, along their normals where they are
    close; away from the surface a piece of space has the sign of its border.
    """
    samples, normals = _sample(mesh, grid)
    near = np.zeros(grid.shape, bool)
    near[tuple(np.rint((samples - grid.origin) / grid.spacing).astype(int).T)] = True
    near = binary_dilation(near, iterations=int(BAND))
    points = grid.points(np.argwhere(near))
    distance, nearest = cKDTree(samples).query(points, workers=torch.get_num_threads())
    along = ((points - samples[nearest]) * normals[nearest]).sum(axis=1)
    signed = np.where(distance < grid.spacing, along, np.copysign(distance, along))
    field = np.zeros(grid.shape, np.float32)
    field[near] = (-signed / (BAND * grid.spacing)).clip(-1, 1)
    parts, number = label(~near)
    counts = [
        np.bincount(parts[binary_dilation(side) & ~near], minlength=number + 1)
        for side in (near & (field > 0), near & (field < 0))
    ]
    inner = counts[0] > counts[1]
    field[~near] = np.where(inner[parts[~near]], 1, -1)
    return field


def _sample(mesh: trimesh.Trimesh, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Points all over a surface, several to a voxel, and its smooth normals there."""
    count = int(SAMPLES * mesh.area / grid.spacing**2)
    points, faces = trimesh.sample.sample_surface(mesh, count, seed=0)
    weights = trimesh.triangles.points_to_barycentric(mesh.triangles[faces], points)
    normals = (mesh.vertex_normals[mesh.faces[faces]] * weights[..., None]).sum(axis=1)
    return points, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def fuse(
    sights: Sights, found: Depths, votes: np.ndarray, bound: np.ndarray, grid: Grid
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weigh what all views say of each voxel within the bound.

    Returns:
        [grid] float32 each: weight, mean signed distance in BANDs, and the weight of those whose
        depth lies within the BAND
    """
    weight, mean, close = (np.zeros(grid.shape, np.float32) for _ in range(3))
    P = sights.K @ np.concatenate([sights.R, sights.t[..., None]], axis=2)
    back = np.linalg.inv(sights.K)

    def fill(x: int) -> None:
        part = bound[x], weight[x], mean[x], close[x]
        origin = grid.origin + np.array([x * grid.spacing, 0, 0])
        planes = found.depth, found.normals, found.score, votes
        _fuse(*part, origin, grid.spacing, P, back, sights.R, *planes)

    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        list(pool.map(fill, range(grid.shape[0])))
    return weight, mean, close


@njit(**OPTIONS)
def _fuse(bound, weight, mean, close, origin, spacing, P, back, R, depth, normals, score, votes):
    """Fill one slab of constant x, [y, z]."""
    views, height, width = depth.shape
    band = BAND * spacing
    furthest = band / SQUARELY  # behind a depth along the axis, where it says something at most
    total, sums, at = np.zeros(bound.shape), np.zeros(bound.shape), np.zeros(bound.shape)
    for v in range(views):  # outside, since a view's planes fit the cache
        for j in range(bound.shape[0]):
            y = origin[1] + j * spacing
            px, py, pz = P[v, :, 0] * origin[0] + P[v, :, 1] * y + P[v, :, 3]
            for k in range(bound.shape[1]):
                z = origin[2] + k * spacing
                p2 = pz + P[v, 2, 2] * z
                if bound[j, k] <= -0.99 or p2 <= 0:
                    continue
                u, w = (px + P[v, 0, 2] * z) / p2, (py + P[v, 1, 2] * z) / p2
                if not (0 <= u < width and 0 <= w < height):
                    continue
                r, c = int(w), int(u)
                if not votes[v, r, c] or p2 - depth[v, r, c] > furthest:
                    continue
                n = normals[v, r, c]
                a = back[v, 0, 0] * u + back[v, 0, 1] * w + back[v, 0, 2]
                b = back[v, 1, 1] * w + back[v, 1, 2]
                ray = np.sqrt(a * a + b * b + 1)
                cosine = -(n[0] * a + n[1] * b + n[2]) / ray
                signed = (p2 - depth[v, r, c]) * ray * max(cosine, SQUARELY) / band
                if signed > 1:
                    continue
                trust = score[v, r, c]
                if signed > -1:
                    trust *= 0.2 + max(cosine, 0.0)
                    at[j, k] += trust
                total[j, k] += trust
                sums[j, k] += trust * max(signed, -1.0)
    for j in range(bound.shape[0]):
        for k in range(bound.shape[1]):
            weight[j, k], close[j, k] = total[j, k], at[j, k]
            mean[j, k] = sums[j, k] / total[j, k] if total[j, k] > 0 else 0.0


def doubt(
    votes: np.ndarray,
    found: Depths,
    sights: Sights,
    weight: np.ndarray,
    close: np.ndarray,
    grid: Grid,
) -> int:
    """Take the votes of depths at places that other views see through, in place.

    Returns:
        how many lost theirs
    """

    def look_up(i: int) -> int:
        placed = grid.place(sights.K[i], sights.R[i], sights.centres[i])
        return _doubt(votes[i], found.depth[i], weight, close, *placed)

    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        return sum(pool.map(look_up, range(len(votes))))


@njit(**OPTIONS)
def _doubt(votes, depth, weight, close, eye, to_grid):
    """The same for one view; ``eye`` and ``to_grid`` are as ``Grid.place`` gives them."""
    height, width = depth.shape
    gone = 0
    for r in range(height):
        for c in range(width):
            if not votes[r, c]:
                continue
            z = depth[r, c]
            way = (c + 0.5) * to_grid[0] + (r + 0.5) * to_grid[1] + to_grid[2]
            i, j, k = (
                int(eye[0] + z * way[0] + 0.5),
                int(eye[1] + z * way[1] + 0.5),
                int(eye[2] + z * way[2] + 0.5),
            )
            if close[i, j, k] < SURER * (weight[i, j, k] - close[i, j, k]) or close[i, j, k] < HELD:
                votes[r, c] = 0
                gone += 1
    return gone


def settle(bound: np.ndarray, weight: np.ndarray, mean: np.ndarray, spacing: float) -> np.ndarray:
    """The field that minimises the sum above, nowhere MARGIN outside the bound: [grid] float32.

    Args:
        bound: signed distance to the mesh, in BANDs
        weight, mean: from ``fuse``
        spacing: of the grid
    """
    kept = np.float32(KEPT) * bound
    limit = bound - kept + np.float32(MARGIN / (BAND * spacing))
    own = MESH * np.maximum(0, 1 - weight / ENOUGH)
    total = weight + own
    wanted = (weight * (mean - kept) + own * (bound - kept)).astype(np.float32)
    field = np.minimum(wanted / np.maximum(total, 1e-6), limit)
    new = np.empty_like(field)
    threads = torch.get_num_threads()
    slabs = np.linspace(0, len(field), threads + 1).astype(int)
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(ROUNDS):
            given = field, wanted, total, limit, new
            list(pool.map(partial(_settle, *given), slabs[:-1], slabs[1:]))
            field, new = new, field
    return field + kept


@njit(**OPTIONS)
def _settle(field, wanted, total, limit, new, first, last):
    """One Jacobi step of the slabs of x from the first to before the last."""
    width, height, depth = field.shape
    for i in range(first, last):
        for j in range(height):
            for k in range(depth):
                around = count = np.float32(0)
                for x in (i - 1, i + 1):
                    if 0 <= x < width:
                        around += field[x, j, k]
                        count += 1
                for y in (j - 1, j + 1):
                    if 0 <= y < height:
                        around += field[i, y, k]
                        count += 1
                for z in (k - 1, k + 1):
                    if 0 <= z < depth:
                        around += field[i, j, z]
                        count += 1
                smooth = np.float32(SMOOTH)
                settled = (wanted[i, j, k] + smooth * around) / (total[i, j, k] + smooth * count)
                new[i, j, k] = min(settled, limit[i, j, k])
