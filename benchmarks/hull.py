"""How long carving takes, and the initial mesh that it ends in: JSON.

python benchmarks/hull.py results/moisturiser/stages/scenes/256-pad-mask-calibrate
"""

import argparse
import json
import resource
import statistics
import time
from pathlib import Path

import torch

from silmesh.geometry.overlap import mean_iou
from silmesh.geometry.visual_hull import carve
from silmesh.scene.scene import SILHOUETTES, read_scene
from silmesh.settings.init import Init
from silmesh.shapes.downsample import render
from silmesh.shapes.initial import make_initial_mesh
from silmesh.silhouettes import read_silhouettes

REPEATS = 5


def main() -> None:
    """Print what was measured."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("scene", type=Path)
    args.add_argument("--resolutions", type=int, nargs="+", default=[128, 256])
    args.add_argument("--vertices", type=int, default=1352)
    args.add_argument("--threads", type=int, default=2)
    given = args.parse_args()
    torch.set_num_threads(given.threads)
    cameras, _, _ = read_scene(given.scene)
    silhouettes = read_silhouettes(given.scene / SILHOUETTES, cameras.views)
    carve(silhouettes, cameras, 16)  # compiles
    result = {"views": len(cameras), "size": silhouettes.shape[1], "carve": {}}
    for resolution in given.resolutions:
        wall, cpu = [], []
        for _ in range(REPEATS):
            start = time.perf_counter(), time.process_time()
            carve(silhouettes, cameras, resolution)
            wall.append(time.perf_counter() - start[0])
            cpu.append(time.process_time() - start[1])
        result["carve"][resolution] = {
            "seconds": statistics.median(wall),
            "cpu_seconds": statistics.median(cpu),
        }
    start = time.perf_counter()
    mesh = make_initial_mesh(Init(shape="hull", vertices=given.vertices), silhouettes, cameras).mesh
    result["initial_mesh_seconds"] = time.perf_counter() - start
    mesh.apply_scale(0.5)
    result["iou"] = mean_iou(render(mesh, cameras, silhouettes.shape[1:]), silhouettes)
    result["faces"] = len(mesh.faces)
    result["megabytes"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
