"""Backgrounds to put objects before: photographs, and made-up textures beside them.

The made-up ones are gradients, fractal noise, stripes, and dead leaves (Lee, Mumford and Huang,
*Occlusion models for natural images*, 2001): discs and boxes of every size that hide each other,
which have the edges and the scales of real scenes.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import skimage
import torch
from PIL import Image, ImageDraw
from torch import Tensor
from torch.nn import functional

from silmesh.views import find_images, read_image

# Real photographs and microscope pictures that scikit-image's wheel brings along.
SHIPPED = (
    *("astronaut.png", "brick.png", "camera.png", "chelsea.png"),
    *("clock_motion.png", "coffee.png", "coins.png", "gravel.png"),
    *("grass.png", "hubble_deep_field.jpg", "ihc.png", "motorcycle_left.png"),
    *("moon.png", "page.png", "retina.jpg", "rocket.jpg"),
)
HELD_OUT = 4  # every fourth background, the last of each line above, is for tests only
LARGEST = 768  # longer side of what is kept of a photograph, in pixels
MOST = 400  # photographs that are kept, of a larger folder evenly chosen: 700 MB
MADE_UP = 240  # how many textures there are
GRAIN = 256  # their side


def find_backgrounds(source: str) -> list[Path]:
    """The photographs of a folder or a glob, or for ``shipped`` those of scikit-image."""
    if source == "shipped":
        return [Path(skimage.__file__).with_name("data") / name for name in SHIPPED]
    return find_images(Path(source))


def read_backgrounds(files: Sequence[Path]) -> list[Tensor]:
    """At most ``MOST`` photographs as [3, height, width] uint8, none larger than ``LARGEST``."""
    return [_read(file) for file in files[:: -(-len(files) // MOST)]]


def _read(file: Path) -> Tensor:
    image = read_image(file).convert("RGB")
    image.thumbnail((LARGEST, LARGEST))
    return _to_tensor(image)


def split(backgrounds: Sequence) -> tuple[list, list]:
    """Those to train on, and every ``HELD_OUT``-th, which is only for tests."""
    tested = list(backgrounds[HELD_OUT - 1 :: HELD_OUT])
    return [b for i, b in enumerate(backgrounds) if (i + 1) % HELD_OUT], tested


def make_textures(seed: int, count: int = MADE_UP) -> list[Tensor]:
    """Made-up textures, [3, side, side] uint8 each; the same seed gives the same."""
    makers = (_gradient, _fractal, _stripes, _dead_leaves, _dead_leaves)
    rngs = [np.random.default_rng([seed, i]) for i in range(count)]
    return [makers[i % len(makers)](rng) for i, rng in enumerate(rngs)]


def crop_background(background: Tensor, size: int, rng: np.random.Generator) -> Tensor:
    """A random square part of a background, [3, size, size] float in 0..1, perhaps mirrored."""
    height, width = background.shape[1:]
    side = int(min(height, width) * rng.uniform(0.3, 1))
    top, left = rng.integers(height - side + 1), rng.integers(width - side + 1)
    part = background[:, top : top + side, left : left + side].float().div(255)
    part = functional.interpolate(part[None], (size, size), mode="bilinear", antialias=True)[0]
    part = part.flip(-1) if rng.random() < 0.5 else part
    return part.rot90(rng.integers(4), (1, 2)) if rng.random() < 0.3 else part


def _gradient(rng: np.random.Generator) -> Tensor:
    """A smooth blend of the colours of four corners, with a little grain."""
    corners = torch.from_numpy(rng.random((1, 3, 2, 2)).astype("f4"))
    corners = corners.lerp(corners.mean(dim=(2, 3), keepdim=True), float(rng.random()))
    smooth = functional.interpolate(corners, (GRAIN, GRAIN), mode="bilinear", align_corners=True)[0]
    return _to_bytes(smooth + float(rng.uniform(0, 0.08)) * _noise(rng, GRAIN))


def _fractal(rng: np.random.Generator) -> Tensor:
    """Noise on all scales, mixed between two or three colours."""
    field = torch.zeros(2, GRAIN, GRAIN)
    weight, falloff = 1.0, rng.uniform(0.4, 0.85)
    for cells in (2, 4, 8, 16, 32, 64, 128, 256):
        coarse = torch.from_numpy(rng.standard_normal((1, 2, cells, cells)).astype("f4"))
        field += weight * functional.interpolate(coarse, (GRAIN, GRAIN), mode="bicubic")[0]
        weight *= falloff
    part = torch.sigmoid(field * float(rng.uniform(0.6, 3)))
    first, second, third = torch.from_numpy(rng.random((3, 3, 1, 1)).astype("f4"))
    return _to_bytes(first.lerp(second, part[:1]).lerp(third, 0.5 * part[1:]))


def _stripes(rng: np.random.Generator) -> Tensor:
    """Bands or checks of two colours at any angle, unevenly lit."""
    grid = torch.arange(GRAIN) / GRAIN
    y, x = torch.meshgrid(grid, grid, indexing="ij")
    angle, period = rng.uniform(0, np.pi), rng.uniform(0.02, 0.3)
    along, across = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    wave = torch.sin(along * (2 * np.pi / period))
    if rng.random() < 0.5:
        wave = wave * torch.sin(across * (2 * np.pi / (period * rng.uniform(0.5, 3))))
    part = torch.sigmoid(wave * float(rng.uniform(1, 30)))
    first, second = torch.from_numpy(rng.random((2, 3, 1, 1)).astype("f4"))
    light = 1 + 0.5 * float(rng.uniform(-1, 1)) * (x - 0.5) + 0.1 * _noise(rng, GRAIN)
    return _to_bytes(first.lerp(second, part[None]) * light)


def _dead_leaves(rng: np.random.Generator) -> Tensor:
    """Discs, boxes and triangles that hide each other, few large ones and many small."""
    image = Image.new("RGB", (GRAIN, GRAIN), _colour(rng))
    draw = ImageDraw.Draw(image)
    palette = [_colour(rng) for _ in range(rng.integers(3, 24))]
    radii = (rng.uniform(0.01, 1, rng.integers(40, 400)) ** -0.8 * 3).clip(2, 90)
    for radius in np.sort(radii)[::-1]:
        x, y = rng.uniform(-20, GRAIN + 20, 2)
        colour = palette[rng.integers(len(palette))]
        if rng.random() < 0.5:
            a, b = radius * rng.uniform(0.4, 1, 2)
            draw.ellipse((x - a, y - b, x + a, y + b), fill=colour)
        else:
            turns = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 6)))
            corners = [(x + radius * np.cos(t), y + radius * np.sin(t)) for t in turns]
            draw.polygon(corners, fill=colour)
    grain = float(rng.uniform(0, 0.1)) * _noise(rng, GRAIN)
    return _to_bytes(_to_tensor(image) / 255 + grain)


def _colour(rng: np.random.Generator) -> tuple[int, int, int]:
    return tuple(int(c) for c in rng.integers(0, 256, 3))


def _noise(rng: np.random.Generator, side: int) -> Tensor:
    """Standard normal grain, alike in the three colours: [side, side]."""
    return torch.from_numpy(rng.standard_normal((side, side), dtype="f4"))


def _to_tensor(image: Image.Image) -> Tensor:
    return torch.from_numpy(np.moveaxis(np.asarray(image), -1, 0).copy())


def _to_bytes(image: Tensor) -> Tensor:
    return (image * 255).round().clamp(0, 255).to(torch.uint8)
