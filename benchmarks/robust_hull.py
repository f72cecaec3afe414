r"""How a hull bears wrong silhouettes: its volume IoU, which views it names, and its time: JSON.

python benchmarks/robust_hull.py bear pot --seeds 1 2 > robust_hull.json

Each made-up object is seen from one level by known cameras; its silhouettes are damaged, and the
hull of all of them and the robust hull are compared with the true mesh.
"""

import argparse
import json
import time
from collections.abc import Callable

import numpy as np
import torch
import trimesh
from damage import bite, swap
from scenery import stand_upright
from scipy.ndimage import map_coordinates

from silmesh.cameras.turntable import orbit_cameras
from silmesh.geometry.camera import Cameras
from silmesh.geometry.robust_hull import RobustHull, robust_carve
from silmesh.geometry.visual_hull import Hull, carve
from silmesh.shapes.downsample import render
from silmesh.synthetic.dataset import make_object
from silmesh.synthetic.layout import OBJECTS
from silmesh.synthetic.orbit import DISTANCE

ELEVATION = 12.0
SAMPLES = 80  # a side, of the cube in which volumes are compared
AREA = 0.15  # of a silhouette, that a bite takes

Damaged = tuple[np.ndarray, list[int]]


def replace_wholly(masks: np.ndarray, others: np.ndarray, share: float, seed: int) -> Damaged:
    """Empty, full or another object's silhouettes, in turn, in place of a share of them."""
    out, wrong = swap(masks, others, share, seed)
    out[wrong[::3]], out[wrong[1::3]] = False, True
    return out, wrong


def damages(masks: np.ndarray, others: np.ndarray, seed: int) -> dict[str, Callable[[], Damaged]]:
    """What is done to silhouettes, by name."""
    return {
        "clean": lambda: (masks, []),
        "bites 20 %": lambda: bite(masks, AREA, 0.2, seed),
        "bites 40 %": lambda: bite(masks, AREA, 0.4, seed),
        "swapped 15 %": lambda: swap(masks, others, 0.15, seed),
        "wrong 15 %": lambda: replace_wholly(masks, others, 0.15, seed),
        "wrong 30 %": lambda: replace_wholly(masks, others, 0.3, seed),
    }


def see(mesh: trimesh.Trimesh, views: int, size: int) -> tuple[Cameras, np.ndarray]:
    """Cameras all around on one level, and the silhouettes that they see."""
    turn = torch.arange(views, dtype=torch.float64)
    level = torch.full_like(turn, ELEVATION)
    names = [f"v{i:02}" for i in range(views)]
    cameras = orbit_cameras(names, size, torch.full_like(turn, DISTANCE), level, 360 / views * turn)
    return cameras, render(mesh, cameras, (size, size))


def grid() -> np.ndarray:
    """Points [points, 3] of the cube that holds every object."""
    steps = [np.linspace(-0.52, 0.52, SAMPLES)] * 3
    return np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)


def volume_iou(hull: Hull, points: np.ndarray, truth: np.ndarray) -> float:
    """With the points that lie in the true mesh, [points] bool."""
    at = ((points - hull.origin) / hull.spacing).T
    inside = map_coordinates(hull.field, at, order=1, cval=-1) > 0
    return float((inside & truth).sum() / max((inside | truth).sum(), 1))


def describe(found: RobustHull, wrong: list[int]) -> dict[str, int]:
    """How many of the damaged views, and of the others, are named in either way."""
    named = {"distrusted": found.distrusted, "corrected": found.corrected}
    counted = {"damaged": len(wrong)}
    for name, views in named.items():
        counted[name] = len(set(views) & set(wrong))
        counted[f"{name}_falsely"] = len(set(views) - set(wrong))
    return counted


def main() -> None:
    """Print what was measured."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("objects", nargs="*", default=list(OBJECTS))
    args.add_argument("--views", type=int, nargs="+", default=[36])
    args.add_argument("--size", type=int, default=128)
    args.add_argument("--seeds", type=int, nargs="+", default=[1])
    given = args.parse_args()
    meshes = {name: stand_upright(make_object(name)) for name in given.objects}
    points, rows = grid(), []
    inside = {name: mesh.contains(points) for name, mesh in meshes.items()}
    for views in given.views:
        seen = {name: see(mesh, views, given.size) for name, mesh in meshes.items()}
        for i, name in enumerate(given.objects):
            cameras, masks = seen[name]
            others = seen[given.objects[i - 1]][1]
            for seed in given.seeds:
                for kind, damage in damages(masks, others, seed).items():
                    damaged, wrong = damage()
                    start = time.perf_counter(), time.process_time()
                    found = robust_carve(damaged, cameras)
                    seconds = time.perf_counter() - start[0], time.process_time() - start[1]
                    strict = carve(damaged, cameras)
                    row = {"object": name, "views": views, "seed": seed, "damage": kind}
                    row["strict"] = volume_iou(strict, points, inside[name])
                    row["robust"] = volume_iou(found.hull, points, inside[name])
                    row |= describe(found, wrong)
                    row |= dict(zip(("seconds", "cpu_seconds"), seconds, strict=True))
                    rows.append(row)
    print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
