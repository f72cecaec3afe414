"""Mesh quality: whether a mesh is closed, manifold, free of self-intersections, and even."""

import numpy as np
import trimesh
from numba import njit
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from silmesh.geometry.edges import number_edges


def measure_quality(mesh: trimesh.Trimesh) -> dict[str, bool | int | float | None]:
    """Measure a mesh of which each triangle's corners are vertices shared with its neighbours.

    Returns:
        ``watertight``: every edge has two faces, which pass it in opposite directions;
        ``manifold``: no edge has more than two faces, and those about any vertex form one fan;
        ``components``: pieces that share no vertex; ``genus``: handles of a watertight and manifold
        mesh, of all pieces together, from Euler's V - E + F = 2 components - 2 genus, else None;
        ``self_intersections``: pairs of triangles that cut through each other (see
        ``count_intersections``); ``edge_length_spread``: standard deviation of the edges' lengths
        over their mean; ``smallest_angle``: of any triangle, in degrees; ``small_angle``: of each
        triangle the smallest, of these the first percentile
    """
    verts, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    edges, of_face = number_edges(faces)
    uses = np.bincount(of_face.ravel())
    used = np.unique(faces)
    components = _count_groups(np.searchsorted(used, edges), len(used))
    watertight = bool(mesh.is_watertight and mesh.is_winding_consistent)
    manifold = bool((uses <= 2).all()) and _count_fans(faces) == len(used)
    euler = len(used) - len(edges) + len(faces)
    lengths = np.linalg.norm(verts[edges[:, 0]] - verts[edges[:, 1]], axis=1)
    angles = _smallest_angles(verts[faces])
    return {
        "watertight": watertight,
        "manifold": manifold,
        "components": components,
        "genus": (2 * components - euler) // 2 if watertight and manifold else None,
        "self_intersections": count_intersections(verts, faces),
        "edge_length_spread": float(lengths.std() / max(lengths.mean(), 1e-300)),
        "smallest_angle": float(angles.min()),
        "small_angle": float(np.percentile(angles, 1)),
    }


def _sides(faces: np.ndarray) -> np.ndarray:
    """The three sides of each face in turn: [3 faces, 2] vertices, side k from corner k."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)


def _count_groups(pairs: np.ndarray, count: int) -> int:
    """How many groups so many things form when these pairs [n, 2] are joined."""
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
    return int(connected_components(graph, directed=False)[0])


def _count_fans(faces: np.ndarray) -> int:
    """How many fans of faces there are about all vertices.

    Corner k of face f is 3 f + k. Where two faces share a side, their corners at each of its ends
    belong to one fan.
    """
    sides = _sides(faces)
    starts = np.arange(len(sides))
    ends = 3 * (starts // 3) + (starts + 1) % 3
    flipped = sides[:, 0] > sides[:, 1]
    corners = np.stack([np.where(flipped, ends, starts), np.where(flipped, starts, ends)], axis=1)
    order = np.lexsort(np.sort(sides, axis=1).T)
    ordered = np.sort(sides, axis=1)[order]
    same = (ordered[1:] == ordered[:-1]).all(axis=1)
    here, there = corners[order[:-1][same]], corners[order[1:][same]]
    return _count_groups(np.stack([here.ravel(), there.ravel()], axis=1), len(sides))


def _smallest_angles(triangles: np.ndarray) -> np.ndarray:
    """The smallest angle of each of [faces, 3, 3] in degrees; 0 without area: [faces]."""
    sides = np.roll(triangles, -1, axis=1) - triangles
    back = -np.roll(sides, 1, axis=1)
    across = np.linalg.norm(np.cross(sides, back), axis=2)
    return np.degrees(np.arctan2(across, (sides * back).sum(axis=2)).min(axis=1))


def count_intersections(verts: np.ndarray, faces: np.ndarray) -> int:
    """Count the pairs of triangles that cut through each other.

    Two triangles do if a side of one passes through the inside of the other. A mere touch is no
    cut, nor are two that lie in one plane. Of two that share a vertex the sides opposite to it are
    tried; two that share a side can only lie in one plane.

    Args:
        verts: [verts, 3]
        faces: [faces, 3]
    """
    triangles = np.ascontiguousarray(verts[faces], float)
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    axis = int(np.ptp(verts, axis=0).argmax()) if len(verts) else 0
    order = np.argsort(low[:, axis], kind="stable")
    sweep = low[order], high[order], triangles[order], np.ascontiguousarray(faces[order])
    return int(_sweep(*sweep, axis))


@njit(cache=True, error_model="numpy")
def _sweep(low, high, triangles, faces, axis):
    """Go along an axis and try each pair whose boxes overlap."""
    count = 0
    for i in range(len(faces)):
        for j in range(i + 1, len(faces)):
            if low[j, axis] > high[i, axis]:
                break
            apart = False
            for k in range(3):
                apart |= low[j, k] > high[i, k] or low[i, k] > high[j, k]
            if not apart and _cut(triangles[i], triangles[j], faces[i], faces[j]):
                count += 1
    return count


@njit(cache=True, error_model="numpy")
def _cut(one, other, verts, others):
    shared, mine, its = 0, -1, -1
    for k in range(3):
        for m in range(3):
            if verts[k] == others[m]:
                shared, mine, its = shared + 1, k, m
    if shared > 1:
        return False
    if shared == 1:
        return _pierces(one[(mine + 1) % 3], one[(mine + 2) % 3], other) or _pierces(
            other[(its + 1) % 3], other[(its + 2) % 3], one
        )
    for k in range(3):
        if _pierces(one[k], one[(k + 1) % 3], other) or _pierces(other[k], other[(k + 1) % 3], one):
            return True
    return False


@njit(cache=True, error_model="numpy")
def _pierces(p, q, triangle):
    """Whether the segment from p to q passes through the inside of a triangle."""
    a, b, c = triangle[0], triangle[1], triangle[2]
    if _volume(p, a, b, c) * _volume(q, a, b, c) >= 0:
        return False
    u, v, w = _volume(p, q, a, b), _volume(p, q, b, c), _volume(p, q, c, a)
    return (u > 0 and v > 0 and w > 0) or (u < 0 and v < 0 and w < 0)


@njit(cache=True, error_model="numpy")
def _volume(a, b, c, d):
    """Six times the signed volume of a tetrahedron."""
    x0, y0, z0 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    x1, y1, z1 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    x2, y2, z2 = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    return x0 * (y1 * z2 - z1 * y2) - y0 * (x1 * z2 - z1 * x2) + z0 * (x1 * y2 - y1 * x2)
