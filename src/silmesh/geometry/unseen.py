"""Parts of a surface that no view sees, spanned like a soap film by the edge of what views see.

Outlines bound an object from outside only. Beneath it, where no camera looks, the visual hull runs
out into a cone, although each surface within that cone has the same outlines. Objects mostly stand
on something flat, so an end that all cameras look past is spanned by the smallest surface, if its
edge is level and the outlines stay as they are. Those of what is round there would not: they pass
through what is hardly seen.

The film's vertices are the means of their neighbours, and those at its edge stay where they are
(Tutte 1963: over a convex edge no two of its triangles overlap).
"""

from collections.abc import Callable, Sequence

import numpy as np
import trimesh
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from silmesh.geometry.camera import Cameras

GRAZING = 0.1  # cosine between normal and ray below which a view does not see a place
LIFT = 1e-4  # of the mesh's size: rays start so far above the surface
LEAST = 0.003  # of the surface's area: a smaller part is left as it is
LEVEL = 0.06  # of an edge's length: its height where it is level, at most (standard deviations)
GAP = 120.0  # degrees about a part's axis in which no camera stands, at most
LOST = 0.0002  # of the mean IoU with the silhouettes that a film may take


def span_unseen(
    mesh: trimesh.Trimesh,
    cameras: Cameras,
    overlap: Callable[[trimesh.Trimesh], float],
    frames: Sequence[Sequence[int]] | None = None,
) -> trimesh.Trimesh:
    """Span the ends of a mesh that no camera sees.

    Args:
        mesh: closed, in the cameras' world
        cameras: that look at it
        overlap: measures the mean IoU of a mesh with the silhouettes
        frames: [views, 4] left, top, right and bottom of the photographs within the images; the
            whole images if not given
    Returns:
        the same vertices and faces, in the same order, elsewhere; the mesh itself if it has no such
        end
    """
    neighbours, before = _link(mesh), None
    shares = mesh.faces_sparse @ mesh.area_faces / (3 * mesh.area)  # of the area, each vertex'
    free = ~find_seen(mesh, cameras, frames)
    for part in _find_parts(neighbours, ~free):
        if shares[part].sum() < LEAST:  # as the tip of a cone, which a camera just sees
            free[part] = True
    free &= neighbours @ ~free == 0  # through the triangles beside what is seen outlines pass
    for part in _find_parts(neighbours, free):
        if shares[part].sum() < LEAST or not _is_end(mesh, part, cameras):
            continue
        before = overlap(mesh) if before is None else before
        spanned = trimesh.Trimesh(_span(mesh.vertices, neighbours, part), mesh.faces, process=False)
        if (after := overlap(spanned)) >= before - LOST:
            mesh, before = spanned, after
    return mesh


def _span(verts: np.ndarray, neighbours: csr_array, part: np.ndarray) -> np.ndarray:
    """Vertices of which those of a part are the means of their neighbours."""
    verts, rows = np.array(verts), neighbours[part]
    inner = diags_array(rows.sum(axis=1)) - rows[:, part]
    verts[part] = 0
    verts[part] = splu(inner.tocsc()).solve(rows @ verts)
    return verts


def find_seen(
    mesh: trimesh.Trimesh, cameras: Cameras, frames: Sequence[Sequence[int]] | None = None
) -> np.ndarray:
    """Which vertices of a mesh some camera sees, within its frame: [verts] bool."""
    points, normals = np.asarray(mesh.vertices), np.asarray(mesh.vertex_normals)
    starts = points + LIFT * mesh.scale * normals
    frames = [(0, 0, *size) for size in cameras.sizes.tolist()] if frames is None else frames
    seen = np.zeros(len(points), bool)
    every = zip(cameras.projections.numpy(), cameras.centres.numpy(), frames, strict=True)
    for P, eye, (left, top, right, bottom) in every:
        towards = eye - points
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        x, y, z = P[:, :3] @ points.T + P[:, 3:]
        within = (z > 0) & (x > left * z) & (x < right * z) & (y > top * z) & (y < bottom * z)
        facing = (towards * normals).sum(axis=1) > GRAZING
        asked = np.flatnonzero(within & facing & ~seen)
        seen[asked] = ~mesh.ray.intersects_any(starts[asked], towards[asked])
    return seen


def _link(mesh: trimesh.Trimesh) -> csr_array:
    """Which vertices share an edge: [verts, verts], 1 or 0."""
    ends = mesh.edges_unique.T
    ends = np.concatenate([ends, ends[::-1]], axis=1)
    shape = len(mesh.vertices), len(mesh.vertices)
    return coo_array((np.ones(ends.shape[1]), tuple(ends)), shape=shape).tocsr()


def _find_parts(neighbours: csr_array, of: np.ndarray) -> list[np.ndarray]:
    """The vertices of each connected part of those that ``of`` [verts] bool says."""
    index = np.flatnonzero(of)
    _, label = connected_components(neighbours[index][:, index], directed=False)
    return np.split(index[np.argsort(label, kind="stable")], np.cumsum(np.bincount(label))[:-1])


def _is_end(mesh: trimesh.Trimesh, part: np.ndarray, cameras: Cameras) -> bool:
    """Whether a part is a disc with a level edge, and cameras stand all around it."""
    inner = np.zeros(len(mesh.vertices), bool)
    inner[part] = True
    own = inner[mesh.faces].any(axis=1)
    faces = mesh.faces[own]
    if not _is_disc(faces):
        return False
    border = mesh.vertices[np.setdiff1d(faces, part)]
    _, (length, _, height), _ = np.linalg.svd(border - border.mean(axis=0), full_matrices=False)
    normal = mesh.area_faces[own] @ mesh.face_normals[own]
    gap = _find_gap(cameras.centres.numpy() - border.mean(axis=0), normal)
    return height < LEVEL * length and gap < GAP


def _is_disc(faces: np.ndarray) -> bool:
    """Whether triangles in one piece have one edge and no handle: Euler's characteristic is 1."""
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    return len(np.unique(faces)) - len(edges) + len(faces) == 1


def _find_gap(directions: np.ndarray, axis: np.ndarray) -> float:
    """The widest angle about an axis, in degrees, in which none of the directions lies."""
    across = np.linalg.svd(axis[None])[2][1:]  # two directions at right angles to it
    turns = np.sort(np.arctan2(*(directions @ across.T).T))
    return float(np.degrees(np.diff(turns, append=turns[0] + 2 * np.pi).max()))
