"""An image pyramid of silhouettes: images from coarse to fine, the coarser ones rendered softer."""

from dataclasses import dataclass

import torch
from torch import Tensor

from silmesh.geometry.camera import Cameras

FACTORS = (4, 2, 1)  # by which the images of the levels are smaller, the coarsest first
SMALLEST = 32  # pixels a side: levels with smaller images are left out
# Sigma grows with the factor to the power of 2 SOFTER. With 1 it would be constant in pixels.
SOFTER = 1.5


@dataclass(frozen=True)
class PyramidLevel:
    """One level of the pyramid.

    Attributes:
        factor: by which the images are smaller than the working images
        silhouettes: [views, height, width], 0 to 1
        sigma: in squared half-image units
        pixel: size of a pixel at the object's distance, in world units
    """

    factor: int
    silhouettes: Tensor
    sigma: float
    pixel: float

    def scale_cameras(self, cameras: Cameras) -> Cameras:
        """Cameras of the working images, scaled to the images of this level."""
        shrink = torch.diag(torch.tensor([1 / self.factor, 1 / self.factor, 1.0]))
        return cameras.in_pixels_of(
            shrink.double().expand(len(cameras), 3, 3), cameras.sizes // self.factor
        )


def build_pyramid(
    cameras: Cameras, silhouettes: Tensor, sigma: float, coarse_to_fine: bool
) -> list[PyramidLevel]:
    """The pyramid of silhouettes [views, height, width], the finest level last."""
    sides = silhouettes.shape[1:]
    pixel = float((cameras.t[:, 2] / cameras.K[:, 0, 0]).median())
    return [
        PyramidLevel(
            factor, _shrink(silhouettes, factor), sigma * factor ** (2 * SOFTER), pixel * factor
        )
        for factor in (FACTORS if coarse_to_fine else (1,))
        if factor == 1 or all(side % factor == 0 and side // factor >= SMALLEST for side in sides)
    ]


def _shrink(silhouettes: Tensor, factor: int) -> Tensor:
    if factor == 1:
        return silhouettes
    return torch.nn.functional.avg_pool2d(silhouettes.unsqueeze(1), factor).squeeze(1)
