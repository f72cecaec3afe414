"""Check and time the GPU's kernel against plain torch and SoftRas's own code; print JSON.

    python benchmarks/gpu.py [--softras SoftRas] [--seconds 300] > gpu.json

It needs a GPU, torch with CUDA, Triton, numpy, scipy and numba, and of this project only ``src``
and ``tests/support``, which it finds beside itself (``fit`` needs trimesh and libigl, too).
``--softras`` names a clone of Soft Rasterizer (github.com/ShichenLiu/SoftRas), whose CUDA kernel is
then built with nvcc (a minute) with the names that torch has since renamed; without it, or where it
does not build, a line says so. Parts are done in the order of their weight until ``--seconds`` are
over.

The scene is that of ``benchmarks/rasteriser.py``: a sphere that fills two thirds of the frame,
turned a little for each view. Times are in milliseconds of the whole batch, by the GPU's own clock:
median and quartiles. ``TRITON_INTERPRET=1`` tries the script without a GPU, on tiny scenes.
"""

import argparse
import json
import os
import re
import runpy
import statistics
import subprocess
import sys
import tempfile
import time
import types
import warnings
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "tests" / "support"), str(ROOT / "benchmarks")]

import numpy as np  # noqa: E402
import torch  # noqa: E402
from rasteriser import make_sphere  # noqa: E402
from torch import Tensor  # noqa: E402

from silmesh.cameras.turntable import turntable_cameras  # noqa: E402
from silmesh.softras import reference  # noqa: E402

GPU = torch.cuda.is_available()
ON = torch.device("cuda" if GPU else "cpu")
SIGMA = 1e-4
LAST = 0.03  # pixels: the root of sigma at the end of a fit
GOAL = 1.0  # milliseconds, forward and backward, of BASE
BASE = (
    {"views": 72, "pixels": 256, "faces": 3840} if GPU else {"views": 2, "pixels": 32, "faces": 20}
)
SWEEPS = {
    "faces": [1280, 3840, 20_000, 100_000],
    "views": [1, 8, 36, 72, 288],
    "pixels": [64, 128, 256, 512, 1024],
}
BLOCKS = [
    (block, faces, warps) for warps in (1, 2) for block in (32, 64, 128) for faces in (1, 4, 8)
]
RENAMED = (  # by torch since SoftRas was written
    (r"#include <torch/torch\.h>", "#include <torch/extension.h>"),
    (r"\.type\(\)\.is_cuda\(\)", ".is_cuda()"),
    (r"(AT_DISPATCH_FLOATING_TYPES\(\s*\w+)\.type\(\)", r"\1.scalar_type()"),
    (r"\.data<", ".data_ptr<"),
)


def make_scene(views: int, pixels: int, faces: int) -> tuple[Tensor, Tensor, Tensor]:
    """Points, triangles and a gradient with respect to alpha."""
    verts, triangles = make_sphere(faces)
    cameras = turntable_cameras([f"{i}" for i in range(views)], pixels, 2.732, 0, 5)
    points = cameras.project(torch.tensor(verts, dtype=torch.float32)).to(ON)
    upstream = torch.rand(views, pixels, pixels, generator=torch.Generator().manual_seed(0))
    return points.contiguous(), triangles.to(ON), upstream.to(ON)


class Clock:
    """Moments on the GPU's own clock, or on the CPU's."""

    def __init__(self):
        if GPU:
            self.event = torch.cuda.Event(enable_timing=True)
            self.event.record()
        self.seconds = time.perf_counter()

    def until(self, other: "Clock") -> float:
        """Milliseconds."""
        return self.event.elapsed_time(other.event) if GPU else 1e3 * (other.seconds - self.seconds)


