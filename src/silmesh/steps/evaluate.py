"""Measure a fitted mesh: IoU with its silhouettes, and in 3D where a truth is given."""

import csv
import json
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
import trimesh

from silmesh.cameras.camera import MIRROR, read_cameras
from silmesh.evaluation import silhouette_iou, summarise_iou
from silmesh.files import replacing
from silmesh.mesh_quality import measure_quality
from silmesh.meshes import read_mesh, to_tensors
from silmesh.scene import SILHOUETTES, read_scene
from silmesh.settings.fit import Fit
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import add_settings, output_file, parser, run
from silmesh.views import held_out


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--mesh", type=Path, required=True, help="the fitted mesh")
    args.add_argument("--cameras", type=Path, required=True, help="cameras.json of its world")
    args.add_argument("--loss", type=Path, required=True, help="loss.csv of its fit")
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    args.add_argument("--first", type=Path, help="init.json of its first mesh")
    args.add_argument("--truth", type=Path, help="the true mesh, in the cameras' world")
    args.add_argument("--align", action="store_true", help="lay the mesh on the truth first")
    add_settings(args, Fit, of="its fit")
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--results", type=Path, default=Path("results"), help="for relative paths")
    args.add_argument("--output", type=output_file, required=True, help="metrics.json to write")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)

    cameras, mesh = read_cameras(given.cameras), read_mesh(given.mesh)
    folder = given.scene / SILHOUETTES
    silhouettes = read_silhouettes(folder, cameras.views)
    sigma = given.settings.sigma_at(silhouettes.shape[-1])
    iou = silhouette_iou(*to_tensors(mesh), cameras, silhouettes, sigma)
    scene = read_scene(given.scene)[2]
    last = _read_last(given.loss)
    metrics = {
        **summarise_iou(iou, held_out(len(iou), given.settings.holdout)),
        "hull_iou_mean": scene["hull_iou_mean"],
        "views": len(iou),
        "views_dropped": len(scene["dropped"]),
        "views_repaired": len(scene.get("repaired", [])),
        "hull_doubtful": ", ".join(scene["doubtful"]) or None,
        "measured": scene.get("measured", []),
        "silhouettes_contradicted": scene.get("contradicted", []),
        "loss_final": float(last["loss"]),
        "iterations": int(last["iteration"]) + 1,
        "fit_seconds": float(last["seconds"]),
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        **measure_quality(mesh),
        "silhouettes": Path(os.path.relpath(folder, given.results)).as_posix(),
    }
    if given.truth:
        truth = read_mesh(given.truth)
        if scene.get("mirrored"):  # as the world of the mesh is
            truth.apply_transform(np.diag([*MIRROR, 1.0]))
        metrics |= _compare(mesh, truth, given.align)
    metrics["cameras"] = {
        "source": scene["cameras"],
        "because": scene["cameras_because"],
        "attempts": scene["attempts"],
        "dropped": scene["dropped"],
        "mirrored": scene.get("mirrored", False),
        "warnings": scene["warnings"],
    }
    if given.first:
        metrics["first"] = json.loads(given.first.read_text(encoding="utf-8"))
    metrics["iou"] = dict(zip(cameras.views, iou.tolist(), strict=True))
    with replacing(given.output) as part:
        part.write_text(json.dumps(metrics, indent=1) + "\n", encoding="utf-8")


def _read_last(path: Path) -> dict[str, str]:
    """The last row of a table, which has one."""
    with path.open(encoding="utf-8", newline="") as file:
        *_, last = csv.DictReader(file)
    return last


def _compare(
    mesh: trimesh.Trimesh, truth: trimesh.Trimesh, laid: bool
) -> dict[str, bool | float | dict | None]:
    """Compare a mesh to the truth, after it was ``laid`` on it if that is asked for."""
    # What only a truth needs: libraries that take half a second of a run without one.
    from silmesh.ground_truth import compare_to_truth
    from silmesh.registration import align

    if not laid:
        return compare_to_truth(mesh, truth)
    found = align(mesh, truth)
    moved = trimesh.Trimesh(found.apply(mesh.vertices), mesh.faces, process=False)
    placement = {"scale": found.scale, "R": found.R.tolist(), "t": found.t.tolist()}
    told = {"aligned": True, "scale": found.scale, "placement": placement}
    return told | compare_to_truth(moved, truth)


if __name__ == "__main__":
    run(main)
