"""Parts of a surface that no view sees, spanned like a drum by the edge of what views see.

Outlines bound an object from outside only. Beneath it, where no camera looks, the visual hull runs
out into a cone, although each surface within that cone has the same outlines. Objects mostly stand
on something flat, so an end that all cameras look past is spanned by a membrane, if its edge is
flat and the outlines stay as they are. Those of what is round there would not: they pass through
what is hardly seen.

Vertices move along the end's axis alone, until each one's height is the mean of its neighbours'.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.sparse import csr_array, diags_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from silmesh.geometry.camera import Cameras

GRAZING = 0.1  # cosine between normal and ray below which a view does not see a place
LIFT = 1e-4  # of the mesh's size: rays start so far above the surface
LEAST = 0.003  # of the surface's area: a smaller part is left as it is
FLAT = 0.06  # of an edge's length: its height along the axis, at most (standard deviations)
GAP = 120.0  # degrees about the axis in which no camera stands, at most
FOLDED = 0.01  # of a membrane's area that faces inwards, at most
LOST = 0.0002  # of the mean IoU with the silhouettes that all membranes together may take


@dataclass(frozen=True)
class _End:
    """A part that no view sees.

    Attributes:
        verts: positions of its vertices that are free to move
        faces: [mesh faces] bool, those that have one of these
        axis: [3], its mean normal
    """

    verts: np.ndarray
    faces: np.ndarray
    axis: np.ndarray


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
    neighbours, before = csr_array(mesh.edges_sparse, dtype=float), None  # 1 where an edge is
    shares = mesh.faces_sparse @ mesh.area_faces / (3 * mesh.area)  # of the area, each vertex'
    free = ~find_seen(mesh, cameras, frames)
    for part in _find_parts(neighbours, ~free):
        if shares[part].sum() < LEAST:  # as the tip of a cone, which a camera just sees
            free[part] = True
    free &= neighbours @ ~free == 0  # through the triangles beside what is seen outlines pass
    for part in _find_parts(neighbours, free):
        end = _take_end(mesh, part, cameras) if shares[part].sum() >= LEAST else None
        spanned = None if end is None else _span(mesh, neighbours, end)
        if spanned is not None:
            before = overlap(mesh) if before is None else before
            mesh = spanned if overlap(spanned) >= before - LOST else mesh
    return mesh


def find_seen(
    mesh: trimesh.Trimesh, cameras: Cameras, frames: Sequence[Sequence[int]] | None = None
) -> np.ndarray:
    """Which vertices of a mesh some camera sees, within its frame: [verts] bool."""
    verts, normals = np.asarray(mesh.vertices), np.asarray(mesh.vertex_normals)
    frames = [(0, 0, *size) for size in cameras.sizes.tolist()] if frames is None else frames
    left = np.arange(len(verts))  # seen by none so far
    every = zip(cameras.projections.numpy(), cameras.centres.numpy(), frames, strict=True)
    for P, eye, (first, top, last, bottom) in every:
        points, normal = verts[left], normals[left]
        towards = eye - points
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        x, y, z = P[:, :3] @ points.T + P[:, 3:]
        within = (z > 0) & (x > first * z) & (x < last * z) & (y > top * z) & (y < bottom * z)
        asked = np.flatnonzero(within & ((towards * normal).sum(axis=1) > GRAZING))
        starts = points[asked] + LIFT * mesh.scale * normal[asked]
        hidden = mesh.ray.intersects_any(starts, towards[asked])
        left = np.delete(left, asked[~hidden])
    seen = np.ones(len(verts), bool)
    seen[left] = False
    return seen


def _find_parts(neighbours: csr_array, of: np.ndarray) -> list[np.ndarray]:
    """The vertices of each connected part of those that ``of`` [verts] bool says."""
    index = np.flatnonzero(of)
    _, label = connected_components(neighbours[index][:, index], directed=False)
    return np.split(index[np.argsort(label, kind="stable")], np.cumsum(np.bincount(label))[:-1])


def _take_end(mesh: trimesh.Trimesh, part: np.ndarray, cameras: Cameras) -> _End | None:
    """A part as an end if it is a disc with a flat edge, and cameras stand all around it."""
    inner = np.zeros(len(mesh.vertices), bool)
    inner[part] = True
    own = inner[mesh.faces].any(axis=1)
    whole = trimesh.Trimesh(mesh.vertices, mesh.faces[own], process=False)
    border = mesh.vertices[np.setdiff1d(whole.faces, part)]
    axis = mesh.area_faces[own] @ mesh.face_normals[own]
    size = np.linalg.norm(axis)
    if whole.euler_number != 1 or not len(border) or not size > 0:
        return None
    axis, off = axis / size, border - border.mean(axis=0)
    flat = np.linalg.norm(off @ axis) < FLAT * np.linalg.norm(off, ord=2)
    around = _find_gap(cameras.centres.numpy() - border.mean(axis=0), axis) < GAP
    return _End(part, own, axis) if flat and around else None


def _find_gap(directions: np.ndarray, axis: np.ndarray) -> float:
    """The widest angle about an axis, in degrees, in which none of the directions lies."""
    across = np.linalg.svd(axis[None])[2][1:]  # two directions at right angles to it
    turns = np.sort(np.arctan2(*(directions @ across.T).T))
    return float(np.degrees(np.diff(turns, append=turns[0] + 2 * np.pi).max()))


def _span(mesh: trimesh.Trimesh, neighbours: csr_array, end: _End) -> trimesh.Trimesh | None:
    """A mesh with an end spanned; None if the membrane would be folded."""
    rows, height = neighbours[end.verts], mesh.vertices @ end.axis
    inner = diags_array(rows.sum(axis=1)) - rows[:, end.verts]
    outside = height.copy()
    outside[end.verts] = 0
    moved = splu(inner.tocsc()).solve(rows @ outside) - height[end.verts]
    verts = np.array(mesh.vertices)
    verts[end.verts] += moved[:, None] * end.axis
    spanned = trimesh.Trimesh(verts, mesh.faces, process=False)
    area = spanned.area_faces[end.faces]
    folded = area[spanned.face_normals[end.faces] @ end.axis <= 0].sum()
    return spanned if folded <= FOLDED * area.sum() else None