def time_it(render: Callable, points: Tensor, upstream: Tensor, repeats: int) -> dict:
    """Milliseconds of forward, backward and both, and the most memory in MiB."""
    points = points.clone().requires_grad_()
    if GPU:
        torch.cuda.reset_peak_memory_stats()
    marks = []
    for _ in range(repeats + 3):  # the first three warm up
        points.grad = None
        start = Clock()
        alpha = render(points)
        middle = Clock()
        alpha.backward(upstream)
        marks.append((start, middle, Clock()))
    if GPU:
        torch.cuda.synchronize()
    times = [(a.until(b), b.until(c), a.until(c)) for a, b, c in marks[3:]]
    told = {}
    for name, column in zip(("forward", "backward", "both"), zip(*times, strict=True), strict=True):
        low, middle, high = np.percentile(column, [25, 50, 75])
        told[name] = {
            "median": round(float(middle), 4),
            "quartiles": [round(float(q), 4) for q in (low, high)],
        }
    if GPU:
        told["peak_mib"] = round(torch.cuda.max_memory_allocated() / 2**20, 1)
    return told


def by_kernel(triangles: Tensor, pixels: int, sigma: float) -> Callable:
    """What renders points by the kernel."""
    from silmesh.softras import gpu

    return lambda points: gpu.soft_silhouettes(points, triangles, (pixels, pixels), sigma)


def by_torch(triangles: Tensor, pixels: int, sigma: float) -> Callable:
    """What renders points by plain torch."""
    return lambda points: reference.soft_silhouettes(points, triangles, (pixels, pixels), sigma)


def check() -> dict:
    """How far alpha and the gradient are from plain torch's in float64, with the tests' bounds."""
    import soft_scenes as scenes

    from silmesh.softras import gpu

    cases = (
        scenes.SCENES
        if GPU
        else {"sphere": lambda: (*scenes.make_sphere(9, (24, 24)), (24, 24), 1e-4)}
    )
    told = {}
    for name, make in cases.items():
        points, faces, size, sigma = make()
        clear = ~scenes.find_outlier_views(points, faces, size, sigma)
        upstream = torch.rand(clear.shape, generator=torch.Generator().manual_seed(1)) * clear
        results = []
        for module, dtype in ((gpu, torch.float32), (reference, torch.float64)):
            p = points.to(ON, dtype, copy=True).requires_grad_()
            alpha = module.soft_silhouettes(p, faces.to(ON), size, sigma)
            alpha.backward(upstream.to(ON, dtype))
            results.append((alpha.detach().cpu().double() * clear, p.grad.cpu().double()))
        (alpha, gradient), (true_alpha, true_gradient) = results
        off = float((alpha - true_alpha).abs().max())
        turned = float((gradient - true_gradient).norm() / true_gradient.norm())
        right = off < 1e-5 and turned < 1e-4
        told[name] = {"alpha": off, "gradient": turned, "right": right}
    return told


