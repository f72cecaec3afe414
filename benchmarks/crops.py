r"""How well cameras are found of views that were cropped one by one, scaled or not: JSON.

python benchmarks/crops.py --objects bear plane --views 72 --elevations 0 15 30 --crops scaled
python benchmarks/crops.py --meshes shared/data/scans/*.glb --crops window scaled --margins 0 0.1
"""

import argparse
import json
import math
import time
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
import torch
import trimesh
from photographed import measure_fit, reconstruct_silhouettes

from silmesh.cameras.calibrate import attempt_calibration
from silmesh.cameras.turntable import orbit_cameras
from silmesh.geometry.camera import Cameras
from silmesh.scene.agreement import normalise
from silmesh.softras import soft_silhouettes
from silmesh.synthetic.dataset import make_object

OBJECTS = ("apricot", "bear", "bottle", "plane", "pot", "tube")
HALF_ANGLE = 19.8  # degrees over half of the longer side: a lens of 50 mm on film of 36 mm
FILLS = 0.8  # of the photograph's side that the object spanned before the crop, about


def load_mesh(name: str) -> tuple[torch.Tensor, torch.Tensor]:
    """Vertices [n, 3], in the sphere of radius 0.5, and faces of a made-up object or of a file."""
    mesh = trimesh.load(name, force="mesh") if "." in name else make_object(name)
    points = np.asarray(mesh.vertices) - np.asarray(mesh.bounds).mean(axis=0)
    points /= 2 * np.linalg.norm(points, axis=1).max()
    return torch.tensor(points), torch.tensor(np.asarray(mesh.faces), dtype=torch.int64)


def turn(
    count: int, elevation: float, half_angle: float, off: tuple[float, float], arc: float = 360.0
) -> Cameras:
    """Cameras around an axis that passes beside the object's middle, of photographs of side 1."""
    same = torch.ones(count, dtype=torch.float64)
    distance = 0.5 / math.tan(math.radians(half_angle)) / FILLS
    angles = arc / count * torch.arange(count, dtype=torch.float64)
    cameras = orbit_cameras(
        [f"v{i:02d}" for i in range(count)], 1, distance * same, elevation * same, angles
    )
    K = cameras.K.clone()
    K[:, 0, 0] = K[:, 1, 1] = 0.5 / math.tan(math.radians(half_angle))
    centre = torch.tensor([off[0], 0.0, off[1]], dtype=torch.float64)
    t = cameras.t + cameras.R @ centre
    return Cameras(cameras.views, cameras.sizes, K, cameras.R, t)


def crop(
    cameras: Cameras, points: torch.Tensor, size: int, scaled: bool, margin: float
) -> tuple[Cameras, np.ndarray]:
    """The cameras of the working images of photographs cropped to the object's box.

    Args:
        scaled: every crop is a square of the same pixels; otherwise the box in the pixels that the
            photographs had
        margin: around the box, in parts of its longer side
    Returns:
        the cameras, and the photographs' frames in the working images [views, 4]
    """
    seen = cameras.project(points)
    low, high = seen.amin(dim=1), seen.amax(dim=1)
    longest = (high - low).amax(dim=1, keepdim=True)
    low, high = low - margin * longest, high + margin * longest
    side, middle = (high - low).amax(dim=1), (low + high) / 2
    if not scaled:  # whole pixels of a photograph, then the working image's own scale
        original = 4 * size
        pixels = ((high - low) * original).ceil()
        side = pixels.amax(dim=1) / original
    maps = torch.eye(3, dtype=torch.float64).repeat(len(cameras), 1, 1)
    maps[:, 0, 0] = maps[:, 1, 1] = size / side
    maps[:, :2, 2] = size / 2 - middle * (size / side)[:, None]
    sizes = torch.full((len(cameras), 2), size)
    frames = np.tile([0, 0, size, size], (len(cameras), 1))
    if not scaled:
        extent = (pixels / pixels.amax(dim=1, keepdim=True) * size).round().numpy().astype(int)
        first = (size - extent) // 2
        frames = np.hstack([first, first + extent])
    return cameras.in_pixels_of(maps, sizes), frames


def render(cameras: Cameras, points: torch.Tensor, faces: torch.Tensor) -> np.ndarray:
    """Silhouettes, almost sharp: [views, size, size] bool."""
    size = tuple(cameras.sizes[0].tolist())
    seen = cameras.project(points).float()
    return (soft_silhouettes(seen, faces, size, sigma=1e-8) > 0.5).numpy()


