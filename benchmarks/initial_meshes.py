"""Initial meshes by shape and object: losses of the preset softras, and 3D: JSON, table and figure.

python benchmarks/initial_meshes.py bottle=results/bottle/stages/scenes/256-pad-mask-turntable \
    --truth bottle=results/bottle/stages/truth.ply --table --figure docs/initial-meshes.png

What was measured is kept in a folder, and only what is not there is measured.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch
import trimesh
from matplotlib.figure import Figure
from PIL import Image

from silmesh.errors import InputError
from silmesh.evaluation.ground_truth import compare_to_truth
from silmesh.fitting.loop import run
from silmesh.fitting.softras import SoftRas
from silmesh.geometry.camera import Cameras
from silmesh.geometry.mesh_files import read_mesh, to_tensors
from silmesh.geometry.overlap import mean_iou
from silmesh.report.pictures import camera_of, draw_edges, frame, shade, trace
from silmesh.scene.scene import SILHOUETTES, VIEWS, read_scene
from silmesh.settings.fit import SoftRasFit
from silmesh.settings.init import Init
from silmesh.shapes.downsample import downsample, render
from silmesh.shapes.initial import PLACED, make_initial_mesh
from silmesh.silhouettes import read_silhouettes

SHAPES = {"sphere, not placed": ("sphere", "none"), "sphere": ("sphere", "bbox")} | {
    shape: (shape, "bbox") for shape in PLACED
}
AT = (0, 50, 200, 1000)  # steps at which the loss is told
LATEST = 20  # steps whose median is told: Adam's steps make single losses leap
CELL = 220  # pixels of a picture in the figure


def load(scene: Path) -> tuple[np.ndarray, Cameras]:
    """All silhouettes of a scene, and their cameras."""
    cameras, _, _ = read_scene(scene)
    return read_silhouettes(scene / SILHOUETTES, cameras.views), cameras


def measure(scene: Path, truth: Path | None, shape: str, given: argparse.Namespace) -> dict:
    """One initial mesh: what it is, its 3D numbers, and its fit's losses."""
    silhouettes, cameras = load(scene)
    init = Init(shape=SHAPES[shape][0], vertices=given.vertices, align=SHAPES[shape][1])
    start = time.process_time()
    first = make_initial_mesh(init, silhouettes, cameras)
    seconds = time.process_time() - start
    small, eyes = downsample(silhouettes, cameras, given.size, given.views)
    edges = first.mesh.edges_unique_length
    world = first.mesh.copy()
    world.apply_scale(0.5)
    result = {
        **first.notes,
        "iou": mean_iou(render(world, eyes, small.shape[1:]), small),
        "edge_spread": float(edges.std() / edges.mean()),
        "least_angle": float(np.degrees(first.mesh.face_angles.min())),
        "watertight": first.mesh.is_watertight,
        "cpu_seconds": seconds,
    }
    if truth:
        result["truth"] = compare_to_truth(world, read_mesh(truth))
    settings = SoftRasFit(iterations=given.steps + 1)
    target = torch.tensor(small, dtype=torch.float32)
    try:
        records = run(SoftRas(*to_tensors(first.mesh), eyes, target, settings))
        result["loss"] = [record.loss for record in records]
    except InputError as error:
        result["refused"] = str(error)
    return result


def measure_all(
    scenes: dict[str, Path], truths: dict[str, Path], given: argparse.Namespace
) -> dict:
    """Every object with every shape, those in the folder not again."""
    results: dict[str, dict] = {}
    for name, scene in scenes.items():
        for shape in given.shapes:
            kept = given.kept / f"{name}-{shape.replace(', ', '-').replace(' ', '-')}.json"
            if not kept.exists() and not given.only_kept:
                result = measure(scene, truths.get(name), shape, given)
                kept.parent.mkdir(parents=True, exist_ok=True)
                kept.write_text(json.dumps(result))
            if kept.exists():
                results.setdefault(name, {})[shape] = json.loads(kept.read_text())
    return results


def smooth(losses: list[float], step: int) -> float:
    """The median of the last losses up to a step; that before the fit is its own."""
    return float(np.median(losses[max(0, step - LATEST + 1) : step + 1] if step else losses[0]))


