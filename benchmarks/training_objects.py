"""Photographs with masks to retrain DeepLabv3 on: made-up objects and scans, from random views.

    python benchmarks/training_objects.py FOLDER --scans ../shared/data/scans/*.glb

writes FOLDER/{images,masks}/<object>/, FOLDER/objects.tsv, the table of those to train on,
FOLDER/tests.tsv, the table of those that are left out, and FOLDER/train.yaml, with which

    bin/run train --configfile FOLDER/train.yaml

trains. Beside the six made-up objects and the scans there are random solids: a few ellipsoids,
rods, rings, boxes and turned bodies, united or cut out of each other. They are painted as things
are: many pale or grey, parts each in a colour of its own, with bands, stripes, spots. A sixth of
the solids and the tube say which epoch is kept.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
import trimesh
from PIL import Image
from scipy.spatial import KDTree

from silmesh.cameras.turntable import orbit_cameras
from silmesh.synthetic.dataset import find_paint, make_object, mesh_solid
from silmesh.synthetic.layout import OBJECTS
from silmesh.synthetic.paints import band, cover, mix, speckle, step
from silmesh.synthetic.photograph import photograph
from silmesh.synthetic.solids import (
    ellipsoid,
    lathe,
    limb,
    ring,
    round_corners,
    subtract,
    unite,
)

SIZE = 256  # of the photographs, in pixels
DISTANCE = 2.9
Solid = tuple[trimesh.Trimesh, Callable]


def main() -> None:
    """Make the objects, photograph them, write the table."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("folder", type=Path)
    args.add_argument("--scans", type=Path, nargs="*", default=[], help="glb files")
    args.add_argument("--solids", type=int, default=120)
    args.add_argument("--views", type=int, default=24, help="of each made-up object and scan")
    args.add_argument("--solid-views", type=int, default=8, help="of each random solid")
    args.add_argument("--tests", nargs="*", default=["bear", "pot", "blue_cup"], help="left out")
    given = args.parse_args()
    names = []
    for name, views, (mesh, paint) in objects(given):
        names.append(name)
        for kind in ("images", "masks"):
            (given.folder / kind / name).mkdir(parents=True, exist_ok=True)
        cameras = random_cameras(views, np.random.default_rng([1, len(names)]))
        pictures = photograph(mesh, cameras, paint, seed=len(names))
        for i, (image, mask) in enumerate(pictures):
            Image.fromarray(image).save(given.folder / f"images/{name}/{i:02d}.png")
            Image.fromarray(mask).save(given.folder / f"masks/{name}/{i:02d}.png")
    write_table(given.folder / "objects.tsv", [n for n in names if n not in given.tests])
    write_table(given.folder / "tests.tsv", given.tests)
    holdout = ["tube", *[f"solid{i:03d}" for i in range(given.solids * 5 // 6, given.solids)]]
    (given.folder / "train.yaml").write_text(
        f"datasets: {given.folder}/objects.tsv\n"
        "train: {epochs: 38, patience: 38, "
        f"holdout: [{', '.join(holdout)}]}}\n"
        "variants: {learnt: {silhouettes: deeplab, deeplab: {weights: results/train/weights.pt}}}\n"
    )


def write_table(path: Path, names: list[str]) -> None:
    """Write the dataset list of some of the objects."""
    rows = [f"{n}\timages/{n}\tmasks/{n}\tmask\tcalibrate" for n in names]
    header = "object\timages\tmasks\tsilhouettes\tcameras"
    path.write_text("\n".join([header, *rows]) + "\n")


def objects(given: argparse.Namespace) -> Iterator[tuple[str, int, Solid]]:
    """Name, number of views, mesh and paint of each object."""
    for name in OBJECTS:
        yield name, given.views, centred(make_object(name), find_paint(name))
    for i in range(given.solids):
        yield f"solid{i:03d}", given.solid_views, random_solid(np.random.default_rng([2, i]))
    for file in given.scans:
        yield file.stem, given.views, read_scan(file)


def random_cameras(views: int, rng: np.random.Generator):
    """Cameras all around, mostly from a little above."""
    azimuth = torch.from_numpy(rng.uniform(0, 360, views))
    elevation = torch.from_numpy(rng.uniform(-10, 50, views))
    distance = torch.full_like(azimuth, DISTANCE)
    return orbit_cameras([str(i) for i in range(views)], SIZE, distance, elevation, azimuth)


def centred(mesh: trimesh.Trimesh, paint: Callable) -> Solid:
    """A made-up object that fills its photographs, as the others do."""
    centre = mesh.bounds.mean(axis=0)
    scale = 0.5 / np.linalg.norm(mesh.vertices - centre, axis=1).max()
    large = trimesh.Trimesh((mesh.vertices - centre) * scale, mesh.faces, process=False)
    return large, lambda points: paint((points / scale + centre).astype(np.float32))


def read_scan(file: Path) -> Solid:
    """A scan, as large as the made-up objects, and its texture as a paint."""
    mesh = trimesh.load(file, force="mesh")
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    mesh.apply_scale(0.5 / np.linalg.norm(mesh.vertices, axis=1).max())
    mesh.visual.material = mesh.visual.material.to_simple()  # which sampling knows
    points, _, colours = trimesh.sample.sample_surface(mesh, 300_000, sample_color=True, seed=0)
    tree, colours = KDTree(points), colours[:, :3].astype("f4") / 255
    smooth = trimesh.Trimesh(mesh.vertices, mesh.faces)
    while len(smooth.faces) < 20_000:  # shadows are found at vertices
        smooth = smooth.subdivide()

    def paint(at: np.ndarray) -> np.ndarray:
        found = colours[tree.query(at)[1]]
        return np.column_stack([found, np.full(len(at), 0.3, "f4")])

    return smooth, paint


def random_solid(rng: np.random.Generator) -> Solid:
    """Some simple solids together, and a paint."""
    parts = [random_part(rng) for _ in range(rng.integers(1, 6))]
    cuts = [random_part(rng, 0.6) for _ in range(rng.integers(0, 2))]
    blend = rng.uniform(0.005, 0.06)

    def distance(points: np.ndarray) -> np.ndarray:
        whole = unite(*(part(points) for part in parts), blend=blend)
        for cut in cuts:
            whole = subtract(whole, cut(points), blend=0.01)
        return whole.astype(np.float32)

    mesh = mesh_solid(distance, (-0.62,) * 3, (0.62,) * 3, 0.02)
    mesh = max(mesh.split(only_watertight=False), key=lambda part: len(part.faces))
    scale = 0.46 / np.abs(mesh.vertices).max()
    mesh.apply_scale(scale)
    paint = random_paint(parts if rng.random() < 0.6 else parts[:1], rng)
    return mesh, lambda points: paint(points / scale)


def random_part(rng: np.random.Generator, scale: float = 1.0) -> Callable:
    """The distance function of a simple solid near the origin."""
    centre = rng.uniform(-0.2, 0.2, 3)
    sizes = scale * rng.uniform(0.05, 0.3, 3)
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3].astype("f4")
    end = centre + scale * rng.uniform(-0.45, 0.45, 3)
    heights = np.sort(rng.uniform(-0.42, 0.42, 5)) * scale
    rim = [(scale * rng.uniform(0.04, 0.28), y) for y in heights]
    profile = round_corners([(0, heights[0]), *rim, (0, heights[-1])], times=int(rng.integers(3)))
    axis, corner = int(rng.integers(3)), rng.uniform(0.005, 0.04)

    def box(points: np.ndarray) -> np.ndarray:
        out = np.abs((points - centre.astype("f4")) @ turn) - sizes.astype("f4")
        return np.linalg.norm(np.maximum(out, 0), axis=1) + np.minimum(out.max(axis=1), 0) - corner

    kinds = [
        lambda p: ellipsoid(p @ turn, centre, sizes),
        lambda p: limb(p, centre, end, (0.5 * sizes[0], 0.5 * sizes[1])),
        lambda p: ring(p, centre, axis, 0.06 + sizes[0], 0.1 * sizes[1] + 0.02),
        lambda p: lathe(p, profile),
        lambda p: lathe(p @ turn, profile),
        box,
        box,
    ]
    return kinds[rng.integers(len(kinds))]


def random_paint(parts: Sequence[Callable], rng: np.random.Generator) -> Callable:
    """Plain, mottled, striped, banded, in up to three colours for the parts and four more."""
    bases, colours = random_colours(3, rng), random_colours(4, rng)
    grains, seeds = rng.uniform(0.01, 0.25, 2), rng.integers(0, 8, 2)
    way, period = rng.normal(size=3).astype("f4"), rng.uniform(0.05, 0.5)
    edge, shine = rng.uniform(-0.6, 0.6, 2), rng.uniform(0, 0.9)
    striped, mottled, second = rng.random(3) < (0.25, 0.4, 0.4)
    bands = rng.uniform((-0.4, 0.005), (0.4, 0.08), (rng.integers(5) * (rng.random() < 0.6), 2))
    blur = rng.choice([0.02, 0.3, 1.5])
    way /= np.linalg.norm(way)

    def paint(points: np.ndarray) -> np.ndarray:
        points = points.astype(np.float32)
        colour = bases[np.argmin([part(points) for part in parts], axis=0) % len(bases)]
        if mottled:
            spots = speckle(points, grains[0], int(seeds[0]))
            colour = mix(colour, colours[1], step(edge[0], spots, blur))
        skin = np.column_stack([colour, np.full(len(points), shine, "f4")])
        if striped:
            cover(
                skin, step(edge[1], np.sin(points @ way * (6.28 / period)), 0.2), colours[2], shine
            )
        for i, (height, reach) in enumerate(bands):
            inside = band(height - reach, height + reach, points[:, 1], 0.005)
            cover(skin, inside, colours[2 * (i % 2)], shine)
        if second:
            cover(skin, step(0.5, speckle(points, grains[1], int(seeds[1])), 0.05), colours[3], 0.1)
        return skin.astype(np.float32)

    return paint


def random_colours(count: int, rng: np.random.Generator) -> np.ndarray:
    """Half of them pale, grey or dark, half of any hue: [count, 3]."""
    grey = rng.random((count, 1)) ** 0.5
    any_hue = rng.random((count, 3)) ** rng.uniform(0.5, 1.5)
    tint = np.where(rng.random((count, 1)) < 0.5, rng.uniform(0, 0.25, (count, 1)), 1)
    return (grey + tint * (any_hue - grey)).astype("f4")


if __name__ == "__main__":
    main()
