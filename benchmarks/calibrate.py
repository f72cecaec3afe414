r"""How well cameras are found from silhouettes, on made-up objects whose cameras are known: JSON.

python benchmarks/calibrate.py --cases 12 --views 72 36 12
python benchmarks/calibrate.py --cases 0 \
    --silhouettes results/moisturiser/stages/silhouettes/256-pad-mask
"""

import argparse
import json
import math
import time
from pathlib import Path

import numpy as np
import torch

from silmesh.cameras.calibrate import Calibration, calibrate
from silmesh.cameras.turntable import orbit_cameras, turntable_cameras
from silmesh.geometry.camera import Cameras
from silmesh.geometry.silhouette_iou import coherence
from silmesh.geometry.visual_hull import carve
from silmesh.naming import natural_key
from silmesh.scene.scene import find_similarity
from silmesh.silhouettes import read_silhouettes
from silmesh.softras import soft_silhouettes
from silmesh.synthetic.dataset import make_object

OBJECTS = ("apricot", "bear", "bottle", "plane", "pot", "tube")


def random_turntable(
    count: int, size: int, random: np.random.Generator, jitter: float = 0.0
) -> tuple[Cameras, dict]:
    """Cameras that do not look at the axis, nor upright, and what they are.

    Args:
        jitter: standard deviation of the errors of their steps, in degrees
    """
    truth = {
        "elevation": random.uniform(0, 30),
        "roll": random.uniform(-2, 2),
        "half_angle": random.uniform(5, 20),
        "direction": int(random.choice([-1, 1])),
    }
    names = [f"v{i}" for i in range(count)]
    same = torch.ones(count, dtype=torch.float64)
    angles = truth["direction"] * 360 / count * torch.arange(count, dtype=torch.float64)
    if jitter:
        angles = angles + torch.as_tensor(random.normal(0, jitter, count))
    plain = orbit_cameras(names, size, 2.732 * same, truth["elevation"] * same, angles)
    roll, tan = math.radians(truth["roll"]), math.tan(math.radians(truth["half_angle"]))
    lean = torch.eye(3, dtype=torch.float64)
    lean[:2, :2] = torch.tensor(
        [[math.cos(roll), -math.sin(roll)], [math.sin(roll), math.cos(roll)]]
    )
    K = plain.K.clone()
    K[:, 0, 0] = K[:, 1, 1] = size / 2 / tan
    shift = random.uniform(-0.1, 0.1, 2) * 1.6  # of the image's side, which spans 1.6 at the axis
    t = torch.tensor([*shift, 0.8 / tan], dtype=torch.float64).repeat(count, 1)
    cameras = Cameras(plain.views, plain.sizes, K, lean @ plain.R, t)
    return cameras, truth


def render(name: str, cameras: Cameras) -> np.ndarray:
    """Silhouettes of a made-up object, almost sharp: [views, size, size] bool."""
    mesh = make_object(name)
    points = cameras.project(torch.tensor(np.asarray(mesh.vertices), dtype=torch.float64)).float()
    faces = torch.tensor(np.asarray(mesh.faces), dtype=torch.int64)
    size = int(cameras.sizes[0, 0])
    return (soft_silhouettes(points, faces, (size, size), sigma=1e-8) > 0.5).numpy()


def axis_at(cameras: Cameras, row: float) -> float:
    """The column at which the world's axis y passes a row of the image."""
    ends = torch.tensor([[0, -0.1, 0], [0, 0.1, 0]], dtype=torch.float64)
    (u0, v0), (u1, v1) = cameras.select([0]).project(ends)[0].tolist()
    return u0 + (row - v0) * (u1 - u0) / (v1 - v0)


def judge(found: Calibration, cameras: Cameras, truth: dict) -> dict:
    """Errors of what was found."""
    e = found.estimates
    return {
        "axis": abs(e["axis"].value - axis_at(cameras, found.row)),
        "elevation": abs(e["elevation"].value - truth["elevation"]),
        "roll": abs(e["roll"].value - truth["roll"]),
        "direction": bool(np.sign(e["step"].value) == truth["direction"]),
        "half_angle": abs(e["half_angle"].value - truth["half_angle"]),
    }


