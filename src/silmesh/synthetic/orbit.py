"""The made-up turntable: where its camera stands, and the frame that its photographs have."""

from collections.abc import Sequence

import torch

from silmesh.cameras.turntable import turntable_cameras
from silmesh.geometry.camera import Cameras
from silmesh.synthetic.layout import SIZE

DISTANCE = 2.732  # of the camera from the origin, in world units
ELEVATION = 10.0  # degrees: it looks slightly down


def photograph_cameras(
    views: Sequence[str],
    size: tuple[int, int] = SIZE,
    distance: float = DISTANCE,
    elevation: float = ELEVATION,
) -> Cameras:
    """Cameras evenly around the y axis, the first over the z axis.

    Args:
        views: names
        size: width and height in pixels; the half-angle of view is that of the longer side
        distance: from the origin, in world units
        elevation: above the plane y = 0, in degrees
    """
    square = turntable_cameras(views, max(size), distance, elevation, 360 / len(views))
    frame = torch.tensor(size)
    to_frame = torch.eye(3, dtype=torch.float64)
    to_frame[:2, 2] = (frame - max(size)) / 2
    return square.in_pixels_of(to_frame.repeat(len(views), 1, 1), frame.repeat(len(views), 1))
