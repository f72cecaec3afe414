"""A whole fit: from an initial mesh and a scene to the mesh, its cameras and its losses."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import trimesh
from torch import Tensor

from silmesh.errors import InputError
from silmesh.fitting.checkpoint import Checkpoint
from silmesh.fitting.loop import Record
from silmesh.fitting.loop import run as run_fit
from silmesh.fitting.presets import find_procedure
from silmesh.geometry.camera import Cameras
from silmesh.geometry.mesh_files import to_tensors
from silmesh.own_code import naming
from silmesh.scene.scene import Scene
from silmesh.settings.fit import Fit, refuse_clash
from silmesh.views import held_out


@dataclass(frozen=True)
class Fitted:
    """The result of a fit.

    Attributes:
        mesh: in the input's own world, its vertices those of single precision that files have
        cameras: of all views in that world, corrected if the procedure does
        records: the losses before each step
        settings: by which it was fitted
    """

    mesh: trimesh.Trimesh
    cameras: Cameras
    records: Sequence[Record]
    settings: Fit


def fit_mesh(
    mesh: trimesh.Trimesh,
    scene: Scene,
    settings: Fit,
    watch: Callable[[Record], None] = lambda record: None,
    go_on: Callable[[Sequence[Any]], Checkpoint] | None = None,
) -> Fitted:
    """Fit a mesh to the silhouettes of a scene.

    Args:
        mesh: at unit size (the procedures halve it)
        scene: the views; those of weight 0 are not fitted
        settings: of the preset, whose procedure fits; which views are kept out; the device
        watch: is told of each step
        go_on: makes the checkpoint to resume from and to write, from all that the fit depends on

    Raises:
        InputError: the mesh does not suit the procedure, there is no such device, or the fit
            meets numbers that are not finite again and again
    """
    cameras = scene.cameras
    counts = [scene.notes.get("weights", {}).get(view, 1.0) for view in cameras.views]
    out = held_out(len(cameras), settings.holdout)
    kept = [i for i, count in enumerate(counts) if count and i not in out]
    device = _choose_device(settings)
    template, faces = (part.to(device) for part in to_tensors(mesh))
    silhouettes = torch.tensor(scene.silhouettes[kept]).to(device, torch.float32)
    weights = _weights([counts[i] for i in kept], device)
    parts = template, faces, cameras.select(kept), silhouettes, settings, weights
    checkpoint = go_on(parts) if go_on else None
    with naming(settings.preset, settings.renderer):
        fit = find_procedure(settings.preset)(*parts)
        records = run_fit(fit, watch, checkpoint)
        back = scene.similarity.inverse
        fitted = to_mesh(back.apply(fit.verts.double()), fit.faces)
        corrected = fit.correct(cameras, kept).in_world_of(back)
    return Fitted(fitted, corrected, records, settings)


def to_mesh(verts: Tensor, faces: Tensor) -> trimesh.Trimesh:
    """A mesh as it is read from the file that is written of it."""
    single = verts.cpu().numpy().astype(np.float32)
    return trimesh.Trimesh(single.astype(np.float64), faces.cpu().numpy(), process=False)


def _weights(counts: Sequence[float], device: str) -> Tensor | None:
    """How much each view counts, [views], or None if all count the same."""
    return torch.tensor(counts, device=device) if len(set(counts)) > 1 else None


def _choose_device(settings: Fit) -> str:
    refuse_clash(settings)
    name, gpu = settings.device, torch.cuda.is_available()
    if name == "cuda" and not gpu:
        raise InputError("device 'cuda': torch finds no GPU here; should be 'cpu' or 'auto'")
    if name != "auto":
        return name
    return "cuda" if gpu and settings.renderer != "cpu" else "cpu"
