"""Bodies as 32 x 32 x 32 voxels, in the grid of the papers that measure ShapeNet by voxel IoU.

The grid is that of Kato, Ushiku and Harada (*Neural 3D Mesh Renderer*, 2018), which SoftRas took
over: a coordinate v of [-0.5, 0.5] lies at 31 v + 16 of it, and the voxel i is [i, i + 1). Full is
each voxel that the surface enters, and each from which no way leads outside through voxels' sides.
So a body is on average half a voxel thicker all round than it is, in their truth as in their
predictions.

Their files are [y, x, z] with z the other way round than in SoftRas's left-handed world: that is z
as it is in ours, its mirror image (``silmesh.cameras.turntable``).

             y
        31 +-+-+-+         voxels[iy, ix, iz], each i = floor(31 v + 16)
           +-+-+-+
         0 +-+-+-+-> x
           0     31
"""

import numpy as np
import trimesh
from scipy.ndimage import binary_fill_holes

SIDE = 32  # voxels along an axis


def voxelise(mesh: trimesh.Trimesh) -> np.ndarray:
    """Which voxels a closed mesh fills: [32, 32, 32] bool, in the order y, x, z.

    Args:
        mesh: in the normalised world; what lies outside of the grid is left out
    """
    corners = ((SIDE - 1) * np.asarray(mesh.vertices, np.float64) + SIDE / 2)[mesh.faces]
    full = np.zeros((SIDE,) * 3, bool)
    _fill(full, np.floor(corners.reshape(-1, 3)).astype(np.int64))
    for axis in range(3):
        _fill(full, _find_crossed(corners, axis))
    return binary_fill_holes(full).swapaxes(0, 1)


def voxel_iou(mesh: trimesh.Trimesh, truth: np.ndarray) -> float:
    """IoU of the voxels that a mesh fills with the true ones, [32, 32, 32] bool."""
    found = voxelise(mesh)
    return float((found & truth).sum() / max((found | truth).sum(), 1))


def mesh_voxels(full: np.ndarray) -> trimesh.Trimesh:
    """The surface of full voxels, closed, through the middles between full and empty ones.

    Args:
        full: [32, 32, 32] bool, in the order y, x, z
    """
    from skimage.measure import marching_cubes  # slow to load for those who only compare

    padded = np.pad(full.swapaxes(0, 1), 1).astype(np.float32)
    verts, faces, _, _ = marching_cubes(padded, 0.5, gradient_direction="ascent")
    centred = verts - 1 + 0.5 - SIDE / 2  # of an array's corner, whose voxel's middle is at 0.5
    return trimesh.Trimesh(centred / (SIDE - 1), faces, process=False)


def _fill(full: np.ndarray, cells: np.ndarray) -> None:
    """Set these voxels [n, 3] that lie within the grid."""
    within = ((cells >= 0) & (cells < SIDE)).all(axis=1)
    full[tuple(cells[within].T)] = True


def _find_crossed(corners: np.ndarray, axis: int) -> np.ndarray:
    """The voxels [n, 3] one of whose edges along an axis meets a triangle.

    An edge is where two grid planes cross, and belongs to the four voxels about it.

    Args:
        corners: [triangles, 3, 3] in units of the grid
    """
    a, b = (i for i in range(3) if i != axis)
    which, lines = _lines_near(corners[:, :, [a, b]])
    p, q, r = (corners[which, i] for i in range(3))
    u, v, w = q - p, r - p, lines - p[:, [a, b]]
    det = u[:, a] * v[:, b] - u[:, b] * v[:, a]
    with np.errstate(divide="ignore", invalid="ignore"):  # of triangles along the axis
        s = (w[:, 0] * v[:, b] - w[:, 1] * v[:, a]) / det
        t = (u[:, a] * w[:, 1] - u[:, b] * w[:, 0]) / det
        met = (s >= 0) & (t >= 0) & (s + t <= 1)
    height = p[met, axis] + s[met] * u[met, axis] + t[met] * v[met, axis]
    cells = np.empty((4, met.sum(), 3), np.int64)
    cells[..., axis] = np.floor(height)
    for i, (back_a, back_b) in enumerate([(0, 0), (1, 0), (0, 1), (1, 1)]):
        cells[i, :, a], cells[i, :, b] = (lines[met] - (back_a, back_b)).T
    return cells.reshape(-1, 3)


def _lines_near(flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lines through integer points that may meet triangles seen along an axis.

    Args:
        flat: [triangles, 3, 2] their corners
    Returns:
        the triangle [pairs] and the line [pairs, 2] of each pair
    """
    low = np.clip(np.ceil(flat.min(axis=1)), 0, SIDE).astype(np.int64)
    high = np.clip(np.floor(flat.max(axis=1)), -1, SIDE).astype(np.int64)
    counts = np.maximum(high - low + 1, 0)
    each = counts.prod(axis=1)
    which = np.repeat(np.arange(len(flat)), each)
    place = np.arange(each.sum()) - np.repeat(np.cumsum(each) - each, each)
    columns = counts[which, 1]
    return which, low[which] + np.stack([place // columns, place % columns], axis=1)
