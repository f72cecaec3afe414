"""What of a mesh one photograph shows, and how well.

The mesh is drawn into a map of at most ``LONGEST`` pixels, by whose depths it hides itself. A
photograph is trusted less the nearer a pixel is to an outline, of the silhouette or of a part of
the mesh that stands before another: there the mesh is a little astray, and what is behind shows.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.ndimage import distance_transform_edt

from silmesh.texture.raster import draw

LONGEST = 640  # pixels of a map's longer side
JUMP = 0.03  # of the mesh's size: a step of the depth that is an outline
SLACK = 0.004  # of the mesh's size: how far behind the map's depth a point still counts as seen


@dataclass(frozen=True)
class Sight:
    """What one camera sees of a mesh, in a map that is ``scale`` times its photograph.

    Attributes:
        P: [3, 4] projection to pixels of the photograph
        scale: pixels of the map a pixel of the photograph
        depth: [height, width] float32, infinite beside the mesh
        margin: [height, width] float32, distance to the nearest outline in pixels of the map
        slack: how far behind the depth a point may lie
    """

    P: np.ndarray
    scale: float
    depth: np.ndarray
    margin: np.ndarray
    slack: float


def look(
    verts: np.ndarray,
    faces: np.ndarray,
    P: np.ndarray,
    size: tuple[int, int],
    silhouette: np.ndarray,
) -> Sight:
    """See a mesh as one camera does.

    Args:
        verts: [verts, 3]
        P: [3, 4], normalised so that the third row gives depths
        size: width and height of the photograph
        silhouette: [height, width] bool, as ``shrink`` gives it, which is the map's size
    """
    small, scale = silhouette.shape[::-1], silhouette.shape[1] / size[0]
    seen = verts @ P[:, :3].T + P[:, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        points = seen[:, :2] / seen[:, 2:] * scale
    depth = draw(points, seen[:, 2], faces, small)[1]
    extent = float(np.ptp(verts, axis=0).max())
    inside = silhouette & ~_find_jumps(depth, JUMP * extent)
    padded = np.pad(inside, 1, mode="edge")  # the photograph's frame is no outline
    margin = distance_transform_edt(padded)[1:-1, 1:-1] - 0.5
    return Sight(P, scale, depth, margin.astype(np.float32), SLACK * extent)


def shrink(silhouette: np.ndarray) -> np.ndarray:
    """A silhouette no larger than a map, by the nearest pixels: [height, width] bool."""
    scale = min(1.0, LONGEST / max(silhouette.shape))
    height, width = (max(1, round(n * scale)) for n in silhouette.shape)
    rows = ((np.arange(height) + 0.5) * silhouette.shape[0] / height).astype(int)
    columns = ((np.arange(width) + 0.5) * silhouette.shape[1] / width).astype(int)
    return silhouette[rows[:, None], columns]


def _find_jumps(depth: np.ndarray, step: float) -> np.ndarray:
    """Pixels beside which the depth changes by more than a step: [height, width] bool."""
    found = np.zeros(depth.shape, bool)
    with np.errstate(invalid="ignore"):
        down = np.abs(depth[1:] - depth[:-1]) > step
        across = np.abs(depth[:, 1:] - depth[:, :-1]) > step
    found[1:] |= down
    found[:-1] |= down
    found[:, 1:] |= across
    found[:, :-1] |= across
    return found


def measure(
    sight: Sight, eye: np.ndarray, points: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How a view sees points of the surface.

    Args:
        eye: [3] where the camera stands
        points, normals: [n, 3]
    Returns:
        pixels of the photograph [n, 2]; the cosine between normal and ray, 0 for what is not seen
        [n]; the distance to an outline in pixels of the photograph, 0 likewise [n]
    """
    seen = points @ sight.P[:, :3].T + sight.P[:, 3]
    towards = eye - points
    cosine = (normals * towards).sum(axis=1) / np.linalg.norm(towards, axis=1)
    pixels = np.full((len(points), 2), -1.0)
    margin = np.zeros(len(points))
    _measure(sight.depth, sight.margin, sight.scale, sight.slack, seen, cosine, pixels, margin)
    return pixels, np.where(margin > 0, cosine, 0), margin / sight.scale


@njit(nogil=True, cache=True, error_model="numpy")
def _measure(depth, margin, scale, slack, seen, cosine, pixels, out):
    height, width = depth.shape
    for i in range(len(seen)):
        z = seen[i, 2]
        if cosine[i] <= 0 or z <= 0:
            continue
        x, y = seen[i, 0] / z, seen[i, 1] / z
        pixels[i] = x, y
        column, row = int(np.floor(x * scale)), int(np.floor(y * scale))
        if 0 <= row < height and 0 <= column < width and z <= depth[row, column] + slack:
            out[i] = max(0.0, margin[row, column])