def run_case(seed: int, count: int, size: int, jitter: float) -> dict:
    """One random turntable with one of the objects."""
    cameras, truth = random_turntable(count, size, np.random.default_rng(seed), jitter)
    name = OBJECTS[seed % len(OBJECTS)]
    seen = render(name, cameras)
    start = time.perf_counter()
    found = calibrate(seen, cameras.views, step=360 / count)
    return {
        "object": name,
        "views": count,
        "truth": truth,
        "found": {k: [v.value, v.sd, v.status] for k, v in found.estimates.items()},
        "errors": judge(found, cameras, truth),
        "certain": found.direction_certain,
        "own_angles": bool(found.offsets.any()),
        "rms": found.rms,
        "seconds": time.perf_counter() - start,
    }


def summarise(cases: list[dict]) -> dict:
    """Errors of what was reported as found, in pixels and degrees and in standard deviations.

    The direction's rate is of the cases above 3 degrees of elevation that say it is certain.
    """
    errors = [case["errors"] for case in cases if case["found"]["elevation"][2] == "found"]
    high = [c["errors"]["direction"] for c in cases if c["truth"]["elevation"] > 3 and c["certain"]]
    ratios = np.array(
        [
            c["errors"][k] / c["found"][k][1]
            for c in cases
            for k in ("axis", "elevation", "roll", "half_angle")
            if c["found"][k][2] == "found"
        ]
    )
    spread = {
        k: {"median": float(np.median(v)), "worst": float(np.max(v))}
        for k in ("axis", "elevation", "roll")
        for v in [[e[k] for e in errors]]
    }
    seconds = float(np.median([case["seconds"] for case in cases]))
    return spread | {
        "open": [f"{c['object']} {c['truth']['elevation']:.0f}" for c in cases
                 if c["found"]["elevation"][2] == "open"],
        "own_angles": sum(c["own_angles"] for c in cases),
        "within_1_sd": float((ratios < 1).mean()),
        "within_2_sd": float((ratios < 2).mean()),
        "direction_rate": float(np.mean(high)),
        "direction_certain": len(high),
        "seconds": seconds,
    }  # fmt: skip


def measure_photographs(folder: Path, step: float) -> dict:
    """Coherence of real silhouettes with the report's cameras and with those found."""
    views = [path.stem for path in sorted(folder.glob("*.png"), key=natural_key)]
    seen = read_silhouettes(folder, views)
    level = turntable_cameras(views, seen.shape[1], 2.732, 0, step)
    before = coherence(carve(seen, level), level, seen)
    start = time.perf_counter()
    found = calibrate(seen, views, step=step)
    seconds = time.perf_counter() - start
    cameras = found.cameras.in_world_of(find_similarity(found.cameras, seen))
    after = coherence(carve(seen, cameras), cameras, seen)
    return {
        "coherence_report": float(before.mean()),
        "coherence": float(after.mean()),
        "coherence_least": float(after.min()),
        "found": {k: [v.value, v.sd, v.status] for k, v in found.estimates.items()},
        "direction_certain": found.direction_certain,
        "rms": found.rms,
        "largest_offset": float(np.abs(found.offsets).max()),
        "seconds": seconds,
        "warnings": found.warnings,
    }


def main() -> None:
    """Print what was measured."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("--cases", type=int, default=12)
    args.add_argument("--first", type=int, default=0, help="seed of the first case")
    args.add_argument("--jitter", type=float, default=0.0, help="of the steps, in degrees")
    args.add_argument("--views", type=int, nargs="+", default=[72, 36, 12])
    args.add_argument("--size", type=int, default=256)
    args.add_argument("--threads", type=int, default=2)
    args.add_argument("--silhouettes", type=Path, help="folder of real ones")
    args.add_argument("--step", type=float, default=5.0, help="of those, in degrees")
    args.add_argument("--details", action="store_true", help="every case")
    given = args.parse_args()
    torch.set_num_threads(given.threads)
    cases = [
        run_case(given.first + i, v, given.size, given.jitter)
        for v in given.views
        for i in range(given.cases)
    ]
    by_views = {v: [c for c in cases if c["views"] == v] for v in given.views}
    result = {str(v): summarise(some) for v, some in by_views.items() if some}
    if given.silhouettes:
        result["photographs"] = measure_photographs(given.silhouettes, given.step)
    print(json.dumps(result | ({"cases": cases} if given.details else {}), indent=1))


if __name__ == "__main__":
    main()
