"""Meshes on disk: reading one for the renderer, and writing the three formats people want."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
import trimesh
from torch import Tensor

from silmesh.errors import InputError
from silmesh.files import replacing


def read_mesh(path: Path) -> trimesh.Trimesh:
    """Read a mesh as it is, its vertices neither merged nor reordered.

    Raises:
        InputError: it cannot be read, has no face, or a vertex that is not finite
    """
    try:
        mesh = trimesh.load_mesh(path, process=False)
    except Exception as error:  # each of trimesh's readers raises errors of its own
        raise InputError(f"{path}: cannot be read as a mesh: {error}") from error
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise InputError(f"{path}: holds no triangle")
    if not np.isfinite(mesh.vertices).all():
        raise InputError(f"{path}: holds a vertex that is not finite")
    return mesh


def refuse_flat(path: Path, mesh: trimesh.Trimesh) -> None:
    """Refuse a mesh whose triangles have no area, so that no point can be sampled on them."""
    if not mesh.area > 0:
        raise InputError(f"{path}: its {len(mesh.faces)} triangles have no area")


def to_tensors(mesh: trimesh.Trimesh) -> tuple[Tensor, Tensor]:
    """Vertices [verts, 3] float32 and faces [faces, 3] int64."""
    verts = torch.tensor(np.asarray(mesh.vertices), dtype=torch.float32)
    return verts, torch.tensor(np.asarray(mesh.faces), dtype=torch.int64)


def write_mesh(paths: Sequence[Path], verts: Tensor, faces: Tensor) -> None:
    """Write a mesh to each of these paths, in the formats that their endings name."""
    mesh = trimesh.Trimesh(verts.cpu().numpy(), faces.cpu().numpy(), process=False)
    for path in paths:
        with replacing(path) as part:
            mesh.export(part)
