r"""What ``deeplab`` finds on photographs as they are: IoU with the masks of a table, and classes.

python benchmarks/deeplab_objects.py objects.tsv --model mobilenet_v2 --weights deeplab.tflite

Prints JSON: for each object the mean, median, worst and best IoU over its views at a working size
of 256, of any class and of the dominant one; how many views have an IoU above a half; and which
classes are found, each with its mean share of the views' pixels, the largest first, the background
left out. Where there are no masks only the classes are told. ``--sheets`` draws what was found.
"""

import argparse
import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from deeplab import draw_sheet

from silmesh.planning.datasets import Dataset, read_datasets
from silmesh.silhouettes import mask
from silmesh.silhouettes.deeplab import find_classes
from silmesh.silhouettes.network import Weights, load_weights
from silmesh.views import ImageFolder, write_views

PASCAL = (
    *("background", "aeroplane", "bicycle", "bird", "boat", "bottle", "bus", "car", "cat", "chair"),
    *("cow", "table", "dog", "horse", "motorbike", "person", "plant", "sheep", "sofa", "train"),
    "monitor",
)


def main() -> None:
    """Measure each object of the table."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("table", type=Path, help="of objects")
    args.add_argument("--model", default="mobilenet_v3_large")
    args.add_argument("--weights", default="DEFAULT")
    args.add_argument("--size", type=int, help="that the network sees; else the weights' own")
    args.add_argument("--every", type=int, default=1, help="take each so-manyth view")
    args.add_argument("--sheets", type=Path, help="folder for contact sheets")
    given = args.parse_args()
    torch.set_num_threads(1)
    weights = load_weights(given.weights, given.model)
    report = {d.object: measure(d, weights, given) for d in read_datasets(given.table)}
    print(json.dumps(report, indent=2))


def measure(dataset: Dataset, weights: Weights, given: argparse.Namespace) -> dict:
    """What is found of one object."""
    with TemporaryDirectory() as folder:
        images = dataset.images[:: given.every]
        views = write_views(images, 256, "pad", Path(folder))
        found = list(find_classes(views, weights, given.size or weights.size))
        seen, masks = ImageFolder(Path(folder)), dataset.masks[:: given.every]
        truths = [mask.find(seen[v.view], v, m) for v, m in zip(views, masks, strict=False)]
        if given.sheets:
            working = [Path(folder) / f"{view.view}.png" for view in views]
            draw_sheet(given.sheets / f"{dataset.object}.png", working, [f > 0 for f in found])
    areas = np.bincount(np.concatenate([f.ravel() for f in found]), minlength=len(weights.classes))
    areas[0] = 0
    named = PASCAL if len(weights.classes) == len(PASCAL) else weights.classes
    shares = {named[i]: round(areas[i] / found[0].size / len(found), 3) for i in np.argsort(-areas)}
    report = {"views": len(found), "classes": dict(list(shares.items())[:4])}
    if truths:
        report["any"] = sum_up([f > 0 for f in found], truths)
        report["dominant"] = sum_up([f == np.argmax(areas) for f in found], truths)
    return report


def sum_up(found: list[np.ndarray], truths: list[np.ndarray]) -> dict:
    """Numbers over the views' IoU."""
    ious = [(f & t).sum() / max(1, (f | t).sum()) for f, t in zip(found, truths, strict=True)]
    numbers = {kind.__name__: round(float(kind(ious)), 3) for kind in (np.mean, np.median)}
    return {
        **numbers,
        "worst": round(min(ious), 3),
        "best": round(max(ious), 3),
        "above a half": int(np.sum(np.array(ious) > 0.5)),
    }


if __name__ == "__main__":
    main()
