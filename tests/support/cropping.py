"""Views that are cropped one by one to the box of what they show."""

import numpy as np
import torch
from torch import Tensor

from silmesh.geometry.camera import Cameras


def crop_to_box(
    cameras: Cameras, points: Tensor, margin: float = 0.06
) -> tuple[Cameras, np.ndarray, np.ndarray]:
    """Cameras of squares about the object's box, scaled to the images.

    Args:
        cameras: of square images of one size
        points: [n, 3] of the object
        margin: of the box's longer side, left free on each side; negative cuts the object
    Returns:
        the cameras, [views] scales, and [views, 2] shifts in pixels
    """
    size = int(cameras.sizes[0, 0])
    seen = cameras.project(points)
    low, high = seen.amin(dim=1), seen.amax(dim=1)
    scale = size / ((high - low).amax(dim=1) * (1 + 2 * margin))
    maps = torch.eye(3, dtype=torch.float64).repeat(len(cameras), 1, 1)
    maps[:, 0, 0] = maps[:, 1, 1] = scale
    maps[:, :2, 2] = size / 2 - (low + high) / 2 * scale[:, None]
    return cameras.in_pixels_of(maps, cameras.sizes), scale.numpy(), maps[:, :2, 2].numpy()
