"""A surface of another source, led back to the silhouettes by a few steps of the preset ``fast``.

Its edges and the cameras stay as they are, and no part is remeshed or turned: hollows that no
outline shows have no gradient from silhouettes, so they stay open.
"""

from collections.abc import Sequence

import numpy as np
import torch
import trimesh

from silmesh.fitting.fast import Fast
from silmesh.fitting.image_pyramid import BASE
from silmesh.geometry.camera import INITIAL_SCALE, Cameras, Similarity
from silmesh.geometry.frame import known_pixels
from silmesh.geometry.mesh_files import to_tensors
from silmesh.settings.fit import AUTO, FastFit, FastWeights

STEPS = 60  # at most
SPREAD = 2.0  # pixels over which a step spreads: a surface of small triangles would hardly move
FIXED = {  # the smoothness terms would smooth what photographs have found, also where no outline is
    "coarse_to_fine": False,
    "refine_cameras": False,
    "remesh": False,
    "untangle": False,
    "weights": FastWeights(laplacian=0, flatten=0),
}


def follow_outlines(
    mesh: trimesh.Trimesh,
    cameras: Cameras,
    silhouettes: np.ndarray,
    settings: FastFit,
    frames: Sequence[Sequence[int]] | None = None,
) -> trimesh.Trimesh:
    """Take a few steps of a fit from a mesh that is almost right.

    Args:
        mesh: closed, in the cameras' world
        cameras: of the views that have a say
        silhouettes: [views, height, width] bool, theirs
        settings: of the fit that the mesh comes from
        frames: [views, 4] of the photographs within the images; the whole images if not given
    Returns:
        the same vertices and faces, in the same order, elsewhere; single precision, as in files
    """
    similarity = Similarity.centring(mesh.bounds)
    known = known_pixels(silhouettes, frames)
    verts, faces = to_tensors(mesh)
    fit = Fast(
        INITIAL_SCALE * similarity.apply(verts.double()).float(),
        faces,
        cameras.in_world_of(similarity),
        _prepare(silhouettes),
        settings.model_copy(
            update={
                **FIXED,
                "iterations": STEPS,
                "smoothing": _smooth(mesh, cameras, settings),
                "renderer": AUTO if settings.renderer == "gpu" else settings.renderer,
            }
        ),
        known=None if known is None else _prepare(known),
    )
    while not fit.done:
        fit.step()
    moved = similarity.inverse.apply(fit.verts.double()).numpy()
    return trimesh.Trimesh(np.float64(np.float32(moved)), mesh.faces, process=False)


def _smooth(mesh: trimesh.Trimesh, cameras: Cameras, settings: FastFit) -> float:
    """How far a step spreads, in squared edges."""
    away = (cameras.centres - cameras.centres.new_tensor(mesh.bounds.mean(axis=0))).norm(dim=1)
    pixel = float((away / cameras.K[:, 0, 0]).median())
    return max(settings.smoothing, (SPREAD * pixel / float(mesh.edges_unique_length.mean())) ** 2)


def _prepare(images: np.ndarray) -> torch.Tensor:
    """As the procedure takes them: large ones stay bool, since it looks at parts of them."""
    given = torch.from_numpy(images)
    return given if images.shape[-1] > BASE else given.float()
