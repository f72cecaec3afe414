"""Composites: a cutout turned, scaled and coloured at random, laid over a background.

photograph = coverage * object + (1 - coverage) * background
"""

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from silmesh.training.backgrounds import crop_background

Rng = np.random.Generator
UPRIGHT = 0.5  # share of what is trained on that is made as the tests are: it is learnt sooner


def compose_random(
    cutout: Tensor, backgrounds: Sequence[Sequence[Tensor]], size: int, rng: Rng
) -> tuple[Tensor, Tensor]:
    """A photograph to train on: one as those of the tests, or everything about it drawn at random.

    Args:
        cutout: [4, height, width] uint8, colour and coverage
        backgrounds: kinds of them, each as likely as the others
        size: side of the photograph, in pixels
    Returns:
        [3, size, size] float in 0..1, and [size, size] int64, 1 on the object
    """
    if rng.random() < UPRIGHT:
        return compose_upright(cutout, _draw_background(backgrounds, rng), size, rng)
    behind = _draw_behind(backgrounds, size, rng)
    if rng.random() < 0.25:  # a table before a wall
        below = _draw_behind(backgrounds, size, rng)
        behind = lay_over(below, _draw_half(size, rng), behind)
    if rng.random() < 0.4:  # out of focus
        behind = blur(behind, rng.uniform(0.5, 3))
    colour, coverage = place(cutout, size, *_draw_pose(rng))
    colour = _light(_recolour(colour, rng), rng)
    if rng.random() < 0.4:
        behind = _cast_shadow(behind, coverage, rng)
    image = lay_over(colour, coverage, behind)
    if rng.random() < 0.2:
        image = blur(image, rng.uniform(0.3, 1.0))
    grain = torch.from_numpy(rng.standard_normal(image.shape, dtype="f4"))
    image = image + float(rng.uniform(0, 0.025)) * grain
    return image.clamp(0, 1), (coverage > 0.5).long()


def _draw_behind(backgrounds: Sequence[Sequence[Tensor]], size: int, rng: Rng) -> Tensor:
    """A part of one of the backgrounds, in other colours."""
    return _recolour(crop_background(_draw_background(backgrounds, rng), size, rng), rng)


def _draw_background(backgrounds: Sequence[Sequence[Tensor]], rng: Rng) -> Tensor:
    kind = backgrounds[rng.integers(len(backgrounds))]
    return kind[rng.integers(len(kind))]


def _draw_half(size: int, rng: Rng) -> Tensor:
    """What lies on one side of a line, mostly below a level one: [size, size] in 0..1."""
    angle = rng.normal(0, 0.15) if rng.random() < 0.6 else rng.uniform(-math.pi, math.pi)
    ramp = torch.linspace(-0.5, 0.5, size)
    beyond = math.cos(angle) * ramp[:, None] + math.sin(angle) * ramp - rng.uniform(-0.35, 0.35)
    return (0.5 + beyond * size / math.exp(rng.uniform(0, 2))).clamp(0, 1)


def compose_upright(
    cutout: Tensor, background: Tensor, size: int, rng: Rng
) -> tuple[Tensor, Tensor]:
    """The object as it is, upright, 0.5 to 0.85 of the picture large: what is tested on."""
    longer, shift = rng.uniform(0.5, 0.85), rng.uniform(-0.07, 0.07, 2)
    colour, coverage = place(cutout, size, longer, 0.0, (1.0, 1.0), tuple(shift))
    image = lay_over(colour, coverage, crop_background(background, size, rng))
    return image.clamp(0, 1), (coverage > 0.5).long()


def lay_over(colour: Tensor, coverage: Tensor, behind: Tensor) -> Tensor:
    """Lay an object [3, h, w] of this coverage [h, w] over a background [3, h, w]."""
    return behind.lerp(colour, coverage)


def place(
    cutout: Tensor,
    size: int,
    longer: float,
    angle: float,
    stretch: tuple[float, float],
    shift: tuple[float, float],
) -> tuple[Tensor, Tensor]:
    """Put a cutout into a square of ``size`` pixels.

    Args:
        cutout: [4, height, width] uint8
        longer: the cutout's longer side, in parts of the square's
        angle: by which it is turned, in radians
        stretch: along its own axes x and y; a negative one mirrors
        shift: of its centre from the square's, in parts of the square's side
    Returns:
        colour [3, size, size] and coverage [size, size] in 0..1
    """
    height, width = cutout.shape[1:]
    scale = longer * size / max(height, width)
    extent = (max(2, round(height * scale)), max(2, round(width * scale)))
    scaled = functional.interpolate(
        cutout[None].float().div(255), extent, mode="bilinear", antialias=scale < 1
    )
    theta = _to_cutout(extent, size, angle, stretch, shift)
    grid = functional.affine_grid(theta, [1, 4, size, size], align_corners=False)
    colour = functional.grid_sample(scaled[:, :3], grid, padding_mode="border", align_corners=False)
    coverage = functional.grid_sample(scaled[:, 3:], grid, align_corners=False)
    return colour[0], coverage[0, 0]


