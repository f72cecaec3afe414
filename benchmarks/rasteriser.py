"""Time the CPU rasteriser; print JSON.

    python benchmarks/rasteriser.py [--quick] > rasteriser.json

A sphere of radius 0.5 (the hull of a Fibonacci lattice) is seen from a distance of 2.732 with a
half-angle of 15 degrees, so it fills about 70 % of the frame's width, turned a little for each
view. One size is varied at a time around 2,700 faces, 256 x 256 pixels and 8 views. Times are in
milliseconds a view: median and quartiles of the repeats; ``both`` is forward and backward together.
``cpu`` is the processor time of both, summed over threads, which a busy machine disturbs less.
``growth`` holds the exponents p of time ~ size^p, fitted in logarithms. ``last_level`` is of 72
views at the sigma of a fit's last steps.
"""

import argparse
import json
import math
import os
import platform
import subprocess
import sys
import time
from pathlib import Path

import numba
import numpy as np
import torch
from scipy.spatial import ConvexHull

from silmesh.cameras.turntable import turntable_cameras
from silmesh.settings.fit import SOFTNESS
from silmesh.softras import soft_silhouettes

BASE = {"faces": 2700, "pixels": 256, "views": 8}
SWEEPS = {
    "faces": [1280, 2700, 3840, 20000],
    "pixels": [64, 128, 256, 512],
    "views": [1, 8, 72],
}
MEMORY = [(2700, 256, 72), (20000, 1024, 72)]  # faces, pixels, views
QUICK = {"faces": [1280, 2700], "pixels": [128, 256], "views": [1, 8]}


def make_sphere(faces: int) -> tuple[np.ndarray, torch.Tensor]:
    """Vertices [faces / 2 + 2, 3] and triangles of a sphere, counted by Euler's formula."""
    count = faces // 2 + 2
    i = np.arange(count) + 0.5
    polar, turn = np.arccos(1 - 2 * i / count), math.pi * (1 + math.sqrt(5)) * i
    verts = np.stack(
        [np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1
    )
    return 0.5 * verts, torch.tensor(ConvexHull(verts).simplices, dtype=torch.int64)


def measure(faces: int, pixels: int, views: int, repeats: int, sigma: float = 1e-4) -> dict:
    """Times in milliseconds a view of one scene."""
    verts, triangles = make_sphere(faces)
    cameras = turntable_cameras([f"{i}" for i in range(views)], pixels, 2.732, 0, 5)
    points = cameras.project(torch.tensor(verts, dtype=torch.float32)).requires_grad_()
    upstream = torch.rand(views, pixels, pixels, generator=torch.Generator().manual_seed(0))
    times = []
    for _ in range(repeats + 2):  # the first two warm up
        points.grad = None
        start, worked = time.perf_counter(), time.process_time()
        alpha = soft_silhouettes(points, triangles, (pixels, pixels), sigma)
        middle = time.perf_counter()
        alpha.backward(upstream)
        end = time.perf_counter()
        worked = time.process_time() - worked
        times.append((middle - start, end - middle, end - start, worked))
    quartiles = np.percentile(np.array(times[2:]) * 1e3 / views, [25, 50, 75], axis=0).T
    names = ("forward", "backward", "both", "cpu")
    return {
        "faces": len(triangles),
        "pixels": pixels,
        "views": views,
        "sigma": sigma,
        "repeats": repeats,
        **{
            name: {"median": round(q[1], 3), "quartiles": [round(q[0], 3), round(q[2], 3)]}
            for name, q in zip(names, quartiles, strict=True)
        },
    }


def fit_growth(name: str, rows: list[dict]) -> dict:
    """Exponents of the time of a whole call with one size."""
    sizes = np.array([row[name] ** 2 if name == "pixels" else row[name] for row in rows])
    exponents = {}
    for part in ("forward", "backward", "both", "cpu"):
        whole = [row[part]["median"] * row["views"] for row in rows]
        exponents[part] = round(float(np.polyfit(np.log(sizes), np.log(whole), 1)[0]), 2)
    return exponents


def read_peak_memory() -> float:
    """The most memory this process has held, in MiB (Linux: getrusage would count the parent's)."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


def measure_peak_memory(faces: int, pixels: int, views: int) -> dict:
    """How far one scene, forward and backward, raises the peak of a fresh process, in MiB."""
    code = (
        "from benchmarks.rasteriser import measure, read_peak_memory;"
        "measure(2700, 64, 8, 1);"
        "before = read_peak_memory();"
        f"measure({faces}, {pixels}, {views}, 1);"
        "print(before, read_peak_memory())"
    )
    root = Path(__file__).parents[1]
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=root, check=True, capture_output=True, text=True
    )
    before, after = map(float, done.stdout.split())
    return {
        "faces": faces,
        "pixels": pixels,
        "views": views,
        "raised_mib": round(after - before, 1),
        "whole_process_mib": round(after, 1),
        "alpha_itself_mib": round(views * pixels**2 * 4 / 2**20, 1),
    }


def describe_machine() -> dict:
    """What the times hang on."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        models = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        cpu = models[0].partition(":")[2].strip() if models else cpu
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=False,
    ).stdout.strip()
    return {
        "cpu": cpu,
        "cores": os.cpu_count(),
        "threads": torch.get_num_threads(),
        "commit": commit,
        "python": platform.python_version(),
        "torch": torch.__version__,
        "numba": numba.__version__,
        "numpy": np.__version__,
    }


def main() -> None:
    """Run the sweeps."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="fewer sizes and repeats")
    quick = parser.parse_args().quick
    start = time.perf_counter()
    measure(20, 16, 1, 1)
    report = {"machine": describe_machine(), "first_call_seconds": time.perf_counter() - start}
    report["sweeps"], report["growth"] = {}, {}
    for name, sizes in (QUICK if quick else SWEEPS).items():
        rows = [
            measure(**{**BASE, name: size}, repeats=7 if quick else 25 if size != 72 else 9)
            for size in sizes
        ]
        report["sweeps"][name] = rows
        report["growth"]["pixels (their number)" if name == "pixels" else name] = fit_growth(
            name, rows
        )
    sigma = (2 * SOFTNESS / BASE["pixels"]) ** 2
    report["last_level"] = measure(**{**BASE, "views": 72}, repeats=9, sigma=sigma)
    report["memory"] = [
        measure_peak_memory(*scene) for scene in MEMORY[: 1 if quick else len(MEMORY)]
    ]
    print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
