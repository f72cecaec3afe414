"""An image pyramid of silhouettes: images from coarse to fine, the coarser ones rendered softer."""

from dataclasses import dataclass

import torch
from torch import Tensor

from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import WHOLE

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
        known: [views, height, width], how much of each pixel its photograph shows; None if all
    """

    factor: int
    silhouettes: Tensor
    sigma: float
    pixel: float
    known: Tensor | None = None

    def scale_cameras(self, cameras: Cameras) -> Cameras:
        """Cameras of the working images, scaled to the images of this level."""
        shrink = torch.diag(torch.tensor([1 / self.factor, 1 / self.factor, 1.0]))
        return cameras.in_pixels_of(
            shrink.double().expand(len(cameras), 3, 3), cameras.sizes // self.factor
        )


def build_pyramid(
    cameras: Cameras,
    silhouettes: Tensor,
    sigma: float,
    coarse_to_fine: bool,
    known: Tensor | None = None,
) -> list[PyramidLevel]:
    """The pyramid of silhouettes [views, height, width], the finest level last.

    A pixel is as large as in half of the views; where frames cut silhouettes, of those that show
    the object whole, since steps as short as suit close-ups alone would end before the others fit.

    Args:
        known: [views, height, width], 0 or 1, the pixels of which each view says anything; all if
            not given
    """
    pixels = cameras.t[:, 2] / cameras.K[:, 0, 0]
    if known is not None:
        silhouettes = silhouettes * known
        whole = known.flatten(1).all(dim=1).to(pixels.device)
        pixels = pixels[whole] if whole.sum() >= WHOLE else pixels
    sides = silhouettes.shape[1:]
    pixel = float(pixels.median())
    return [
        PyramidLevel(
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
