"""How well `threshold` leaves out shadows on a plain ground, as JSON: IoU with the true masks.

    python benchmarks/shadows.py

Made-up objects, in their colours and in greys, before grounds of several colours, with contact and
cast shadows of several strengths; and without any, where nothing may be lost. A row is a colouring,
a ground and a shadow: mean IoU of the object with its shadow, and of what is found; how many views
are left with a shadow (IoU lower than without one by more than 0.05), and how many of these the
colours contradict.
"""

import argparse
import json
from collections import defaultdict
from collections.abc import Iterator
from functools import partial

import numpy as np
import torch
from scipy.ndimage import gaussian_filter

from silmesh.cameras.turntable import orbit_cameras
from silmesh.scene.colour_edges import compare, contradict
from silmesh.silhouettes.shadow import find_shadow
from silmesh.silhouettes.threshold import find_ground, separate
from silmesh.synthetic.dataset import find_paint, make_object
from silmesh.synthetic.photograph import photograph

SIZE, FINE = 256, 2  # of the pictures; rays of each pixel's side
OBJECTS = ("bear", "bottle", "pot", "tube")
PAINTS = {"colours": None, "dark grey": 0.1, "grey": 0.35, "light grey": 0.7}
GROUNDS = {"white": (240, 240, 240), "beige": (225, 205, 170), "blue": (120, 150, 210)}
SHADOWS = {"none": (0, 1), "faint": (0.25, 8), "contact": (0.5, 10), "cast": (0.45, 5)}
NOISE = 1.5  # grey levels
LOST = 0.05  # of IoU


def render(name: str, grey: float | None) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Pictures of an object and its masks, ``FINE`` times as large."""
    views = torch.tensor([15.0, 30]).double(), torch.tensor([20.0, 130]).double()
    cameras = orbit_cameras(["a", "b"], FINE * SIZE, torch.full((2,), 2.732).double(), *views)
    paint = find_paint(name) if grey is None else partial(_grey, grey)
    return photograph(make_object(name), cameras, paint)


def _grey(brightness: float, points: np.ndarray) -> np.ndarray:
    return np.tile(np.float32([brightness] * 3 + [0.05]), (len(points), 1))


def darken(mask: np.ndarray, strength: float, softness: float, cast: bool) -> np.ndarray:
    """What part of the light reaches the ground about an object: [height, width] in 0..1."""
    rows, columns = np.nonzero(mask)
    foot, width = rows.max(), np.ptp(columns)
    shadow = np.zeros(mask.shape)
    if cast:  # the mask laid down, to the right
        up = foot - rows
        right = np.minimum(columns + 0.8 * up, mask.shape[1] - 1).astype(int)
        shadow[(foot - 0.04 * np.ptp(rows) - 0.25 * up).astype(int), right] = 1.6
    else:
        v, u = np.indices(mask.shape)
        u, v = u - (columns.max() + columns.min()) / 2, v - (foot - 0.06 * width)
        shadow[np.hypot(u / 0.5, v / 0.16) < width] = 1
    shadow = gaussian_filter(shadow, FINE * softness)
    return 1 - strength * np.minimum(shadow if cast else shadow / shadow.max(), 1)


def compose(
    image: np.ndarray, mask: np.ndarray, ground: tuple[int, int, int], light: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A picture before a ground, and its true mask, of ``SIZE``."""
    picture = np.where(mask[..., None], image, light[..., None] * np.array(ground))
    blocks = picture.reshape(SIZE, FINE, SIZE, FINE, 3).mean((1, 3))
    noise = np.random.default_rng(0).normal(0, NOISE, blocks.shape)
    truth = mask.reshape(SIZE, FINE, SIZE, FINE).mean((1, 3)) > 0.5
    return (blocks + noise).clip(0, 255).astype(np.uint8), truth


def judge(pixels: np.ndarray, truth: np.ndarray) -> tuple[float, float, bool]:
    """IoU with the shadow and without, and whether the colours contradict the latter."""
    found = separate(pixels)
    kept = found & ~find_shadow(pixels, find_ground(pixels), found)
    iou = [(s & truth).sum() / (s | truth).sum() for s in (found, kept)]
    return *iou, contradict(compare(pixels, kept, (0, 0, SIZE, SIZE)))


def main() -> None:
    """Make, measure, print."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    rows = defaultdict(list)
    for paint, grey in PAINTS.items():
        for image, mask in (shot for name in OBJECTS for shot in render(name, grey)):
            lights = {name: darken(mask, *how, name == "cast") for name, how in SHADOWS.items()}
            for ground, colour in GROUNDS.items():
                seen = {s: judge(*compose(image, mask, colour, lights[s])) for s in SHADOWS}
                for shadow, (before, after, doubted) in seen.items():
                    left = after < seen["none"][0] - LOST
                    rows[paint, ground, shadow].append((before, after, left, left and doubted))
    for (paint, ground, shadow), values in rows.items():
        before, after, left, doubted = np.transpose(values)
        row = {"paint": paint, "ground": ground, "shadow": shadow, "views": len(values)}
        row |= {"with_shadow": before.mean().round(3), "found": after.mean().round(3)}
        print(json.dumps(row | {"left": int(left.sum()), "left_and_doubted": int(doubted.sum())}))


if __name__ == "__main__":
    main()
