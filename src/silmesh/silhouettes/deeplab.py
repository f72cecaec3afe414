"""Silhouettes by DeepLabv3: M = (C > 0), C being each pixel's class, 0 for the background.

The network sees each photograph from its file, not the working image, with the longer side resized
to ``size``; its scores are resized to the working image and the best class is taken there.
"""

import zlib
from collections.abc import Iterator, Sequence
from itertools import groupby, islice

import numpy as np
import torch
from PIL import Image
from torch import Tensor
from torch.nn import functional

from silmesh.settings.silhouettes import DeepLab
from silmesh.silhouettes.network import Weights, load_weights
from silmesh.views import View, read_photograph

BATCH = 4  # photographs of one shape that the network sees at once; only these are in memory


def find_all(
    views: Sequence[View], settings: DeepLab, threads: int | None = None
) -> Iterator[np.ndarray]:
    """The silhouette of each view in turn, [size, size] bool.

    Args:
        threads: of torch; as many as it has if not given

    Raises:
        InputError: the weights or a photograph cannot be used
    """
    torch.set_num_threads(threads or torch.get_num_threads())
    weights = load_weights(settings.weights, settings.model)
    size = weights.size if settings.size == "auto" else settings.size
    found = find_classes(views, weights, size)
    if settings.classes == "dominant":
        yield from _keep_dominant(found)
    else:
        for classes in found:
            yield classes > 0


def find_classes(views: Sequence[View], weights: Weights, size: int) -> Iterator[np.ndarray]:
    """The class of each pixel of each view's working image, [size, size] uint8, 0 beside it.

    Args:
        size: longer side of what the network sees, in pixels
    """
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    network = weights.build().to(device, memory_format=torch.channels_last)
    mean, std = (torch.tensor(v, device=device)[:, None, None] for v in (weights.mean, weights.std))
    shown = ((view, _show(view, size)) for view in views)
    for _, alike in groupby(shown, key=lambda pair: pair[1].shape):
        while batch := list(islice(alike, BATCH)):
            images = torch.stack([image for _, image in batch]).to(device).float().div(255)
            with torch.inference_mode():
                scores = network((images - mean) / std)["out"]
            yield from (_place(s, view) for s, (view, _) in zip(scores, batch, strict=True))


def _show(view: View, size: int) -> Tensor:
    """A photograph as the network sees it: [3, height, width] uint8, its longer side ``size``."""
    photograph = read_photograph(view).convert("RGB")
    scale = size / max(photograph.size)
    extent = [max(1, round(side * scale)) for side in photograph.size]
    small = photograph.resize(extent, Image.Resampling.BILINEAR, reducing_gap=3.0)
    return torch.from_numpy(np.moveaxis(np.asarray(small), -1, 0).copy())


def _place(scores: Tensor, view: View) -> np.ndarray:
    """The best class of each pixel of the working image, from scores [classes, h, w].

    One class is resized after the other: of 21 at once a large image would take gigabytes.
    """
    extent = (view.bottom - view.top, view.right - view.left)
    best = torch.full(extent, -torch.inf, device=scores.device)
    classes = torch.zeros(extent, dtype=torch.uint8, device=scores.device)
    for number, score in enumerate(scores):
        resized = functional.interpolate(
            score[None, None], extent, mode="bilinear", antialias=True
        )[0, 0]
        classes[resized > best] = number
        best = torch.maximum(best, resized)
    square = np.zeros((view.size, view.size), np.uint8)
    square[view.top : view.bottom, view.left : view.right] = classes.cpu().numpy()
    return square


def _keep_dominant(found: Iterator[np.ndarray]) -> Iterator[np.ndarray]:
    """Where the one class is that covers most of all views together.

    All views are seen before the first is given. Maps of classes shrink to a few kilobytes.
    """
    areas = np.zeros(256, np.int64)
    kept = []
    for classes in found:
        areas += np.bincount(classes.ravel(), minlength=256)
        kept.append((classes.shape, zlib.compress(classes, level=1)))
    dominant = 1 + np.argmax(areas[1:])
    for shape, packed in kept:
        yield np.frombuffer(zlib.decompress(packed), np.uint8).reshape(shape) == dominant