def count_visits(views: int = 8, pixels: int = 256, faces: int = 3840) -> dict:
    """Pixels looked at for a face, by 64 in its box and in the 16 x 16 tiles that it reaches."""
    verts, triangles = make_sphere(faces)
    cameras = turntable_cameras([f"{i}" for i in range(views)], pixels, 2.732, 0, 5)
    corners = cameras.project(torch.tensor(verts))[:, triangles]  # [views, faces, 3, 2]
    told = {}
    for name, sigma in (("report", SIGMA), ("last_level", (2 * LAST / pixels) ** 2)):
        reach = (reference.CUTOFF * sigma) ** 0.5 * pixels / 2
        low = (corners.amin(2) - reach - 0.5).ceil().clamp(0, pixels)
        high = (corners.amax(2) + reach - 0.5).floor().clamp(-1, pixels - 1)
        box = (high - low + 1).clamp(min=0).prod(-1)
        tiles = (high // 16 - low // 16 + 1).prod(-1) * (box > 0)
        steps = (box / 64).ceil()
        told[name] = {
            "of_the_box": round(float(box.mean()), 1),
            "by_boxes": round(float(64 * steps.mean()), 1),
            "by_tiles": round(float(256 * tiles.mean()), 1),
        }
    return told


def time_base() -> dict:
    """The goal's scene, at the report's sigma and at that of the last steps of a fit."""
    points, triangles, upstream = make_scene(**BASE)
    size, last = BASE["pixels"], (2 * LAST / BASE["pixels"]) ** 2
    told = {"scene": BASE, "goal_ms": GOAL}
    for name, sigma in (("report", SIGMA), ("last_level", last)):
        told[name] = time_it(by_kernel(triangles, size, sigma), points, upstream, 50 if GPU else 1)
    told["reached"] = bool(told["report"]["both"]["median"] <= GOAL)
    return told


def time_torch() -> dict:
    """Plain torch on the GPU, the same scene."""
    points, triangles, upstream = make_scene(**BASE)
    return time_it(by_torch(triangles, BASE["pixels"], SIGMA), points, upstream, 3)


def time_softras(path: Path | None) -> dict:
    """SoftRas's own CUDA kernel, the same scene, and how far its alpha is from ours."""
    if path is None:
        raise RuntimeError("no --softras; its source is not part of this project")
    points, triangles, upstream = make_scene(**BASE)
    render = by_softras(load_softras(path), triangles, BASE["pixels"])
    told = time_it(render, points, upstream, 5)
    ours = by_kernel(triangles, BASE["pixels"], SIGMA)(points)
    told["alpha_from_ours"] = float((render(points) - ours).abs().max())
    return told


def load_softras(path: Path) -> Callable:
    """The clone's own ``soft_rasterize``, without the rest of its package."""
    name = "soft_renderer.cuda.soft_rasterize"
    sys.modules[name] = kernel = build_softras(path)
    for package in ("soft_renderer.cuda", "soft_renderer"):
        sys.modules[package] = types.ModuleType(package)
    sys.modules["soft_renderer"].cuda = sys.modules["soft_renderer.cuda"]
    sys.modules["soft_renderer.cuda"].soft_rasterize = kernel
    wrapper = path / "soft_renderer" / "functional" / "soft_rasterize.py"
    return runpy.run_path(str(wrapper))["soft_rasterize"]


def build_softras(path: Path) -> types.ModuleType:
    """SoftRas's rasteriser, built from its two files with the names that torch has today."""
    from torch.utils.cpp_extension import load

    folder, sources = Path(tempfile.mkdtemp()), []
    for name in ("soft_rasterize_cuda.cpp", "soft_rasterize_cuda_kernel.cu"):
        text = (path / "soft_renderer" / "cuda" / name).read_text(encoding="utf-8")
        for old, new in RENAMED:
            text = re.sub(old, new, text)
        (folder / name).write_text(text, encoding="utf-8")
        sources.append(str(folder / name))
    return load("soft_rasterize", sources, build_directory=str(folder))


def by_softras(rasterise: Callable, triangles: Tensor, pixels: int) -> Callable:
    """What renders points by SoftRas: our cutoff is its own, and colours are not blended."""

    def render(points: Tensor) -> Tensor:
        x, y = (2 / pixels * points - 1).unbind(-1)
        corners = torch.stack([x, -y, torch.full_like(x, 2.0)], dim=-1)[:, triangles]
        textures = corners.new_ones(*corners.shape[:2], 1, 3)
        told = {"sigma_val": SIGMA, "aggr_func_rgb": "hard"}
        return rasterise(corners.flatten(2).contiguous(), textures, pixels, **told)[:, 3]

    return render


def time_blocks() -> list[dict]:
    """Other numbers of pixels at once, faces a program and threads, the fastest first."""
    from silmesh.softras import gpu

    points, triangles, upstream = make_scene(**BASE)
    usual, rows = (gpu.BLOCK, gpu.FACES, gpu.WARPS), []
    for gpu.BLOCK, gpu.FACES, gpu.WARPS in BLOCKS if GPU else BLOCKS[:1]:
        render = by_kernel(triangles, BASE["pixels"], SIGMA)
        told = time_it(render, points, upstream, 20 if GPU else 1)
        named = {"block": gpu.BLOCK, "faces": gpu.FACES, "warps": gpu.WARPS}
        rows.append(
            named | {part: told[part]["median"] for part in ("forward", "backward", "both")}
        )
    gpu.BLOCK, gpu.FACES, gpu.WARPS = usual
    return sorted(rows, key=lambda row: row["both"])


def sweep(name: str) -> dict:
    """One size after another, and the exponent p of time ~ size^p over the larger half."""
    rows = []
    for size in SWEEPS[name] if GPU else [BASE[name], 2 * BASE[name]]:
        scene = BASE | {name: size}
        points, triangles, upstream = make_scene(**scene)
        render = by_kernel(triangles, scene["pixels"], SIGMA)
        rows.append(scene | time_it(render, points, upstream, 20 if GPU else 1))
    half = rows[-3:]
    sizes = [row[name] ** (2 if name == "pixels" else 1) for row in half]
    slope = np.polyfit(np.log(sizes), np.log([row["both"]["median"] for row in half]), 1)[0]
    return {"rows": rows, "growth": round(float(slope), 2)}


def time_fit() -> dict:
    """Milliseconds of a step of the fit of 12 of 72 views, and how often one waits for the GPU."""
    from silmesh.fitting.fast import Fast
    from silmesh.settings.fit import FastFit

    verts, triangles = make_sphere(BASE["faces"])
    cameras = turntable_cameras([f"{i}" for i in range(BASE["views"])], BASE["pixels"], 2.732, 0, 5)
    points = cameras.project(torch.tensor(0.9 * verts, dtype=torch.float32)).to(ON)
    size = BASE["pixels"], BASE["pixels"]
    if GPU:
        seen = by_kernel(triangles.to(ON), size[0], SIGMA)(points) > 0.5
    else:
        seen = reference.soft_silhouettes(points, triangles, size, SIGMA) > 0.5
    settings = FastFit(
        renderer="gpu", iterations=10_000, coarse_to_fine=False, remesh=False, untangle=False
    )
    template = torch.tensor(2 * verts, dtype=torch.float32, device=ON)
    fit = Fast(template, triangles.to(ON), cameras, seen.float(), settings)
    seconds, steps = [], 100 if GPU else 1
    for _ in range(steps):
        start = time.perf_counter()
        fit.step()  # which ends with a number from the GPU
        seconds.append(1e3 * (time.perf_counter() - start))
    return {
        "views_a_step": 12,
        "median_ms": round(statistics.median(seconds[steps // 5 :]), 3),
        "waits_a_step": count_waits(fit),
    }


def count_waits(fit) -> float | None:
    """How often a step asks the GPU for an answer; one is that of the losses."""
    if not GPU:
        return None
    torch.cuda.set_sync_debug_mode("warn")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        for _ in range(10):
            fit.step()
    torch.cuda.set_sync_debug_mode("default")
    return sum("synchroniz" in str(warning.message) for warning in said) / 10


def describe_machine() -> dict:
    """What the times hang on."""
    import triton

    asked = ["git", "describe", "--always", "--dirty"]
    said = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=False)
    return {
        "gpu": torch.cuda.get_device_name() if GPU else None,
        "cuda": torch.version.cuda,
        "torch": torch.__version__,
        "triton": triton.__version__,
        "commit": said.stdout.strip() or None,
    }


def main() -> None:
    """Do the parts in turn, as long as there is time."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--softras", type=Path, help="a clone of Soft Rasterizer")
    parser.add_argument("--seconds", type=float, default=300, help="no part begins after these")
    told = parser.parse_args()
    if not GPU and os.environ.get("TRITON_INTERPRET") != "1":
        sys.exit("gpu.py: torch finds no GPU here (TRITON_INTERPRET=1 tries the script without)")
    start, report = time.perf_counter(), {"machine": describe_machine()}
    parts: dict[str, Callable] = {
        "visits": count_visits,
        "check": check,
        "base": time_base,
        "fit": time_fit,
        "torch": time_torch,
        "blocks": time_blocks,
        **{f"sweep_{name}": lambda name=name: sweep(name) for name in SWEEPS},
        "softras": lambda: time_softras(told.softras),
    }
    for name, part in parts.items():
        began = time.perf_counter()
        if began - start > told.seconds:
            report[name] = {"skipped": "no time left"}
        else:
            try:
                report[name] = part()
            except Exception as error:  # one part's failure leaves the others their minutes
                report[name] = {"skipped": f"{type(error).__name__}: {error}"}
        took = time.perf_counter() - began
        skipped = report[name].get("skipped", "") if isinstance(report[name], dict) else ""
        print(f"{name}: {took:.1f} s {skipped}", file=sys.stderr)
    report["seconds"] = round(time.perf_counter() - start, 1)
    print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
