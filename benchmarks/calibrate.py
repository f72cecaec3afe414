r"""How well cameras are found from silhouettes, on made-up objects whose cameras are known: JSON.

python benchmarks/calibrate.py --cases 12 --views 72 36 12
python benchmarks/calibrate.py --cases 6 --first 100 --rounds plain unequal three uneven
python benchmarks/calibrate.py --cases 0 \
    --silhouettes results/moisturiser/stages/silhouettes/256-pad-mask
"""

import argparse
import json
import math
import time
from itertools import chain, product
from pathlib import Path

import numpy as np
import torch
from photographed import measure_fit, reconstruct_silhouettes

from silmesh.cameras.calibrate import Calibration, attempt_calibration, calibrate
from silmesh.cameras.turntable import orbit_cameras, turntable_cameras
from silmesh.geometry.camera import Cameras
from silmesh.geometry.silhouette_iou import coherence
from silmesh.geometry.visual_hull import carve
from silmesh.naming import natural_key
from silmesh.scene.scene import find_similarity
from silmesh.silhouettes import read_silhouettes
from silmesh.softras import soft_silhouettes
from silmesh.synthetic.dataset import make_object

# Rounds: elevation, views and arc of each, in degrees.
TWO = ((5, 18, 360), (40, 18, 360))
ROUNDS = {
    "plain": TWO,
    "unequal": ((8, 24, 360), (45, 12, 360)),
    "three": ((5, 16, 360), (30, 16, 360), (55, 12, 360)),
    "half": ((5, 14, 180), (40, 14, 180)),
    "repeated": ((5, 19, 380), (40, 19, 380)),
    "uneven": TWO,
    "wrong": TWO,
}
UNEVEN = 1.0  # degrees: standard deviation of the steps' errors in "uneven"
WRONG = 4  # silhouettes of the second round that lack their left half in "wrong"
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


def random_rounds(kind: str, size: int, random: np.random.Generator) -> tuple[Cameras, list[dict]]:
    """Cameras of several rounds about one axis, each moved by hand, and what they are."""
    tan = math.tan(math.radians(random.uniform(8, 15)))
    direction, truth, parts = random.choice([-1, 1]), [], []
    for elevation, count, arc in ROUNDS[kind]:
        phase, nearer = random.uniform(0, 360), random.uniform(0.95, 1.05)
        errors = random.normal(0, UNEVEN, count) if kind == "uneven" else np.zeros(count)
        angles = phase + direction * arc / count * np.arange(count) + errors
        same = torch.ones(count, dtype=torch.float64)
        names = [f"v{sum(t['views'] for t in truth) + i:03d}" for i in range(count)]
        far = 0.8 / tan * nearer
        part = orbit_cameras(names, size, far * same, elevation * same, torch.as_tensor(angles))
        t = part.t + torch.tensor([*random.uniform(-0.04, 0.04, 2), 0.0], dtype=torch.float64)
        parts.append((part.R, t))
        truth.append({"elevation": elevation, "views": count})
    count = sum(one["views"] for one in truth)
    K = torch.eye(3, dtype=torch.float64)
    K[0, 0] = K[1, 1] = size / 2 / tan
    K[:2, 2] = size / 2
    R, t = (torch.cat(each) for each in zip(*parts, strict=True))
    names = tuple(f"v{i:03d}" for i in range(count))
    return Cameras(names, torch.full((count, 2), size), K.repeat(count, 1, 1), R, t), truth


