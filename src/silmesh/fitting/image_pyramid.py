"""An image pyramid of silhouettes: images from coarse to fine, the coarser ones rendered softer.

Of working images of more than BASE pixels a pyramid is made of small ones of that size, and then of
as many finer levels as lead to their own size, of which only a band about the outlines is looked at
(``silmesh.fitting.band``).
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from silmesh.fitting.band import BandLevel, choose_factors
from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import WHOLE
from silmesh.geometry.small_images import shrink

FACTORS = (4, 2, 1)  # by which the images of the levels are smaller, the coarsest first
BASE = 256  # pixels a side: of larger working images only a band is looked at
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

    factor: float
    silhouettes: Tensor
    sigma: float
    pixel: float
    known: Tensor | None = None

    def scale_cameras(self, cameras: Cameras) -> Cameras:
        """Cameras of the working images, scaled to the images of this level."""
        return cameras.shrink(self.factor, tuple(self.silhouettes.shape[1:]))


@dataclass(frozen=True)
class Images:
    """What a fit is told of its views: cameras, silhouettes and which pixels are known.

    Attributes:
        cameras: of the working images
        silhouettes: [views, height, width]
        known: [views, height, width], the pixels of which each view says anything; None if of all
    """

    cameras: Cameras
    silhouettes: Tensor
    known: Tensor | None = None

    @property
    def large(self) -> bool:
        """Whether they have finer levels than dense ones."""
        return self.silhouettes.shape[-1] > BASE

    def shrink(self, device: torch.device) -> "Images":
        """The same in images of BASE pixels, float32: 0 or 1; those that are not larger as is."""
        if not self.large:
            return self
        small, cameras = shrink(self.silhouettes.cpu().numpy() > 0, self.cameras, BASE)
        known = None
        if self.known is not None:
            known, _ = shrink(self.known.cpu().numpy() > 0, self.cameras, BASE)
        parts = (part if part is None else _to_floats(part, device) for part in (small, known))
        return Images(cameras, *parts)


def _to_floats(part: np.ndarray, device: torch.device) -> Tensor:
    return torch.from_numpy(part).to(device, torch.float32)


def build_levels(
    images: Images, small: Images, sigma: tuple[float, float], coarse_to_fine: bool
) -> list[PyramidLevel | BandLevel]:
    """All levels of a fit, the finest last; of ``images`` that are not large a plain pyramid.

    Args:
        small: ``images.shrink()``
        sigma: of the finest level, and of the finest one of ``small``
        coarse_to_fine: whether there are others than the finest
    """
    dense = build_pyramid(small.cameras, small.silhouettes, sigma[1], coarse_to_fine, small.known)
    if not images.large:
        return dense
    size = images.silhouettes.shape[-1]
    ratio = size / small.silhouettes.shape[-1]
    known = None if images.known is None else images.known.cpu().numpy() > 0
    silhouettes = images.silhouettes.cpu().numpy() > 0
    bands = [
        BandLevel(f, silhouettes, sigma[0] * f**2, dense[-1].pixel * f / ratio, known)
        for f in choose_factors(size, BASE)
    ]
    levels = [*(replace(level, factor=level.factor * ratio) for level in dense), *bands]
    return levels if coarse_to_fine else levels[-1:]


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
