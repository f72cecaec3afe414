"""Silhouettes in small images, with the cameras of these: for judgements that need no detail."""

from collections.abc import Sequence

import numpy as np
import torch

from silmesh.ahead import ahead
from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import open_frames

LARGEST = 512  # pixels: of larger images what needs no more detail is found in such ones


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
    small = shrink_silhouettes(silhouettes, size)
    to_small = torch.diag(torch.tensor([shape[1] / width, shape[0] / height, 1.0])).double()
    sizes = torch.tensor([[shape[1], shape[0]]]).expand(count, 2)
    return small, cameras.in_pixels_of(to_small.expand(count, 3, 3), sizes)


def shrink_silhouettes(silhouettes: np.ndarray, size: int) -> np.ndarray:
    """The silhouettes that ``shrink`` gives, one at a time."""
    shape = shrink_shape(silhouettes.shape[1:], size)
    if shape == silhouettes.shape[1:]:
        return silhouettes
    return np.stack(
        list(ahead(lambda s: _shrink_image(s, shape), silhouettes, torch.get_num_threads()))
    )


def _shrink_image(silhouette: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    image = torch.from_numpy(silhouette.astype(np.float32))[None, None]
    return (torch.nn.functional.interpolate(image, shape, mode="area")[0, 0] > 0.5).numpy()


def shrink_shape(shape: tuple[int, int], size: int) -> tuple[int, int]:
    """Height and width of what ``shrink`` makes of images of this height and width."""
    scale = min(1.0, size / max(shape))
    height, width = shape
    return max(1, round(scale * height)), max(1, round(scale * width))


def shrink_frames(
    silhouettes: np.ndarray, size: int, frames: Sequence[Sequence[int]] | None = None
) -> np.ndarray | None:
    """The frames of the photographs in what ``shrink`` gives; None if they cut no silhouette.

    Those of views that are not cut are the whole images: nothing beyond them is unknown.

    Args:
        silhouettes: [views, height, width] bool
        size: as ``shrink`` takes it
        frames: [views, 4] of the photographs within the images; the whole images if not given
    Returns:
        [views, 4] int, no pixel of which lies partly beyond its photograph
    """
    height, width = shrink_shape(silhouettes.shape[1:], size)
    cut, spoken = open_frames(silhouettes, frames)
    if not cut.any():
        return None
    scale = np.array([width, height]) / silhouettes.shape[:0:-1]
    low, high = np.ceil(spoken[:, :2] * scale), np.floor(spoken[:, 2:] * scale)
    inner = np.concatenate([low, high], axis=1)
    return np.where(cut[:, None], inner, [0, 0, width, height]).astype(int)