def _to_cutout(
    extent: tuple[int, int], size: int, angle: float, stretch: Sequence[float], shift: Sequence
) -> Tensor:
    """The map from the square to the cutout, both in -1..1: [1, 2, 3]."""
    cos, sin = math.cos(angle), math.sin(angle)
    turn = np.array([[cos, sin], [-sin, cos]]) / np.array(stretch)[:, None]
    turn = turn * size / np.array(extent[::-1])[:, None]
    theta = np.column_stack([turn, -turn @ (2 * np.array(shift))])
    return torch.from_numpy(theta[None].astype("f4"))


def _draw_pose(rng: Rng) -> tuple[float, float, tuple[float, float], tuple[float, float]]:
    """Size, angle, stretch and shift: large, near the middle and upright, as objects are taken."""
    longer = rng.uniform(0.45, 1.05)
    angle = rng.uniform(-math.pi, math.pi) if rng.random() < 0.15 else rng.normal(0, 0.2)
    squeeze = math.exp(rng.normal(0, 0.15))
    mirror = 1 if rng.random() < 0.5 else -1
    reach = 0.06 + 0.25 * max(1 - longer, 0)
    shift = tuple(rng.uniform(-reach, reach, 2))
    return longer, angle, (mirror * squeeze, 1 / squeeze), shift


def _recolour(image: Tensor, rng: Rng) -> Tensor:
    """Another tint, contrast and brightness; half the time also other hues."""
    mixing = np.eye(3)
    if rng.random() < 0.5:
        mixing = mixing[rng.permutation(3)]
        mixing = mixing + rng.uniform(-0.25, 0.25, (3, 3))
        mixing = mixing / mixing.sum(axis=1, keepdims=True)
    image = torch.einsum("ij,jhw->ihw", torch.from_numpy(mixing.astype("f4")), image)
    grey = image.mean(dim=0, keepdim=True)
    image = grey.lerp(image, float(rng.uniform(0.2, 1.4)))
    gain = torch.from_numpy(rng.normal(1, 0.1, (3, 1, 1)).astype("f4"))
    image = (image - 0.5) * float(rng.uniform(0.6, 1.3)) + 0.5 + float(rng.normal(0, 0.12))
    return (image * gain).clamp(0, 1) ** math.exp(rng.normal(0, 0.25))


def _light(image: Tensor, rng: Rng) -> Tensor:
    """Light that falls off across the picture."""
    ramp = torch.linspace(-1, 1, image.shape[-1])
    x, y = rng.uniform(-0.35, 0.35, 2)
    return (image * (1 + x * ramp + y * ramp[:, None])).clamp(0, 1)


def _cast_shadow(behind: Tensor, coverage: Tensor, rng: Rng) -> Tensor:
    """Darken the background beside and below the object."""
    size = coverage.shape[-1]
    offset = rng.uniform((-0.08, 0.0), (0.08, 0.08)) * size
    shade = coverage.roll(tuple(int(o) for o in offset[::-1]), (0, 1))
    shade = blur(shade[None], rng.uniform(0.01, 0.06) * size)[0]
    return behind * (1 - float(rng.uniform(0.2, 0.7)) * shade)


def blur(image: Tensor, sigma: float) -> Tensor:
    """Gaussian blur of [channels, height, width] by a standard deviation in pixels."""
    reach = min(math.ceil(2.5 * sigma), image.shape[-1] - 1)
    places = torch.arange(-reach, reach + 1, dtype=torch.float32)
    kernel = torch.exp(-0.5 * (places / sigma) ** 2)
    kernel = (kernel / kernel.sum()).expand(len(image), 1, 1, -1)
    for across in (kernel, kernel.transpose(2, 3)):
        pad = (reach, reach, 0, 0) if across is kernel else (0, 0, reach, reach)
        padded = functional.pad(image[None], pad, mode="replicate")
        image = functional.conv2d(padded, across, groups=len(image))[0]
    return image