def run_rounds(kind: str, seed: int, size: int) -> dict:
    """Several rounds of one of the objects, of which nothing is told."""
    random = np.random.default_rng(seed)
    cameras, truth = random_rounds(kind, size, random)
    name = OBJECTS[seed % len(OBJECTS)]
    seen = render(name, cameras)
    wrong = set()
    if kind == "wrong":
        first, last = truth[0]["views"], len(seen)
        wrong = {int(i) for i in random.choice(np.arange(first, last), WRONG, replace=False)}
        seen[list(wrong), :, : size // 2] = False
    start = time.process_time()
    attempt = attempt_calibration(seen, cameras.views)
    case = {"kind": kind, "object": name, "cpu_seconds": time.process_time() - start}
    if attempt.cameras is None:
        return case | {"refused": attempt.refusal}
    right = [i for i in range(len(seen)) if i not in wrong]
    normalised = attempt.cameras.in_world_of(find_similarity(attempt.cameras, seen)).select(right)
    hull = coherence(carve(seen[right], normalised), normalised, seen[right])
    named = {int(view[1:]) for view in attempt.figures["disagreeing"]}
    return case | {
        **judge_rounds(attempt.figures.get("rounds", []), truth),
        "hull_iou": float(hull.mean()),
        "rms": attempt.figures["rms"],
        "wrong_named": len(wrong & named),
        "right_named": len(named - wrong),
    }


def judge_rounds(found: list[dict], truth: list[dict]) -> dict:
    """Which rounds were found, and how far their elevations are off if they are as taken."""
    elevations = [one["estimates"]["elevation"]["value"] for one in found]
    as_taken = [len(one["views"]) for one in found] == [one["views"] for one in truth]
    errors = [abs(e - one["elevation"]) for e, one in zip(elevations, truth, strict=False)]
    return {
        "views": [len(one["views"]) for one in found],
        "as_taken": as_taken,
        "elevations": elevations,
        "error": max(errors) if as_taken else None,
    }


def fit_rounds(kind: str, seed: int, size: int) -> dict:
    """What a run with a fitted mesh comes to, from photographs of several rounds."""
    cameras, truth = random_rounds(kind, size, np.random.default_rng(seed))
    name = OBJECTS[seed % len(OBJECTS)]
    seen = render(name, cameras)
    start = time.process_time()
    made = reconstruct_silhouettes(cameras.views, seen)
    seconds = time.process_time() - start
    rounds = made.scene.notes["figures"].get("rounds", [])
    case = {"kind": kind, "object": name, "cpu_seconds": seconds}
    return case | judge_rounds(rounds, truth) | measure_fit(made)


def summarise_rounds(cases: list[dict]) -> dict:
    """What was found, and the errors of the elevations where the rounds are as they were taken."""
    found = [case for case in cases if "refused" not in case]
    errors = [case["error"] for case in found if case["as_taken"]]
    return {
        "cases": len(cases),
        "refused": [f"{c['object']}: {c['refused']}" for c in cases if "refused" in c],
        "as_taken": len(errors),
        "error": {"median": float(np.median(errors)), "worst": max(errors)} if errors else None,
        "hull_iou": {"median": float(np.median([c["hull_iou"] for c in found])),
                     "worst": min(c["hull_iou"] for c in found)} if found else None,
        "wrong_named": sum(c["wrong_named"] for c in found),
        "right_named": sum(c["right_named"] for c in found),
        "cpu_seconds": {"median": float(np.median([c["cpu_seconds"] for c in cases])),
                        "worst": max(c["cpu_seconds"] for c in cases)},
    }  # fmt: skip


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


def measure_rounds(given: argparse.Namespace) -> dict:
    """Each kind of rounds, with every case if that is asked for."""
    kinds = {
        kind: [run_rounds(kind, given.first + i, given.size) for i in range(given.cases)]
        for kind in given.rounds
    }
    every = {"cases": list(chain.from_iterable(kinds.values()))} if given.details else {}
    return {kind: summarise_rounds(cases) for kind, cases in kinds.items()} | every


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
    args.add_argument("--rounds", nargs="+", choices=ROUNDS, default=[], help="several, not one")
    args.add_argument("--fit", action="store_true", help="runs of rounds, with the fit of a mesh")
    args.add_argument("--details", action="store_true", help="every case")
    given = args.parse_args()
    torch.set_num_threads(given.threads)
    if given.fit:
        for kind, i in product(given.rounds, range(given.cases)):
            print(json.dumps(fit_rounds(kind, given.first + i, given.size)), flush=True)
        return
    if given.rounds:
        print(json.dumps(measure_rounds(given), indent=1))
        return
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
