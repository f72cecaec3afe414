"""What the page shows of a fit in 3D and over its photographs, all at unit size.

The meshes and cameras are in the scene's normalised world, in which the object reaches 0.5 from
the origin, so that the fits of an object are seen at one scale.
"""

from typing import Any

import numpy as np
import torch
import trimesh
from scipy.spatial import cKDTree

from silmesh.geometry.camera import INITIAL_SCALE, Cameras, Similarity
from silmesh.geometry.mesh_files import to_linear
from silmesh.geometry.textured_mesh import find_normals, picture_of
from silmesh.report.outlines import outline_path
from silmesh.report.packing import encode_glb, pack
from silmesh.report.page_textures import encode_texture
from silmesh.report.rings import frusta_of, look_ahead
from silmesh.softras.batches import render_views

STANDING = np.array([[86, 180, 233], [0, 158, 115], [230, 159, 0]])  # outline, photographs, guess
DIGITS = 3  # decimals of the cameras' positions, in units of the normalised world


def describe_exhibit(
    mesh: trimesh.Trimesh,
    colours: np.ndarray,
    initial: trimesh.Trimesh,
    cameras: Cameras,
    similarity: Similarity,
    sigma: float,
    textured: trimesh.Trimesh | None = None,
    standing: np.ndarray | None = None,
) -> dict[str, Any]:
    """What the page needs of a fit.

    Args:
        mesh: fitted, in the cameras' world
        colours: [verts, 3] of its vertices, linear light in [0, 1]
        initial: the initial mesh, at unit size: twice as large as in the normalised world
        cameras: of the mesh's world
        similarity: from that world to the normalised one
        sigma: softness of the rendering, as in the fit
        standing: [verts] what each vertex stands on, where that is known
        textured: the fitted mesh with a texture, if it has one
    Returns:
        ``fitted`` and ``first``: packed GLB; ``texture``: that of ``fitted``, which is laid on it
        where there is room, or None; ``standing``: the fitted mesh coloured by what it stands on,
        or None; ``outlines``: a path for each view; ``up`` and ``ahead``: unit vectors, where the
        first camera looks level; ``cameras``: ``views``, ``apexes`` and ``corners`` of their frusta
    """
    fitted = _encode_fitted(mesh, colours, similarity, textured)
    frusta, up = frusta_of(cameras.in_world_of(similarity)), cameras.up.numpy()
    return {
        "fitted": pack(fitted),
        "texture": None if textured is None else encode_texture(picture_of(textured)),
        "first": pack(encode_glb(np.asarray(initial.vertices) / INITIAL_SCALE, initial.faces)),
        "standing": show_standing(_normalise(mesh, similarity), mesh.faces, standing),
        "outlines": dict(zip(cameras.views, _outlines(mesh, cameras, sigma), strict=True)),
        "up": up.tolist(),
        "ahead": look_ahead(cameras, up).tolist(),
        "cameras": {
            "views": list(cameras.views),
            "apexes": frusta.apexes.round(DIGITS).tolist(),
            "corners": frusta.corners.round(DIGITS).tolist(),
        },
    }


def show_standing(place: np.ndarray, faces: np.ndarray, standing: np.ndarray | None) -> str | None:
    """A packed mesh in the colours of what its vertices stand on, unless that is one thing."""
    if standing is None or len(np.unique(standing)) < 2:
        return None
    return pack(encode_glb(place, faces, to_linear(STANDING[standing])))


def _encode_fitted(
    mesh: trimesh.Trimesh,
    colours: np.ndarray,
    similarity: Similarity,
    textured: trimesh.Trimesh | None,
) -> bytes:
    """The fitted mesh in the normalised world, with texture coordinates if it has a texture."""
    if textured is None:
        return encode_glb(_normalise(mesh, similarity), mesh.faces, colours)
    _, same = cKDTree(mesh.vertices).query(textured.vertices)
    return encode_glb(
        _normalise(textured, similarity),
        textured.faces,
        colours[same],
        find_normals(np.asarray(textured.vertices), textured.faces),
        np.asarray(textured.visual.uv, float),
    )


def _normalise(mesh: trimesh.Trimesh, similarity: Similarity) -> np.ndarray:
    return similarity.apply(torch.tensor(np.asarray(mesh.vertices))).numpy()


def _outlines(mesh: trimesh.Trimesh, cameras: Cameras, sigma: float) -> list[str]:
    """The mesh's outline in each view: where the soft silhouette that is fitted passes a half."""
    verts = torch.tensor(np.asarray(mesh.vertices), dtype=torch.float32)
    faces = torch.tensor(np.asarray(mesh.faces), dtype=torch.int64)
    width, height = cameras.sizes[0].tolist()
    alphas = render_views(cameras.project(verts), faces, (height, width), sigma)
    return [outline_path(alpha.numpy()) for alpha in alphas]
