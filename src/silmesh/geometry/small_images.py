"""Silhouettes in small images, with the cameras of these: for judgements that need no detail."""

import numpy as np
import torch

from silmesh.geometry.camera import Cameras


def shrink(silhouettes: np.ndarray, cameras: Cameras, size: int) -> tuple[np.ndarray, Cameras]:
    """The silhouettes in images whose longer side is ``size``, or theirs if that is shorter.

    A pixel is inside where more than half of what it covers is.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views
        size: in pixels
    Returns:
        [views, small height, small width] bool, and the cameras of these images
    """
    count, height, width = silhouettes.shape
    shape = shrink_shape((height, width), size)
    small = np.stack([_shrink_image(silhouette, shape) for silhouette in silhouettes])
    to_small = torch.diag(torch.tensor([shape[1] / width, shape[0] / height, 1.0])).double()
    sizes = torch.tensor([[shape[1], shape[0]]]).expand(count, 2)
    return small, cameras.in_pixels_of(to_small.expand(count, 3, 3), sizes)


def _shrink_image(silhouette: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    image = torch.from_numpy(silhouette.astype(np.float32))[None, None]
    return (torch.nn.functional.interpolate(image, shape, mode="area")[0, 0] > 0.5).numpy()


def shrink_shape(shape: tuple[int, int], size: int) -> tuple[int, int]:
    """Height and width of what ``shrink`` makes of images of this height and width."""
    scale = min(1.0, size / max(shape))
    height, width = shape
    return max(1, round(scale * height)), max(1, round(scale * width))
