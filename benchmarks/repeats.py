"""What repeats to the byte: the same object under other kernels of the processor, as JSON.

python benchmarks/repeats.py photos/ --masks masks/ --size 128

Each run is whole, in a folder of its own. The first two are alike. The others choose kernels that
libraries choose by the processor, so one machine stands for several.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import igl
import numpy as np
import trimesh

KERNELS: dict[str, dict[str, str]] = {
    "again": {},
    "one core": {},
    "torch, no SIMD": {"ATEN_CPU_CAPABILITY": "default"},
    "torch, AVX2": {"ATEN_CPU_CAPABILITY": "avx2"},
    "numba, any x86-64": {"NUMBA_CPU_NAME": "generic"},
    "MKL, compatible": {"MKL_CBWR": "COMPATIBLE"},
    "OpenBLAS, Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "OpenBLAS, SkylakeX": {"OPENBLAS_CORETYPE": "SkylakeX"},
}
WHAT = {  # by patterns of its files in an object's results
    "silhouettes": "stages/silhouettes/*/*.png",
    "cameras": "stages/cameras/*/cameras.json",
    "initial mesh": "stages/first/*/first.ply",
    "mesh": "*/mesh.ply",
}
COMMAND = "from silmesh.cli.main import main; main()"
POINTS = 20_000  # on the surface, between which meshes are compared


def main() -> None:
    """Make the mesh under each choice of kernels, and compare with the first."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("photos", type=Path)
    args.add_argument("--masks", type=Path, required=True)
    args.add_argument("--size", type=int, default=128)
    given = args.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        first = make(given, Path(scratch) / "first", {})
        for i, (name, kernels) in enumerate(KERNELS.items()):
            cores = 1 if name == "one core" else 2
            other = make(given, Path(scratch) / str(i), kernels, cores)
            print(json.dumps({"run": name} | compare(first, other)), flush=True)


def make(given: argparse.Namespace, folder: Path, kernels: dict[str, str], cores: int = 2) -> Path:
    """Run the command: the folder of the object's results."""
    words = ["-c", COMMAND, given.photos, "--masks", given.masks, "--keep", folder]
    words += ["--size", given.size, "--cores", cores, "-o", folder.parent / "mesh.glb"]
    command = [sys.executable, *map(str, words)]
    subprocess.run(command, env=os.environ | kernels, check=True, capture_output=True)
    (metrics,) = folder.glob("results/*/*/metrics.json")
    return metrics.parents[1]


def compare(first: Path, other: Path) -> dict:
    """What is equal to the byte, how far the meshes are apart in their sizes, and the metrics."""
    said: dict = {}
    for name, pattern in WHAT.items():
        files = sorted(path.relative_to(first) for path in first.glob(pattern))
        said[name] = all((first / f).read_bytes() == (other / f).read_bytes() for f in files)
    a, b = (trimesh.load_mesh(next(f.glob("*/mesh.ply")), process=False) for f in (first, other))
    points = np.asarray(trimesh.sample.sample_surface(a, POINTS, seed=0)[0])
    apart = igl.point_mesh_squared_distance(points, np.asarray(b.vertices), np.asarray(b.faces))[0]
    apart = np.sqrt(apart) / np.linalg.norm(a.extents)
    metrics = json.loads(next(other.glob("*/metrics.json")).read_text(encoding="utf-8"))
    told = {name: round(metrics[name], 5) for name in ("iou_mean", "iou_min", "hull_iou_mean")}
    return said | {"mean": float(apart.mean()), "most": float(apart.max())} | told


if __name__ == "__main__":
    main()
