"""Even triangles, as many as are wanted, on the surface of a finer mesh.

The remesher comes near to the wanted number of vertices from below; splitting as many of the
longest edges as are lacking then makes it exact.
"""

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from silmesh.geometry.edges import number_edges
from silmesh.geometry.remeshing import even_length, flip_edges, relax, remesh, split_long

PASSES = 3  # passes of the first remeshing
TRIES = 8  # most further passes, each with a new edge length, to approach the wanted number
NEAR = 0.96  # share of the wanted number from which the rest comes of splitting longest edges
SETTLING = 4  # rounds of flips and relaxation at the end
JITTER = 1e-7  # of an edge: random change by which no two edges have the same length


def even_mesh(surface: trimesh.Trimesh, vertices: int) -> trimesh.Trimesh:
    """A mesh of so many vertices on a surface, of its genus, with even triangles.

    With fewer than about a hundred vertices a surface of sharp edges may keep some more than are
    wanted, where the remesher would tip a triangle over to be rid of them.

    Args:
        surface: closed, in one piece, oriented outwards, with more vertices than are wanted
    """
    verts, faces = np.array(surface.vertices), np.array(surface.faces)
    wanted = 2 * (vertices - surface.euler_number)  # faces: V - E + F = chi and 3 F = 2 E
    length = even_length(verts, faces, wanted)
    verts = verts + JITTER * length * np.random.default_rng(0).standard_normal(verts.shape)
    project = _Projection(surface)
    verts, faces = remesh(verts, faces, length, PASSES)
    for _ in range(TRIES):
        verts = project(verts)
        if NEAR * vertices <= len(verts) <= vertices:
            break
        length *= np.sqrt(len(verts) / (0.985 * vertices))
        verts, faces = remesh(verts, faces, length, 1)
    while len(verts) < vertices:
        verts, faces = _split_longest(verts, faces, vertices - len(verts))
    for _ in range(SETTLING):
        faces = flip_edges(verts, faces)
        verts = project(relax(verts, faces))
    return trimesh.Trimesh(verts, faces, process=False)


def _split_longest(
    verts: np.ndarray, faces: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    edges, _ = number_edges(faces)
    lengths = np.linalg.norm(verts[edges[:, 0]] - verts[edges[:, 1]], axis=1)
    count = min(count, len(edges) - 1)
    return split_long(verts, faces, np.partition(lengths, -count - 1)[-count - 1])


class _Projection:
    """Moves points onto the plane that touches a surface at its vertex nearest to each.

    They stay within an edge of that vertex, so that none leaves a surface that bends sharply.
    """

    def __init__(self, surface: trimesh.Trimesh):
        self._points, self._normals = surface.vertices, surface.vertex_normals
        self._edge = float(surface.edges_unique_length.mean())
        self._tree = cKDTree(self._points)

    def __call__(self, verts: np.ndarray) -> np.ndarray:
        _, nearest = self._tree.query(verts)
        points, normals = self._points[nearest], self._normals[nearest]
        off = verts - points
        along = off - (off * normals).sum(axis=1, keepdims=True) * normals
        reach = np.linalg.norm(along, axis=1, keepdims=True)
        return points + along * np.minimum(1, self._edge / np.maximum(reach, 1e-12))
