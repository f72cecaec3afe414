"""From the world of a reconstruction, which has any orientation, to one that is upright."""

from typing import NamedTuple

import torch
from torch import Tensor

FLAT = 0.05  # greatest extent of a ring of cameras across its plane, over that along it
ROUND = 0.25  # least extent of a ring along its shorter axis, over that along its longer one
ALONG = 0.5  # least cosine of an up direction with the mean of the cameras' own
SPREAD = 0.02  # least variance of the cameras' right directions along the second principal axis
TRIMMED, TIMES = 3.0, 5  # standard deviations beyond which centres are trimmed, and iterations


class Up(NamedTuple):
    """The up direction [3], and what it was found by."""

    direction: Tensor
    found_by: str  # "ring", "horizons" or "ups"


def find_up(R: Tensor, centres: Tensor) -> Up:
    """The up direction of cameras that were carried around an object, or before which it turned.

    Args:
        R: [views, 3, 3] from the world to each camera
        centres: [views, 3]
    Returns:
        by ``ring``: the normal of the plane in which the centres lie, whatever the cameras'
        elevation and roll; else by ``horizons``: the direction that is perpendicular to the
        rows of all images, which supposes that no camera was rolled; else by ``ups``: the mean
        of the images' upward directions. The sign is that of the latter.
    """
    own = torch.nn.functional.normalize(-R[:, 1].mean(0), dim=0)
    for name, found in (("ring", _ring_normal(centres)), ("horizons", _across(R[:, 0]))):
        if found is not None and abs(found @ own) > ALONG:
            return Up(found * torch.sign(found @ own), name)
    return Up(own, "ups")


def _ring_normal(centres: Tensor) -> Tensor | None:
    """The normal of the plane that most centres lie in, None if they do not form a ring."""
    kept = torch.ones(len(centres), dtype=torch.bool)
    for _ in range(TIMES):
        middle = centres[kept].mean(0)
        _, extent, axes = torch.linalg.svd(centres[kept] - middle, full_matrices=False)
        off = ((centres - middle) @ axes[2]).abs()
        kept = off <= TRIMMED * off[kept].square().mean().sqrt() + 1e-12 * extent[0]
    if kept.sum() < max(3, 0.8 * len(centres)):
        return None
    is_ring = extent[2] < FLAT * extent[0] and extent[1] > ROUND * extent[0]
    return axes[2] if is_ring else None


def _across(right: Tensor) -> Tensor | None:
    """The direction perpendicular to directions [views, 3], None if they are parallel."""
    variance, axes = torch.linalg.eigh(right.T @ right / len(right))
    return axes[:, 0] if variance[1] > SPREAD else None


def turn_upright(R: Tensor, up: Tensor) -> Tensor:
    """The rotation [3, 3] that brings ``up`` to y, with the first camera standing over +z.

    A camera's R becomes R Q^T for this Q, and its t stays.
    """
    back = -R[0, 2]
    flat = back - up * (up @ back)
    if flat.norm() < 0.1:  # it looks straight down: what its image has below is nearer
        flat = R[0, 1] - up * (up @ R[0, 1])
    z = torch.nn.functional.normalize(flat, dim=0)
    return torch.stack([torch.linalg.cross(up, z), up, z])


def azimuths(R: Tensor) -> Tensor:
    """From which side of the object each upright camera looks: degrees about y from +z: [views]."""
    return torch.rad2deg(torch.atan2(-R[:, 2, 0], -R[:, 2, 2]))
