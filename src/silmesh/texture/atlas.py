"""The atlas: a mesh cut into charts, laid flat in a square, and where its texels lie on the mesh.

``xatlas`` cuts and packs. Texture coordinates have their origin at the lower left, as OBJ has them;
a picture's first row is its upper one.

       v                       (0, 0) +-------> column
     1 +-------+                      | texel (i, j) has its centre at
       |       |                      | u = (j + 0.5) / size, v = 1 - (i + 0.5) / size
     0 +-------+ u                    v row
       0       1
"""

from dataclasses import dataclass

import numpy as np
import xatlas

from silmesh.texture.raster import draw, weigh_corners

RESOLUTION = 1024  # texels of the square that charts are packed for
PADDING = 4  # texels of it between charts
PART = 4_000  # triangles that are cut into charts together; the time grows with their square


@dataclass(frozen=True)
class Atlas:
    """A mesh whose vertices are split where charts end.

    Attributes:
        origin: [verts] the vertex of the mesh that each is
        faces: [faces, 3], in the order of the mesh's
        uv: [verts, 2] texture coordinates in 0..1
        charts: how many
    """

    origin: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    charts: int

    def in_texels(self, size: int) -> np.ndarray:
        """Where the vertices lie in a square picture: [verts, 2], column and row."""
        return np.stack([self.uv[:, 0], 1 - self.uv[:, 1]], axis=1).astype(np.float64) * size


@dataclass(frozen=True)
class Texels:
    """The texels of a square picture that lie on the mesh.

    Attributes:
        at: [texels] positions in the picture's rows
        faces: [texels] int32, the triangle that each lies on
        weights: [texels, 3] float32, of its corners
    """

    at: np.ndarray
    faces: np.ndarray
    weights: np.ndarray


def unwrap(verts: np.ndarray, faces: np.ndarray) -> Atlas:
    """Lay a mesh flat.

    Args:
        verts: [verts, 3]
        faces: [faces, 3]
    """
    atlas = xatlas.Atlas()
    parts = _split(verts[faces].mean(axis=1), np.arange(len(faces)))
    origins = []
    for part in parts:
        used, corners = np.unique(faces[part], return_inverse=True)
        atlas.add_mesh(verts[used].astype(np.float32), corners.reshape(-1, 3).astype(np.uint32))
        origins.append(used)
    packing = xatlas.PackOptions()
    packing.resolution, packing.padding = RESOLUTION, PADDING
    atlas.generate(xatlas.ChartOptions(), packing)
    return _join(atlas, parts, origins, len(faces))


def _split(centres: np.ndarray, part: np.ndarray) -> list[np.ndarray]:
    """Halve triangles [faces] by where they lie until each part has at most PART."""
    if len(part) <= PART:
        return [part]
    axis = np.ptp(centres[part], axis=0).argmax()
    order = part[centres[part, axis].argsort(kind="stable")]
    halves = np.split(order, [len(order) // 2])
    return [small for half in halves for small in _split(centres, np.sort(half))]


def _join(
    atlas: xatlas.Atlas, parts: list[np.ndarray], origins: list[np.ndarray], faces: int
) -> Atlas:
    """The parts of a packed atlas as one, its triangles in the order of the mesh's."""
    extent = np.array([atlas.width, atlas.height])
    origin, uv, corners, count = [], [], np.empty((faces, 3), np.int64), 0
    for i, (part, used) in enumerate(zip(parts, origins, strict=True)):
        ours, triangles, flat = atlas.get_mesh(i)
        corners[part] = triangles.astype(np.int64) + count
        origin.append(used[ours])
        uv.append(flat * extent / extent.max())
        count += len(ours)
    u, v = np.concatenate(uv).T
    coordinates = np.stack([u, 1 - v], axis=1).astype(np.float32)
    return Atlas(np.concatenate(origin), corners, coordinates, atlas.chart_count)


def find_texels(atlas: Atlas, size: int) -> Texels:
    """The texels whose centres lie on the mesh, in a picture of ``size`` x ``size``."""
    points, depths = atlas.in_texels(size), np.ones(len(atlas.uv))
    shown = draw(points, depths, atlas.faces, (size, size))[0].ravel()
    at = np.flatnonzero(shown >= 0)
    centres = np.stack([at % size, at // size], axis=1) + 0.5
    weights = weigh_corners(points, depths, atlas.faces[shown[at]], centres)
    return Texels(at, shown[at], weights)
