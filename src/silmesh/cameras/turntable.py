"""Cameras of a turntable whose geometry is known, and of SoftRas's ``camera.npy``.

Both are (distance, elevation, azimuth) about the origin with the half-angle of view of 15 degrees
that SoftRas's examples and the report use. SoftRas places its eye at
d (cos e sin a, sin e, -cos e cos a) of a left-handed world; in ours, its mirror image, that is
d (cos e sin a, sin e, cos e cos a), and the picture is the same. So for a = 0 the camera stands
on +z and +x is to the right.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from silmesh.errors import InputError, blaming
from silmesh.geometry.camera import OBJECT_RADIUS, Cameras
from silmesh.reading import open_array

FARTHEST = 1_000_000  # units or degrees that mean anything
HALF_ANGLE = 15.0  # degrees, from the image's centre to the middle of its side


def turntable_cameras(
    views: Sequence[str], size: int, distance: float, elevation: float, step: float
) -> Cameras:
    """Cameras of photographs taken every ``step`` degrees around the axis y.

    Args:
        views: names, in the order in which they were taken
        size: of the square working images, in pixels
        distance: from the origin, in scene units
        elevation: above the table, in degrees
        step: turn from one view to the next, in degrees
    """
    azimuth = step * torch.arange(len(views), dtype=torch.float64)
    return orbit_cameras(
        views,
        size,
        torch.full_like(azimuth, distance),
        torch.full_like(azimuth, elevation),
        azimuth,
    )


def orbit_cameras(
    views: Sequence[str], size: int, distance: Tensor, elevation: Tensor, azimuth: Tensor
) -> Cameras:
    """Cameras that look at the origin, upright.

    Args:
        distance: [views] from the origin, in scene units
        elevation, azimuth: [views] in degrees

    Raises:
        InputError: a camera stands within the sphere of radius 0.5 that holds the object
    """
    _refuse_inside(views, distance)
    e, a = torch.deg2rad(elevation), torch.deg2rad(azimuth)
    zero = torch.zeros_like(a)
    right = torch.stack([a.cos(), zero, -a.sin()], dim=-1)
    forward = -torch.stack([e.cos() * a.sin(), e.sin(), e.cos() * a.cos()], dim=-1)
    down = torch.linalg.cross(forward, right)
    t = torch.stack([zero, zero, distance], dim=-1)
    focal = size / 2 / math.tan(math.radians(HALF_ANGLE))
    K = torch.tensor([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1]], dtype=torch.float64)
    return Cameras(
        tuple(views),
        torch.full((len(views), 2), size),
        K.repeat(len(views), 1, 1),
        torch.stack([right, down, forward], dim=1),
        t,
    )


def _refuse_inside(views: Sequence[str], distance: Tensor) -> None:
    for view, d in zip(views, distance.tolist(), strict=True):
        if not d > OBJECT_RADIUS:
            raise InputError(
                f"the camera of view {view!r} stands at distance {d:g} from the origin, inside "
                f"the sphere of radius {OBJECT_RADIUS} that holds the object; "
                "SoftRas's distance is 2.732"
            )


def softras_cameras(path: Path, views: Sequence[str], size: int) -> Cameras:
    """Cameras of SoftRas's ``camera.npy``: a row of distance, elevation and azimuth a view.

    Raises:
        InputError: it cannot be read, has another shape, or another number of views
    """
    rows = open_array(path)
    if rows.ndim != 2 or rows.shape[1] != 3 or rows.dtype.kind not in "iuf":
        raise InputError(
            f"{path}: should hold [views, 3] numbers (distance, elevation, azimuth in degrees), "
            f"not {list(rows.shape)} of {rows.dtype}"
        )
    if len(rows) != len(views):
        raise InputError(f"{path}: has {len(rows)} cameras, but there are {len(views)} views")
    if not np.isfinite(rows).all():
        raise InputError(f"{path}: row {int(np.argwhere(~np.isfinite(rows))[0, 0])} is not finite")
    if np.abs(rows.astype(np.float64)).max() > FARTHEST:
        raise InputError(f"{path}: distances and angles should be at most {FARTHEST:,}")
    with blaming(path):
        return orbit_cameras(views, size, *torch.tensor(rows.astype(np.float64)).unbind(1))
