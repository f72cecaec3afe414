r"""How near `fast` comes to a true mesh, beside the visual hull of the same silhouettes: JSON.

python benchmarks/volumes.py bear pot ../shared/data/scans/shampoo.glb:1

An object is one of the made-up ones, or a scan's file and the axis that is up in it. Half of the
views look down on it by 10 degrees and half by 40, their cameras are known, and their silhouettes
are cast, not rasterised. The hull is of 256 samples a side.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch
import trimesh
from scenery import read_scan, stand_upright

from silmesh.cameras.turntable import orbit_cameras
from silmesh.evaluation.ground_truth import compare_to_truth
from silmesh.evaluation.mesh_quality import measure_quality
from silmesh.fitting.fast import Fast
from silmesh.fitting.loop import run
from silmesh.geometry.camera import Cameras
from silmesh.geometry.mesh_files import to_tensors
from silmesh.geometry.silhouette_iou import silhouette_iou
from silmesh.geometry.visual_hull import carve
from silmesh.report.pictures import camera_of, trace
from silmesh.settings.fit import FastFit
from silmesh.settings.init import Init
from silmesh.shapes.initial import make_initial_mesh
from silmesh.synthetic.dataset import make_object
from silmesh.synthetic.layout import OBJECTS
from silmesh.synthetic.orbit import DISTANCE

ELEVATIONS = (10.0, 40.0)
RESOLUTION = 256


def read_truth(name: str) -> trimesh.Trimesh:
    """The true mesh, within the sphere that holds the object."""
    if name in OBJECTS:
        return stand_upright(make_object(name))
    path, _, up = name.partition(":")
    return stand_upright(read_scan(Path(path)), int(up or 1))


def two_rings(views: int, size: int) -> Cameras:
    """Cameras in turn on two levels, all around."""
    turn = torch.arange(views, dtype=torch.float64)
    elevation = torch.tensor(ELEVATIONS, dtype=torch.float64)[torch.arange(views) % 2]
    names = [f"v{i:02}" for i in range(views)]
    return orbit_cameras(
        names, size, torch.full_like(turn, DISTANCE), elevation, 360 / views * turn
    )


def cast(mesh: trimesh.Trimesh, cameras: Cameras) -> np.ndarray:
    """What one ray through each pixel's centre meets: [views, size, size] bool."""
    return np.stack([trace(mesh, camera_of(cameras, view)).mask for view in range(len(cameras))])


def fit(seen: np.ndarray, cameras: Cameras, size: int) -> tuple[trimesh.Trimesh, dict]:
    """The preset with its defaults, from the hull."""
    told = FastFit()
    start = time.perf_counter()
    first = make_initial_mesh(Init(shape="hull"), seen, cameras).mesh
    made = time.perf_counter()
    silhouettes = torch.tensor(seen, dtype=torch.float32)
    procedure = Fast(*to_tensors(first), cameras, silhouettes, told)
    steps = len(run(procedure))
    mesh = trimesh.Trimesh(procedure.verts.numpy(), procedure.faces.numpy(), process=False)
    refined = procedure.correct(cameras, list(range(len(cameras))))
    iou = silhouette_iou(procedure.verts, procedure.faces, refined, seen, told.sigma_at(size))
    figures = {"first_seconds": made - start, "fit_seconds": time.perf_counter() - made}
    return mesh, {"steps": steps, "iou": float(iou.mean()), **figures, **measure_quality(mesh)}


def measure(name: str, views: int, size: int, meshes: Path | None) -> dict:
    """The fitted mesh and the hull, each against the truth."""
    truth, cameras = read_truth(name), two_rings(views, size)
    seen = cast(truth, cameras)
    hull = trimesh.Trimesh(*carve(seen, cameras, RESOLUTION).surface(), process=False)
    mesh, told = fit(seen, cameras, size)
    if meshes:
        meshes.mkdir(parents=True, exist_ok=True)
        for kind, body in (("fast", mesh), ("hull", hull), ("truth", truth)):
            body.export(meshes / f"{Path(name.partition(':')[0]).stem}-{kind}.ply")
    compared = {"fast": compare_to_truth(mesh, truth), "hull": compare_to_truth(hull, truth)}
    return {**told, "vertices": len(mesh.vertices), **compared}


def main() -> None:
    """Print one JSON object."""
    args = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    args.add_argument("objects", nargs="*", default=OBJECTS, help="names, or scans as FILE:AXIS")
    args.add_argument("--views", type=int, default=36)
    args.add_argument("--size", type=int, default=512)
    args.add_argument("--threads", type=int, default=2)
    args.add_argument("--meshes", type=Path, help="folder to write them to")
    given = args.parse_args()
    torch.set_num_threads(given.threads)
    rows = {n: measure(n, given.views, given.size, given.meshes) for n in given.objects}
    print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
