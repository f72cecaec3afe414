"""Colours by position: what the made-up objects are painted with.

A paint takes points [n, 3] on an object and gives their skin, [n, 4] float32: red, green and blue
in 0..1 as a screen shows them (sRGB), and the shine, from 0 (wool) to 1 (glazed).
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import map_coordinates

Array = NDArray[np.floating]
Colour = NDArray[np.float32]


def rgb(code: str) -> Colour:
    """A colour of six hexadecimal digits as [3] in 0..1."""
    return np.array([int(code[i : i + 2], 16) for i in (0, 2, 4)], dtype=np.float32) / 255


def coat(points: Array, colour: Colour, shine: float) -> Colour:
    """Paint all points alike: [n, 4]."""
    return np.tile(np.append(colour, np.float32(shine)), (len(points), 1))


def mix(under: Colour, over: Colour, weight: Array) -> Colour:
    """Cover the colours [n, 3] by another one, or others, where the weight [n] is 1."""
    return under + np.clip(weight, 0, 1)[:, None].astype(np.float32) * (over - under)


def cover(skin: Colour, where: Array, colour: Colour, shine: float) -> None:
    """Cover a skin [n, 4], in place, by a colour and a shine where ``where`` [n] is 1."""
    skin[:] = mix(skin, np.append(colour, np.float32(shine)), where)


def step(edge: float, value: Array, width: float = 0.002) -> Array:
    """From 0 below the edge to 1 above it, smoothly over this width."""
    part = np.clip((value - edge) / width + 0.5, 0, 1)
    return part * part * (3 - 2 * part)


def band(low: float, high: float, value: Array, width: float = 0.002) -> Array:
    """1 between two edges and 0 outside of them."""
    return step(low, value, width) * (1 - step(high, value, width))


def speckle(points: Array, grain: float, seed: int = 0) -> Array:
    """Smooth random values in -1..1 that change over the length ``grain``: [n]."""
    return map_coordinates(_lattice(seed), points.T / grain, order=1, mode="grid-wrap")


@cache
def _lattice(seed: int) -> Array:
    return np.random.default_rng(seed).uniform(-1, 1, (32, 32, 32)).astype(np.float32)


def print_label(lines: Sequence[tuple[str, float, float]], height_to_width: float) -> Array:
    """Set centred lines of text: [rows, columns] float32, 1 where there is ink.

    Args:
        lines: text, its size and its middle below the upper edge, in parts of the label's height
        height_to_width: of the label
    """
    height = 512
    image = Image.new("L", (round(height / height_to_width), height))
    draw = ImageDraw.Draw(image)
    for text, size, middle in lines:
        font = ImageFont.load_default(size=size * height)
        draw.text((image.width / 2, middle * height), text, fill=255, font=font, anchor="mm")
    return np.asarray(image, dtype=np.float32) / 255


def ink_at(label: Array, across: Array, down: Array) -> Array:
    """Ink of a label where 0..1 go over its width and its height, and none outside: [n]."""
    rows, columns = label.shape
    places = np.stack([down * rows - 0.5, across * columns - 0.5])
    return map_coordinates(label, places, order=1, mode="constant")
