"""Unit spheres with a given number of vertices.

642    an icosphere, 1,280 faces: the report's "600 polygons"
1,922  a UV sphere of 32 segments and 16 rings, its poles on the axis y, with every face split in
       four, 3,840 faces: the report's "1,900 polygons"
other  the convex hull of a relaxed Fibonacci sphere, 2 n - 4 even faces: with 1,352 vertices and
       2,700 faces the report's "1,300 polygons"
"""

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from silmesh.errors import InputError

FEWEST = 12  # least number of vertices of a sphere
RELAXATIONS = 2  # they cut the sphere's Laplacian loss to a third; more hardly change a fit


def unit_sphere(vertices: int) -> trimesh.Trimesh:
    """A closed sphere of radius 1 about the origin, oriented outwards, with so many vertices.

    Raises:
        InputError: fewer than 12 vertices
    """
    if vertices < FEWEST:
        raise InputError(f"a sphere of {vertices} vertices: should have at least {FEWEST}")
    if vertices == 642:
        return trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    if vertices == 1922:
        return _split_uv_sphere(segments=32, rings=16)
    return _even_sphere(vertices)


def _even_sphere(vertices: int) -> trimesh.Trimesh:
    """The hull of a Fibonacci sphere that was relaxed, so that its triangles are even.

    The points lie on a spiral about z that turns by the golden angle and keeps equal areas. Its
    poles, where the triangles stay least even, are so kept from the ends of an upright object.
    """
    i = np.arange(vertices) + 0.5
    z = 1 - 2 * i / vertices
    turn = np.pi * (3 - np.sqrt(5)) * i
    around = np.sqrt(1 - z * z)
    points = np.stack([around * np.cos(turn), around * np.sin(turn), z], axis=1)
    for _ in range(RELAXATIONS):
        points = _relax(points)
    return _outwards(trimesh.Trimesh(points, ConvexHull(points).simplices, process=False))


def _relax(points: np.ndarray) -> np.ndarray:
    """Move every point of a sphere to the centroid of its triangles, and back onto the sphere."""
    faces = ConvexHull(points).simplices
    a, b, c = points[faces.T]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1, keepdims=True)
    total = np.zeros_like(points)  # of area times centroid; the norm undoes the common factors
    for corner in faces.T:
        np.add.at(total, corner, area * (a + b + c))
    return total / np.linalg.norm(total, axis=1, keepdims=True)


def _split_uv_sphere(segments: int, rings: int) -> trimesh.Trimesh:
    """A sphere of meridians and parallels, each triangle split at its edges' midpoints."""
    polar = np.pi * np.arange(1, rings) / rings
    around = 2 * np.pi * np.arange(segments) / segments
    parallels = np.stack(
        [
            np.outer(np.sin(polar), np.sin(around)),
            np.repeat(np.cos(polar)[:, None], segments, axis=1),
            np.outer(np.sin(polar), np.cos(around)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    points = np.concatenate([parallels, [[0, 1, 0], [0, -1, 0]]])
    coarse = _outwards(trimesh.Trimesh(points, _grid_faces(segments, rings), process=False))
    split = coarse.subdivide()
    round_verts = split.vertices / np.linalg.norm(split.vertices, axis=1, keepdims=True)
    return trimesh.Trimesh(round_verts, split.faces, process=False)


def _grid_faces(segments: int, rings: int) -> np.ndarray:
    """Triangles between the parallels, and the fans about the two poles.

    a---b   a, b on one parallel, c, d on the next; the last two vertices are the poles
    | / |
    c---d
    """
    a = np.arange(segments * (rings - 2))
    b = a // segments * segments + (a + 1) % segments
    c, d = a + segments, b + segments
    first = np.arange(segments)
    last = first + segments * (rings - 2)
    north, south = segments * (rings - 1) + np.zeros((2, segments), int) + [[0], [1]]
    quads = [np.stack([a, c, b], 1), np.stack([b, c, d], 1)]
    caps = [
        np.stack([north, first, np.roll(first, -1)], 1),
        np.stack([south, np.roll(last, -1), last], 1),
    ]
    return np.concatenate(quads + caps)


def _outwards(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Turn every face of a convex mesh about the origin so that its normal points away from it."""
    corners = mesh.triangles
    inwards = (
        np.einsum("fi,fi->f", np.cross(*np.diff(corners, axis=1).swapaxes(0, 1)), corners[:, 0]) < 0
    )
    faces = np.where(inwards[:, None], mesh.faces[:, ::-1], mesh.faces)
    return trimesh.Trimesh(mesh.vertices, faces, process=False)
