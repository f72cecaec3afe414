"""Coarse to fine: the working images halved, and halved again, softer the coarser they are."""

from dataclasses import dataclass

import torch
from torch import Tensor

from silmesh.geometry.camera import Cameras

FACTORS = (4, 2, 1)  # by which the images are shrunk
SMALLEST = 32  # pixels: no level is smaller
SOFTER = 1.5  # sigma grows with the factor to the power of two (as pixels do) times this


@dataclass(frozen=True)
class Level:
    """One resolution.

    Attributes:
        factor: by which the images are smaller than the working images
        silhouettes: [views, height, width], 0 to 1
        sigma: in squared half-image units
        pixel: the size of a pixel at the object, in world units
        known: [views, height, width], how much of each pixel its photograph shows; None if all
    """

    factor: int
    silhouettes: Tensor
    sigma: float
    pixel: float
    known: Tensor | None = None

    def see(self, cameras: Cameras) -> Cameras:
        """The cameras of the working images for those of this level."""
        shrink = torch.diag(torch.tensor([1 / self.factor, 1 / self.factor, 1.0]))
        return cameras.in_pixels_of(
            shrink.double().expand(len(cameras), 3, 3), cameras.sizes // self.factor
        )


def levels_of(
    cameras: Cameras,
    silhouettes: Tensor,
    sigma: float,
    coarse_to_fine: bool,
    known: Tensor | None = None,
) -> list[Level]:
    """The levels of some silhouettes [views, height, width], the finest last.

    Args:
        known: [views, height, width], 0 or 1, the pixels of which each view says anything; all if
            not given
    """
    if known is not None:
        silhouettes = silhouettes * known
    sides = silhouettes.shape[1:]
    pixel = float((cameras.t[:, 2] / cameras.K[:, 0, 0]).median())
    return [
        Level(
            factor,
            _shrink(silhouettes, factor),
            sigma * factor ** (2 * SOFTER),
            pixel * factor,
            None if known is None else _shrink(known, factor),
        )
        for factor in (FACTORS if coarse_to_fine else (1,))
        if factor == 1 or all(side % factor == 0 and side // factor >= SMALLEST for side in sides)
    ]


def _shrink(silhouettes: Tensor, factor: int) -> Tensor:
    if factor == 1:
        return silhouettes
    return torch.nn.functional.avg_pool2d(silhouettes.unsqueeze(1), factor).squeeze(1)