def make_case(
    name: str, count: int, elevation: float, kind: str, margin: float, size: int, half_angle: float
) -> tuple[np.ndarray, np.ndarray, Cameras]:
    """Silhouettes, frames and true cameras."""
    points, faces = load_mesh(name)
    around = turn(count, elevation, half_angle, (0.05, -0.03))
    cameras, frames = crop(around, points, size, kind == "scaled", margin)
    return render(cameras, points, faces), frames, cameras


def cases(given: argparse.Namespace) -> Iterator[tuple]:
    """All combinations that are asked for."""
    yield from product(
        [*given.objects, *given.meshes],
        given.views,
        given.elevations,
        given.crops,
        given.margins,
        given.half_angles,
    )


def find(seen: np.ndarray, frames: np.ndarray, cameras: Cameras, step: float | None) -> dict:
    """What ``calibrate`` finds of one case."""
    longest = (frames[:, 2:] - frames[:, :2]).max(axis=1)
    scales = np.repeat(cameras.K[:, :1, 0].numpy(), 2, axis=1)
    if (longest == longest[0]).all() and (frames == frames[0]).all():
        scales = np.ones_like(scales)  # all photographs are squares of one size
    start = time.perf_counter()
    attempt = attempt_calibration(seen, cameras.views, step=step, frames=frames, scales=scales)
    seconds = time.perf_counter() - start
    if attempt.cameras is None:
        return {"refused": attempt.refusal, "seconds": seconds}
    found = normalise(attempt.cameras, seen, frames=frames)
    estimates = attempt.figures["estimates"]
    return {
        "cropped": "crops" in attempt.figures,
        "coherence": found.overall,
        "coherence_least": float(found.coherence.min()),
        "elevation": [estimates["elevation"]["value"], estimates["elevation"]["sd"]],
        "disagreeing": len(attempt.figures["disagreeing"]),
        "seconds": seconds,
        "said": list(attempt.warnings),
    }


def fit_mesh(seen: np.ndarray, frames: np.ndarray, cameras: Cameras, step: float | None) -> dict:
    """What a run comes to, from photographs that show the silhouettes alone, cropped."""
    turntable = f",,{step:g}" if step else ""
    start = time.process_time()
    made = reconstruct_silhouettes(cameras.views, seen, frames, turntable=turntable)
    figures = made.scene.notes["figures"]
    elevation = figures["estimates"]["elevation"]
    return {
        "cropped": "crops" in figures,
        **measure_fit(made),
        "elevation": [elevation["value"], elevation["sd"]],
        "disagreeing": len(figures["disagreeing"]),
        "cpu_seconds": time.process_time() - start,
    }


def main() -> None:
    """Print what was measured, a line a case, and the least of all."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("--objects", nargs="*", default=["bear", "plane", "pot"])
    args.add_argument("--meshes", nargs="*", default=[], help="files of scans")
    args.add_argument("--views", nargs="+", type=int, default=[72])
    args.add_argument("--elevations", nargs="+", type=float, default=[15.0])
    args.add_argument("--crops", nargs="+", default=["scaled"], choices=["scaled", "window"])
    args.add_argument("--margins", nargs="+", type=float, default=[0.05])
    args.add_argument("--half-angles", nargs="+", type=float, default=[HALF_ANGLE])
    args.add_argument("--size", type=int, default=128)
    args.add_argument("--fit", action="store_true", help="runs, with the fit of a mesh")
    args.add_argument("--without-step", action="store_true", help="do not give the step")
    args.add_argument("--threads", type=int, default=1)
    given = args.parse_args()
    torch.set_num_threads(given.threads)
    least = {}
    for name, views, elevation, kind, margin, half_angle in cases(given):
        seen, frames, cameras = make_case(
            name, views, elevation, kind, margin, given.size, half_angle
        )
        step = None if given.without_step else 360 / views
        row = {
            "object": Path(name).stem, "views": views, "elevation_true": elevation, "crop": kind,
            "margin": margin, "half_angle": half_angle,
            "coherence_true": float(normalise(cameras, seen, frames=frames).overall),
        }  # fmt: skip
        judge = fit_mesh if given.fit else find
        row |= judge(seen, frames, cameras, step)
        print(json.dumps(row), flush=True)
        for key in ("coherence", "iou"):
            if key in row:
                least[key] = min(least.get(key, 1.0), row[key])
    print(json.dumps({"least": least}))


if __name__ == "__main__":
    main()
