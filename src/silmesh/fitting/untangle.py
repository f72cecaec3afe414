"""Untangling: parts of a surface that are inside out are turned the right way round.

Silhouettes do not tell the two sides of a thin sheet apart, so where a wing is thinner than a pixel
its two sides may end up behind each other. There each side's normals point into the sheet: from
outside a closed surface a ray that leaves along the normal passes it an even number of times, from
such a side an odd number. Each is moved along its own normal by half of the way to the other side,
and a little more.
"""

import numpy as np
import trimesh

ROUNDS = 8  # most iterations
# A vertex is moved only if a second ray agrees, whose direction is the normal plus this share of a
# tangent.
OBLIQUE = 0.5
START = 0.05  # of the gap: height above the surface at which rays start
MOST = 4  # gaps: greatest movement of a vertex in an iteration
RINGS = 3  # rings of neighbours that move along, each by half as much as the one before


def untangle(verts: np.ndarray, faces: np.ndarray, gap: float) -> np.ndarray:
    """Move the vertices of parts that are inside out until the sides no longer cross.

    Args:
        verts: [verts, 3]
        faces: [faces, 3], closed, oriented outwards
        gap: how far the two sides of a sheet are to be apart, in the vertices' units
    Returns:
        [verts, 3]; the vertices themselves if none is inside out
    """
    for _ in range(ROUNDS):
        mesh = trimesh.Trimesh(verts, faces, process=False)
        push = _find_depth(mesh, gap)
        if not push.any():
            break
        verts = verts + _spread(push, mesh.edges_unique)[:, None] * mesh.vertex_normals
    return verts


def _find_depth(mesh: trimesh.Trimesh, gap: float) -> np.ndarray:
    """How far each vertex is to be moved along its normal, 0 where it is sound: [verts]."""
    normals = mesh.vertex_normals
    sideways = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    crossed, reach = _cast(mesh, normals, gap)
    odd = crossed & _cast(mesh, normals + OBLIQUE * sideways, gap)[0]
    return np.where(odd, np.minimum(reach / 2 + gap, MOST * gap), 0.0)


def _cast(mesh: trimesh.Trimesh, rays: np.ndarray, gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Whether a ray from each vertex passes the surface an odd number of times, and where first."""
    starts = mesh.vertices + START * gap * mesh.vertex_normals
    points, index, _ = mesh.ray.intersects_location(starts, rays, multiple_hits=True)
    reach = np.full(len(starts), np.inf)
    np.minimum.at(reach, index, np.linalg.norm(points - starts[index], axis=1))
    return np.bincount(index, minlength=len(starts)) % 2 == 1, reach


def _spread(push: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Let the neighbours move along, so that no step is left at the border."""
    for _ in range(RINGS):
        around = np.zeros_like(push)
        for here, there in (edges.T, edges.T[::-1]):
            np.maximum.at(around, here, push[there])
        push = np.maximum(push, around / 2)
    return push
