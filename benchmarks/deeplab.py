r"""Silhouettes by ``deeplab``: how fast, also to train, and how good with given weights: JSON.

python benchmarks/deeplab.py
python benchmarks/deeplab.py --training
python benchmarks/deeplab.py --weights results/train/weights.pt --tests FOLDER/tests.tsv

Speed does not depend on what the weights are, so random ones serve; large_photographs.py measures
memory. The quality is over composites of objects and backgrounds that were not trained on (see
training_objects.py), through the source as a run uses it, at a working size of 256.
"""

import argparse
import json
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from PIL import Image
from torch import nn

from silmesh.planning.datasets import read_datasets
from silmesh.settings.silhouettes import DeepLab
from silmesh.settings.train import Train
from silmesh.silhouettes.deeplab import find_all, find_classes
from silmesh.silhouettes.network import MEAN, STD, Weights, build_network
from silmesh.training.backgrounds import find_backgrounds, read_backgrounds, split
from silmesh.training.composite import compose_upright
from silmesh.training.cutouts import read_cutout
from silmesh.training.depthwise import AtrousDepthwise
from silmesh.training.training_loop import Training, normalise
from silmesh.views import write_views

PAGE = 512  # side of the composites, in pixels
MODEL = "mobilenet_v3_large"


def main() -> None:
    """Measure what is asked for."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("--weights", type=Path, help="measure the quality of these")
    args.add_argument("--training", action="store_true", help="measure steps of a training")
    args.add_argument("--model", default=MODEL)
    args.add_argument("--tests", type=Path, help="table of the objects to test on")
    args.add_argument("--sizes", type=int, nargs="+", default=[256], help="that the network sees")
    args.add_argument("--pictures", type=Path, help="folder for contact sheets of the tests")
    given = args.parse_args()
    if given.weights:
        report = {size: measure_quality(given, size) for size in given.sizes}
    elif given.training:
        report = {f"training at {size}": measure_training(size) for size in (96, 128, 192)}
    else:
        report = {f"{model} {s}": measure_speed(model, s) for model, s in
                   ((MODEL, 256), (MODEL, 520), ("resnet50", 256))}  # fmt: skip
    print(json.dumps(report, indent=2))


def random_weights(model: str) -> Weights:
    """Weights of 21 classes, as torchvision's have."""
    names = tuple(map(str, range(21)))
    return Weights(model, names, MEAN, STD, 520, build_network(model, 21).state_dict())


def measure_speed(model: str, size: int, views: int = 12) -> dict:
    """Wall time and processor time a view of photographs of 1024 x 768, reading them included."""
    with TemporaryDirectory() as folder:
        photographs = draw_photographs(Path(folder), views + 4, (1024, 768), "png")
        placed = write_views(photographs, 256, "pad", Path(folder) / "views")
        weights = random_weights(model)
        found = find_classes(placed, weights, size)
        for _ in range(4):  # the first batch also builds the network
            next(found)
        wall, cpu = time.perf_counter(), time.process_time()
        list(found)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        return {"wall": round(wall / views, 4), "cpu": round(cpu / views, 4)}


def measure_training(size: int, batch: int = 8, steps: int = 4) -> dict:
    """Processor time a composite of a step, without making it: ours, and by torch's own layers."""
    torch.set_num_threads(1)
    told = {"epochs": 1, "patience": 1, "batch": batch, "size": size, "learning_rate": 1e-3}
    training = Training(Train(holdout=["none"], model=MODEL, **told), None)
    images = normalise(torch.rand(batch, 3, size, size))
    truth = torch.randint(2, (batch, size, size))
    training.network.train()
    report = {}
    for kind in (AtrousDepthwise, nn.Conv2d):
        for part in training.network.modules():
            if isinstance(part, AtrousDepthwise):
                part.__class__ = kind
        training.step(images, truth, 0)
        start = time.process_time()
        for number in range(steps):
            training.step(images, truth, number)
        cpu = (time.process_time() - start) / steps / batch
        report["ours" if kind is AtrousDepthwise else "torch"] = round(cpu, 4)
    return report


def draw_photographs(folder: Path, count: int, size: tuple[int, int], ending: str) -> list[Path]:
    """Photographs of coloured grain."""
    rng = np.random.default_rng(0)
    small = rng.integers(0, 256, (size[1] // 8, size[0] // 8, 3), dtype=np.uint8)
    files = [folder / f"{i}.{ending}" for i in range(count)]
    for file in files:
        Image.fromarray(small).resize(size).save(file)
    return files


def measure_quality(given: argparse.Namespace, size: int) -> dict:
    """Mean and worst IoU of each object before backgrounds that were not trained on."""
    backgrounds = split(read_backgrounds(find_backgrounds("shipped")))[1]
    settings = DeepLab(model=given.model, weights=str(given.weights), size=size)
    report = {}
    for number, dataset in enumerate(read_datasets(given.tests)):
        with TemporaryDirectory() as folder:
            files, truths = [], []
            for i, pair in enumerate(zip(dataset.images, dataset.masks, strict=True)):
                rng = np.random.default_rng([3, number, i])
                background = backgrounds[i % len(backgrounds)]
                image, truth = compose_upright(read_cutout(*pair, PAGE), background, PAGE, rng)
                files.append(Path(folder) / f"{i}.png")
                pixels = (image * 255).round().byte().permute(1, 2, 0).numpy()
                Image.fromarray(pixels).save(files[-1])
                truths.append(shrink(truth.numpy()))
            views = write_views(files, 256, "pad", Path(folder) / "views")
            found = list(find_all(views, settings))
            if given.pictures:
                draw_sheet(given.pictures / f"{dataset.object}-{size}.png", files, found)
        ious = [(f & t).sum() / (f | t).sum() for f, t in zip(found, truths, strict=True)]
        report[dataset.object] = {"mean": round(np.mean(ious), 4), "worst": round(min(ious), 4)}
    report["mean"] = round(np.mean([part["mean"] for part in report.values()]), 4)
    return report


def shrink(truth: np.ndarray) -> np.ndarray:
    """A mask at the working size, where at least half of a pixel is covered."""
    return np.asarray(Image.fromarray(truth.astype("f4")).resize((256, 256), Image.BOX)) >= 0.5


def draw_sheet(path: Path, files: list[Path], found: list[np.ndarray]) -> None:
    """The composites with what was found outlined in green."""
    tiles = []
    for file, silhouette in zip(files[:24], found, strict=False):
        pixels = np.asarray(Image.open(file).resize((256, 256))).copy()
        inner = silhouette.copy()
        for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
            inner &= np.roll(silhouette, step, axis)
        pixels[silhouette & ~inner] = (0, 255, 0)
        tiles.append(pixels)
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % 8)
    rows = [np.concatenate(tiles[i : i + 8], axis=1) for i in range(0, len(tiles), 8)]
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate(rows)).save(path)


if __name__ == "__main__":
    main()
