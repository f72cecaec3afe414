"""Where close-ups that the frame cuts place the object, with and without points on it: JSON.

    python benchmarks/placing.py --objects apricot tube --scans ../shared/data/scans/shampoo.glb

A walk of 36 photographs of 96x128, three of four of the object's one end if ``--end`` is given.
Points are on the object, in patches, some of them far off, and on the floor beneath it. ``reach``
is how far the object reaches in the sphere that should hold it, in its radii: more than 1 is cut
off.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
import trimesh
from closeups import NEAR, STEP, look, see
from scenery import read_scan, stand_upright

from silmesh.geometry.camera import OBJECT_RADIUS, Cameras
from silmesh.geometry.frame import is_cut
from silmesh.geometry.whereabouts import find_body
from silmesh.synthetic.dataset import make_object
from silmesh.synthetic.layout import OBJECTS

PHOTOGRAPHS, STEPS = 36, 8  # of a walk; steps back at most
END, MOST = 75, 0.75  # percentile from which on is the end; share of the photographs that show it
POINTS, PATCHES = 1500, 12  # on the object, and as many on the floor
WRONG, NOISE = 0.05, 0.003  # share of points that are far off; standard deviation of the others


def main() -> None:
    """Print what was measured."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("--objects", nargs="*", default=OBJECTS, help="made-up ones")
    args.add_argument("--scans", type=Path, nargs="*", default=[], help="glb files")
    args.add_argument("--seeds", type=int, nargs="*", default=[0, 1])
    args.add_argument("--end", action="store_true", help="most photographs show one end")
    given = args.parse_args()
    torch.set_num_threads(1)
    objects = {name: make_object(name) for name in given.objects}
    objects |= {scan.stem: stand_upright(read_scan(scan)) for scan in given.scans}
    for name, mesh in objects.items():
        for seed in given.seeds:
            print(json.dumps({"object": name, "seed": seed, **measure(mesh, seed, given.end)}))


def measure(mesh: trimesh.Trimesh, seed: int, end: bool) -> dict[str, float]:
    """How far the object reaches where it is placed."""
    cameras = walk(mesh, seed, end)
    masks = see(mesh, cameras)
    kept = np.flatnonzero(masks.any(axis=(1, 2)) & is_cut(masks))
    cameras, masks = cameras.select(kept), masks[kept]
    told = {"views": len(kept)}
    for name, points in (("carved", None), ("with points", scatter(mesh, seed))):
        placed = find_body(cameras, masks, None, points)
        verts = placed.apply(torch.tensor(np.asarray(mesh.vertices)))
        told[f"reach, {name}"] = round(float(verts.norm(dim=1).max()) / OBJECT_RADIUS, 2)
    return told


def walk(mesh: trimesh.Trimesh, seed: int, end: bool) -> Cameras:
    """Close-ups from around and above."""
    rng, verts = np.random.default_rng(seed), np.asarray(mesh.vertices)
    azimuth = np.radians(
        1800 / PHOTOGRAPHS * np.arange(PHOTOGRAPHS) + rng.normal(0, 2, PHOTOGRAPHS)
    )
    elevation = np.radians(25 + 25 * np.sin(5 * azimuth) + rng.normal(0, 3, PHOTOGRAPHS))
    along = np.stack([np.sin(azimuth), np.tan(elevation), np.cos(azimuth)], axis=1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    aims = 0.7 * verts[rng.integers(len(verts), size=PHOTOGRAPHS)]
    stand = along * ((verts @ along.T).max(axis=0) + rng.uniform(*NEAR, PHOTOGRAPHS))[:, None]
    if end:
        long = np.ptp(verts, axis=0).argmax()
        tip = verts[verts[:, long] > np.percentile(verts[:, long], END)]
        there = rng.random(PHOTOGRAPHS) < MOST
        aims[there] = tip[rng.integers(len(tip), size=there.sum())]
        near = rng.uniform(0.45, 0.6, there.sum())
        stand[there] = aims[there] + along[there] * near[:, None]
    return step_back(mesh, stand, aims, along)


def step_back(
    mesh: trimesh.Trimesh, stand: np.ndarray, aims: np.ndarray, along: Sequence
) -> Cameras:
    """The cameras, stepped back until some background shows at their borders."""
    for _ in range(STEPS):
        masks = see(mesh, look(stand, aims))
        sides = masks[:, [0, -1]].all(axis=(1, 2)) & masks[:, :, [0, -1]].all(axis=(1, 2))
        if not sides.any():
            break
        stand[sides] += STEP * along[sides]
    return look(stand, aims)


def scatter(mesh: trimesh.Trimesh, seed: int) -> np.ndarray:
    """Points [n, 3] in patches of the object, some far off, and on the floor."""
    rng, verts = np.random.default_rng(seed + 100), np.asarray(mesh.vertices)
    points = np.asarray(trimesh.sample.sample_surface(mesh, 4 * POINTS, seed=seed)[0])
    middles = verts[rng.integers(len(verts), size=PATCHES)]
    apart = np.linalg.norm(points[:, None] - middles, axis=2).min(axis=1)
    points = points[np.argsort(apart)[:POINTS]] + rng.normal(0, NOISE, (POINTS, 3))
    wrong = rng.random(POINTS) < WRONG
    points[wrong] += rng.normal(0, 0.5, (wrong.sum(), 3))
    floor = rng.uniform(-2, 2, (POINTS, 3))
    floor[:, 1] = verts[:, 1].min() - 0.01
    return np.concatenate([points, floor])


if __name__ == "__main__":
    main()