def table(results: dict) -> str:
    """The losses and 3D numbers in Markdown."""
    head = " | ".join(f"{step:,} steps" if step else "before" for step in AT)
    lines = [f"| object | shape | {head} | chamfer | volume IoU |", "|---|---|" + "---:|" * 6]
    for name, shapes in results.items():
        for shape, result in shapes.items():
            loss = result.get("loss", [])
            cells = [f"{smooth(loss, step):.3f}" if step < len(loss) else "–" for step in AT]
            truth = result.get("truth", {})
            cells += [
                f"{truth[key]:.3f}" if truth.get(key) is not None else "–"
                for key in ("chamfer", "volume_iou")
            ]
            lines.append(f"| {name} | {shape} | {' | '.join(cells)} |")
    return "\n".join(lines)


def draw_first(mesh: trimesh.Trimesh, scene: Path, view: int) -> np.ndarray:
    """An initial mesh with its edges, as a view's camera sees it: [CELL, CELL, 3]."""
    silhouettes, cameras = load(scene)
    near = camera_of(cameras, view).cropped(*frame(silhouettes[view]), 2 * CELL)
    hits = trace(mesh, near)
    image = shade(mesh, near, hits, smooth=False)
    draw_edges(image, mesh, near, hits, width=1.0)
    return image.reshape(CELL, 2, CELL, 2, 3).mean(axis=(1, 3))


def draw_photograph(scene: Path, view: int) -> Image.Image:
    """A view's photograph, cropped as the meshes are."""
    silhouettes, cameras = load(scene)
    left, top, side = frame(silhouettes[view])
    with Image.open(scene / VIEWS / f"{cameras.views[view]}.png") as image:
        box = (left, top, left + side, top + side)
        return image.convert("RGB").resize((CELL, CELL), box=box)


def draw_figure(scenes: dict[str, Path], vertices: int) -> Figure:
    """A row an object: its photograph and every initial mesh, from the same camera."""
    shapes = list(SHAPES)[1:]
    figure = Figure(figsize=(1.5 * (1 + len(shapes)), 1.6 * len(scenes)), layout="constrained")
    grid = figure.subplots(len(scenes), 1 + len(shapes), squeeze=False)
    for row, (name, scene) in zip(grid, scenes.items(), strict=True):
        silhouettes, cameras = load(scene)
        view = len(cameras) // 10  # a little from the side
        row[0].imshow(draw_photograph(scene, view))
        row[0].set_ylabel(name)
        for axes, shape in zip(row[1:], shapes, strict=True):
            init = Init(shape=SHAPES[shape][0], vertices=vertices)
            mesh = make_initial_mesh(init, silhouettes, cameras).mesh
            mesh.apply_scale(0.5)
            axes.imshow(draw_first(mesh, scene, view))
        for axes in row:
            axes.set(xticks=[], yticks=[])
    for axes, title in zip(grid[0], ["photograph", *shapes], strict=True):
        axes.set_title(title, fontsize=9)
    return figure


def main() -> None:
    """Print what was measured."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("scenes", nargs="+", help="NAME=FOLDER of each scene")
    args.add_argument("--truth", nargs="*", default=[], help="NAME=MESH, in the scene's world")
    args.add_argument("--size", type=int, default=128, help="of the images that are fitted")
    args.add_argument("--views", type=int, default=36, help="that are fitted, at most")
    args.add_argument("--shapes", nargs="+", choices=list(SHAPES), default=list(SHAPES))
    args.add_argument("--vertices", type=int, default=1352)
    args.add_argument("--steps", type=int, default=max(AT))
    args.add_argument("--threads", type=int, default=2)
    args.add_argument("--kept", type=Path, default=Path("results/initial_meshes"), help="folder")
    args.add_argument("--only-kept", action="store_true", help="measure nothing")
    args.add_argument("--table", action="store_true", help="Markdown, not JSON")
    args.add_argument("--figure", type=Path, help="to draw")
    given = args.parse_args()
    torch.set_num_threads(given.threads)
    scenes, truths = (
        {name: Path(path) for name, _, path in (pair.partition("=") for pair in pairs)}
        for pairs in (given.scenes, given.truth)
    )
    results = measure_all(scenes, truths, given)
    print(table(results) if given.table else json.dumps(results, indent=1))
    if given.figure:
        draw_figure(scenes, given.vertices).savefig(given.figure, dpi=75)


if __name__ == "__main__":
    main()
