r"""What each part of the preset fast buys: the same fit with one part left out at a time, as JSON.

python benchmarks/ablation.py results/moisturiser/stages/scenes/256-pad-mask-calibrate --holdout 6
python benchmarks/ablation.py results/plane/stages/scenes/64-pad-alpha-file_* --shape sphere
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch
import trimesh

from silmesh.evaluation.metrics import summarise_iou
from silmesh.fitting import softras
from silmesh.fitting.fast import Fast
from silmesh.fitting.loop import Procedure, run
from silmesh.geometry.camera import Cameras
from silmesh.geometry.mesh_files import to_tensors
from silmesh.geometry.remeshing import even_length, remesh
from silmesh.geometry.silhouette_iou import silhouette_iou
from silmesh.geometry.visual_hull import carve
from silmesh.scene.scene import SILHOUETTES, read_scene
from silmesh.settings.fit import FastFit, FastWeights, SoftRasFit
from silmesh.shapes.sphere import unit_sphere
from silmesh.silhouettes import read_silhouettes
from silmesh.views import held_out

PARTS = {
    "all": {},
    "cameras as they are": {"refine_cameras": False},
    "vertices each for itself": {"smoothing": 0.0},
    "the finest level only": {"coarse_to_fine": False},
    "all views in a step": {"batch": 0},
    "edges as they come": {"remesh": False},
    "parts inside out": {"untangle": False},
    "no smoothness terms": {"weights": FastWeights(laplacian=0, flatten=0)},
}
LEVEL = 0.13  # the IoU loss at which the report's procedure ends on its moisturiser
THIN = 15.0  # degrees


def make_first(shape: str, cameras: Cameras, seen: np.ndarray, verts: int) -> trimesh.Trimesh:
    """A sphere in the middle, or the even hull, at unit size."""
    if shape == "sphere":
        return unit_sphere(verts)
    points, faces = carve(seen, cameras, 64).surface()
    length = even_length(points, faces, 2 * verts)
    points, faces = remesh(points, faces, length)
    return trimesh.Trimesh(2 * points, faces, process=False)


def measure(
    procedure: type[Procedure],
    first: trimesh.Trimesh,
    scene: tuple,
    told: FastFit | SoftRasFit,
    out: list[int],
) -> dict:
    """One fit: how good, how long."""
    cameras, seen = scene
    kept = sorted(set(range(len(cameras))) - set(out))
    silhouettes = torch.tensor(seen[kept], dtype=torch.float32)
    wall, cpu = time.perf_counter(), time.process_time()
    fit = procedure(*to_tensors(first), cameras.select(kept), silhouettes, told)
    records = run(fit)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    refined = fit.correct(cameras, kept)
    iou = silhouette_iou(fit.verts, fit.faces, refined, seen, told.sigma_at(seen.shape[1]))
    mesh = trimesh.Trimesh(fit.verts.numpy(), fit.faces.numpy(), process=False)
    angles = np.degrees(mesh.face_angles).min(axis=1)
    return summarise_iou(iou, out) | {
        "steps": len(records),
        "seconds": wall,
        "cpu_seconds": cpu,
        "passed_after": next((r.seconds for r in records if r.iou_loss < LEVEL), None),
        "faces": len(mesh.faces),
        "thin": float((angles < THIN).mean()),
        "closed": mesh.is_watertight,
    }


def main() -> None:
    """Print one JSON object: the measures of every part left out."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("scene", type=Path, help="folder of a scene")
    args.add_argument("--shape", choices=["hull", "sphere"], default="hull")
    args.add_argument("--vertices", type=int, default=1352)
    args.add_argument("--holdout", type=int, default=0)
    args.add_argument("--softras", action="store_true", help="the report's fit, too, of a sphere")
    args.add_argument("--threads", type=int, default=torch.get_num_threads())
    given = args.parse_args()
    torch.set_num_threads(given.threads)
    cameras, _, _ = read_scene(given.scene)
    seen = read_silhouettes(given.scene / SILHOUETTES, cameras.views)
    out = held_out(len(cameras), given.holdout)
    kept = sorted(set(range(len(cameras))) - set(out))
    first = make_first(given.shape, cameras.select(kept), seen[kept], given.vertices)
    rows = {
        name: measure(Fast, first, (cameras, seen), FastFit(**part), out)
        for name, part in PARTS.items()
    }
    if given.softras:
        sphere = unit_sphere(given.vertices)
        rows["softras"] = measure(softras.SoftRas, sphere, (cameras, seen), SoftRasFit(), out)
    print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
