"""A whole fit: from an initial mesh and a scene to the mesh, its cameras and its losses."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
import trimesh
from torch import Tensor

from silmesh.cameras.exact import are_exact
from silmesh.errors import InputError
from silmesh.fitting.belief import Belief, believe_all
from silmesh.fitting.checkpoint import Checkpoint
from silmesh.fitting.image_pyramid import BASE
from silmesh.fitting.loop import Record
from silmesh.fitting.loop import run as run_fit
from silmesh.fitting.presets import find_procedure, refuse_result
from silmesh.geometry.camera import Cameras
from silmesh.geometry.mesh_files import to_tensors
from silmesh.geometry.unseen import span_unseen
from silmesh.own_code import naming, own_file
from silmesh.scene.scene import Scene
from silmesh.settings.fit import AUTO, FastFit, Fit, refuse_clash, spans_unseen
from silmesh.softras import has_triton
from silmesh.views import held_out


@dataclass(frozen=True)
class Fitted:
    """The result of a fit.

    Attributes:
        mesh: in the input's own world, its vertices those of single precision that files have
        cameras: of all views in that world, corrected if the procedure does
        records: the losses before each step
        settings: by which it was fitted
        notes: mean IoU of the start and of the end with what counts of the silhouettes, the views
            of which not all counts, whether the cameras were left because they agree with the
            outlines, and what a person should know, in sentences
        relief: after photographs had a say: what came of it, as ``relief.json`` says it
        standing: [verts] uint8, then: what each vertex stands on, 0 outlines, 1 photographs, 2 a
            guess
    """

    mesh: trimesh.Trimesh
    cameras: Cameras
    records: Sequence[Record]
    settings: Fit
    notes: Mapping[str, Any] = field(default_factory=dict)
    relief: Mapping[str, Any] | None = None
    standing: np.ndarray | None = None

    def warning(self, what: str) -> "Fitted":
        """The same with another warning among its notes."""
        return replace(self, notes={**self.notes, "warnings": [*self.notes["warnings"], what]})


def fit_mesh(
    mesh: trimesh.Trimesh,
    scene: Scene,
    settings: Fit,
    watch: Callable[[Record], None] = lambda record: None,
    go_on: Callable[[Sequence[Any]], Checkpoint] | None = None,
    belief: Belief | None = None,
) -> Fitted:
    """Fit a mesh to the silhouettes of a scene.

    Args:
        mesh: at unit size (the procedures halve it)
        scene: the views; those of weight 0 are not fitted
        settings: of the preset, whose procedure fits; which views are kept out; the device
        watch: is told of each step
        go_on: makes the checkpoint to resume from and to write, from all that the fit depends on
        belief: what counts of the views; everything if not given

    Raises:
        InputError: the mesh does not suit the procedure, there is no such device, or the fit
            meets numbers that are not finite again and again
    """
    cameras = scene.cameras
    belief = belief or believe_all(scene, fitted_views(scene, settings))
    kept, known = belief.views, belief.known
    exact = _has_exact_cameras(settings, scene, kept)
    settings = settings.model_copy(update={"refine_cameras": False}) if exact else settings
    device = _choose_device(settings)
    template, faces = (part.to(device) for part in to_tensors(mesh))
    silhouettes = _to_tensor(scene.silhouettes, settings, device, kept)
    weights = _weights(belief.weights.tolist(), device)
    parts = template, faces, cameras.select(kept), silhouettes, settings, weights
    if known is not None and not own_file(settings.preset):
        parts = *parts, _to_tensor(known, settings, device)
    checkpoint = go_on(parts) if go_on else None
    with naming(settings.preset, settings.renderer):
        fit = find_procedure(settings.preset)(*parts)
        start = fit.verts.clone(), fit.faces
        records = run_fit(fit, watch, checkpoint)
        corrected = fit.correct(cameras, kept)
        refuse_result(settings.preset, fit, len(records), corrected, len(cameras))
        verts, faces = fit.verts.cpu(), fit.faces.cpu()
        if spans_unseen(settings):
            verts = _span(verts, faces, corrected, scene, belief)
        notes = {
            "iou_start": belief.measure(*(part.cpu() for part in start), cameras, scene),
            "iou_end": belief.measure(verts, faces, corrected, scene),
            "distrusted": list(belief.distrusted),
            "corrected": list(belief.corrected),
            "cameras_exact": exact,
            "warnings": belief.warnings + _name_slow_renderer(settings, device),
        }
        back = scene.similarity.inverse
        fitted = to_mesh(back.apply(verts.double()), faces)
    return Fitted(fitted, corrected.in_world_of(back), records, settings, notes)


def fitted_views(scene: Scene, settings: Fit) -> list[int]:
    """The positions of the views that have weight and are not kept out."""
    given, out = scene.notes.get("weights", {}), held_out(len(scene.cameras), settings.holdout)
    views = enumerate(scene.cameras.views)
    return [i for i, view in views if given.get(view, 1.0) and i not in out]


def to_mesh(verts: Tensor, faces: Tensor) -> trimesh.Trimesh:
    """A mesh as it is read from the file that is written of it."""
    single = verts.cpu().numpy().astype(np.float32)
    return trimesh.Trimesh(single.astype(np.float64), faces.cpu().numpy(), process=False)


def _span(verts: Tensor, faces: Tensor, cameras: Cameras, scene: Scene, belief: Belief) -> Tensor:
    """Vertices of a fitted mesh whose ends that no view sees are spanned."""
    mesh = trimesh.Trimesh(verts.double().numpy(), faces.numpy(), process=False)
    frames = None if scene.frames is None else scene.frames[belief.views]

    def overlap(body: trimesh.Trimesh) -> float:
        return belief.measure(*to_tensors(body), cameras, scene)

    spanned = span_unseen(mesh, cameras.select(belief.views), overlap, frames)
    return torch.from_numpy(np.asarray(spanned.vertices)).to(verts.dtype)


def _has_exact_cameras(settings: Fit, scene: Scene, kept: list[int]) -> bool:
    """Whether a fit that could refine the cameras leaves them, as they agree with the outlines."""
    if not (isinstance(settings, FastFit) and settings.refine_cameras):
        return False
    frames = None if scene.frames is None else scene.frames[kept]
    return are_exact(scene.silhouettes[kept], scene.cameras.select(kept), frames)


def _to_tensor(
    images: np.ndarray, settings: Fit, device: str, kept: list[int] | None = None
) -> Tensor:
    """Images [views, height, width] bool as the procedure takes them: 0 or 1.

    Large ones stay as they are where the procedure looks at parts of them, which are turned into
    numbers then.
    """
    if isinstance(settings, FastFit) and images.shape[-1] > BASE:
        every = kept is None or kept == list(range(len(images)))
        return torch.from_numpy(images if every else images[kept])
    return torch.tensor(images if kept is None else images[kept]).to(device, torch.float32)


def _weights(counts: Sequence[float], device: str) -> Tensor | None:
    """How much each view counts, [views], or None if all count the same."""
    return torch.tensor(counts, device=device) if len(set(counts)) > 1 else None


def _choose_device(settings: Fit) -> str:
    refuse_clash(settings)
    name, gpu = settings.device, torch.cuda.is_available()
    if settings.renderer == "gpu" and not gpu:
        raise InputError("renderer 'gpu': torch finds no GPU here; should be 'auto' or 'cpu'")
    if name == "cuda" and not gpu:
        raise InputError("device 'cuda': torch finds no GPU here; should be 'cpu' or 'auto'")
    if name != "auto":
        return name
    return "cuda" if gpu and settings.renderer != "cpu" else "cpu"


def _name_slow_renderer(settings: Fit, device: str) -> list[str]:
    """That a GPU's kernel was not used because what compiles it is not installed."""
    if device != "cuda" or settings.renderer != AUTO or has_triton():
        return []
    return [
        "the fit rendered by plain torch on the GPU, which is slow: its kernel needs a library "
        "that is not installed (`pip install 'silmesh[gpu]'`)"
    ]
