"""The metrics of a fitted mesh: the content of ``metrics.json``."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import trimesh

from silmesh.evaluation.mesh_quality import measure_quality
from silmesh.geometry.camera import MIRROR, Cameras
from silmesh.geometry.mesh_files import to_tensors
from silmesh.geometry.silhouette_iou import silhouette_iou
from silmesh.scene.scene import Scene
from silmesh.views import held_out


def evaluate(
    mesh: trimesh.Trimesh,
    cameras: Cameras,
    scene: Scene,
    last: Mapping[str, Any],
    sigma: float,
    holdout: int = 0,
    initial: Mapping[str, Any] | None = None,
    fit: Mapping[str, Any] | None = None,
    silhouettes: str | None = None,
    truth: trimesh.Trimesh | None = None,
    align: bool = False,
    relief: Mapping[str, Any] | None = None,
    texture: Mapping[str, Any] | None = None,
    voxels: np.ndarray | None = None,
) -> dict[str, Any]:
    """Measure a fitted mesh: IoU with its silhouettes, and in 3D where a truth is given.

    Args:
        mesh: in the cameras' world
        cameras: of the scene's views, as the fit left them
        scene: after its silhouettes were judged
        last: ``loss``, ``iteration`` and ``seconds`` of the fit's last step
        sigma: as in the fit, in squared half-image units
        holdout: every n-th view was kept out of the fit; 0 for none
        initial: ``init.json`` of the initial mesh
        fit: ``fit.json`` of the fit
        silhouettes: where they lie, as the metrics say it
        truth: the true mesh, in the cameras' world
        align: register the mesh with the truth first
        relief: ``relief.json``, where photographs were to have a say in the mesh
        texture: ``texture.json`` of the texture
        voxels: that the truth was made of, as ``silmesh.geometry.voxels`` has them
    Returns:
        the metrics, for JSON: ``docs/metrics.md`` says what each is
    """
    iou = silhouette_iou(*to_tensors(mesh), cameras, scene.silhouettes, sigma, scene.frames)
    metrics = {
        **summarise_iou(iou, held_out(len(iou), holdout)),
        "hull_iou_mean": float(scene.coherence.mean()),
        "views": len(iou),
        **_describe_views(scene.notes),
        "loss_final": float(last["loss"]),
        "iterations": int(last["iteration"]) + 1,
        "fit_seconds": float(last["seconds"]),
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        **measure_quality(mesh),
        **_describe_texture(texture),
        "silhouettes": silhouettes,
    }
    if truth is not None:
        mirrored = scene.notes.get("mirrored")
        truth = _mirror(truth) if mirrored else truth
        if voxels is not None and mirrored:
            voxels = voxels[:, :, ::-1]
        metrics |= _compare(mesh, truth, align, voxels)
    metrics["cameras"] = _describe_cameras(scene.notes)
    if initial is not None:
        metrics["first"] = dict(initial)
        metrics["init_iou_mean"] = initial.get("iou_mean")
    if fit is not None:
        metrics["fit"] = dict(fit)
    if relief is not None:
        metrics["surface"] = dict(relief["surface"])
        metrics["relief"] = {key: value for key, value in relief.items() if key != "surface"}
    if texture is not None:
        metrics["texture"] = dict(texture)
    metrics["iou"] = dict(zip(cameras.views, iou.tolist(), strict=True))
    return metrics


def _describe_views(notes: Mapping[str, Any]) -> dict[str, Any]:
    """What the metrics say of views, from the notes of their scene."""
    return {
        "views_dropped": len(notes["dropped"]),
        "views_repaired": len(notes.get("repaired", [])),
        "repairs": notes.get("repairs", {}),
        "hull_doubtful": ", ".join(notes["doubtful"]) or None,
        "measured": notes.get("measured", []),
        "silhouettes_contradicted": notes.get("contradicted", []),
    }


def _describe_texture(notes: Mapping[str, Any] | None) -> dict[str, Any]:
    """What the metrics say of the texture, from its notes."""
    held = (notes or {}).get("held_out") or {}
    measured = {"texture_psnr_holdout": held.get("psnr")}
    if notes is None:
        return measured
    return measured | {
        "texture_ssim_holdout": held.get("ssim"),
        "texture_size": notes["size"],
        "texture_unseen": notes["unseen"],
    }


def _describe_cameras(notes: Mapping[str, Any]) -> dict[str, Any]:
    """What the metrics say of cameras, from the notes of their scene."""
    return {
        "source": notes["cameras"],
        "because": notes["cameras_because"],
        "attempts": notes["attempts"],
        "dropped": notes["dropped"],
        "mirrored": notes.get("mirrored", False),
        "warnings": notes["warnings"],
    }


def _mirror(truth: trimesh.Trimesh) -> trimesh.Trimesh:
    """The ground truth of a left-handed world, mirrored as the world of the mesh is."""
    mirrored = truth.copy()
    mirrored.apply_transform(np.diag([*MIRROR, 1.0]))
    return mirrored


def _compare(
    mesh: trimesh.Trimesh,
    truth: trimesh.Trimesh,
    align: bool,
    voxels: np.ndarray | None,
) -> dict[str, bool | float | dict | None]:
    """Compare a mesh to the truth, registered with it first if ``align`` is set."""
    # What only a truth needs: libraries that take half a second of a run without one.
    from silmesh.evaluation.ground_truth import compare_to_truth
    from silmesh.evaluation.registration import register

    if not align:
        return compare_to_truth(mesh, truth, voxels)
    found = register(mesh, truth)
    moved = trimesh.Trimesh(found.apply(mesh.vertices), mesh.faces, process=False)
    placement = {"scale": found.scale, "R": found.R.tolist(), "t": found.t.tolist()}
    registered = {"aligned": True, "scale": found.scale, "placement": placement}
    return registered | compare_to_truth(moved, truth, voxels)


def summarise_iou(values: np.ndarray, held_out: Sequence[int]) -> dict[str, float | None]:
    """Mean and least over the fitted views, mean over the held-out ones (None without)."""
    fitted = np.delete(values, list(held_out))
    return {
        "iou_mean": float(fitted.mean()),
        "iou_min": float(fitted.min()),
        "iou_holdout": float(values[list(held_out)].mean()) if len(held_out) else None,
    }
