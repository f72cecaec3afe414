"""A made-up body without symmetry, photographed before and after it was turned over."""

from dataclasses import replace

import numpy as np
import torch
from scenes import silhouettes
from scipy.spatial.transform import Rotation

from silmesh.cameras.turntable import orbit_cameras
from silmesh.geometry.camera import Cameras

SIZE, COUNT = 64, 10
ROD, ARM, KNOB = (0.12, 0.42, 0.14), (0.3, 0.08, 0.1), (0.1, 0.1, 0.16)  # half axes
BODY = ((ROD, (0, 0, 0)), (ARM, (0.15, 0.2, 0)), (KNOB, (-0.05, -0.25, 0.18)))
Q, SCALE, SHIFT = Rotation.from_euler("xyz", (170, 25, -60), degrees=True).as_matrix(), 1.1, 0.04


def ring(name: str, elevation: float) -> Cameras:
    """A whole turn of cameras above the table."""
    same = torch.ones(COUNT, dtype=torch.float64)
    azimuth = 15 + 360 / COUNT * torch.arange(COUNT, dtype=torch.float64)
    views = [f"{name}{i}" for i in range(COUNT)]
    return orbit_cameras(views, SIZE, 2.732 * same, elevation * same, azimuth)


def show(cameras: Cameras, body=BODY) -> np.ndarray:
    """What cameras see of ellipsoids: [views, SIZE, SIZE] bool."""
    return np.any([silhouettes(cameras, *part) for part in body], axis=0)


def turn_over(cameras: Cameras) -> Cameras:
    """Cameras of a world Y, as a world X = SCALE Q Y + SHIFT has them, up to the scale.

    R Y + t is R Q^T (X - SHIFT) / SCALE + t.
    """
    R = cameras.R @ torch.as_tensor(Q.T)
    t = SCALE * cameras.t - R @ torch.full((3,), SHIFT, dtype=torch.float64)
    return replace(cameras, R=R, t=t)
