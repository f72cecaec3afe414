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
    atlas.add_mesh(verts.astype(np.float32), faces.astype(np.uint32))
    packing = xatlas.PackOptions()
    packing.resolution, packing.padding = RESOLUTION, PADDING
    atlas.generate(xatlas.ChartOptions(), packing)
    origin, corners, uv = atlas.get_mesh(0)
    extent = np.array([atlas.width, atlas.height])
    square = uv * extent / extent.max()
    return Atlas(
        origin.astype(np.int64),
        corners.astype(np.int64),
        np.stack([square[:, 0], 1 - square[:, 1]], axis=1).astype(np.float32),
        atlas.chart_count,
    )


def find_texels(atlas: Atlas, size: int) -> Texels:
    """The texels whose centres lie on the mesh, in a picture of ``size`` x ``size``."""
    points, depths = atlas.in_texels(size), np.ones(len(atlas.uv))
    shown = draw(points, depths, atlas.faces, (size, size))[0].ravel()
    at = np.flatnonzero(shown >= 0)
    centres = np.stack([at % size, at // size], axis=1) + 0.5
    weights = weigh_corners(points, depths, atlas.faces[shown[at]], centres)
    return Texels(at, shown[at], weights)
