"""Silhouettes of a made-up body through a whole turn of a turntable."""

import numpy as np
from scenes import names, silhouettes
from torch import full, tensor

from silmesh.cameras.turntable import orbit_cameras

SIZE = 48
LONG, ROUND = (0.42, 0.3, 0.16), (0.2, 0.4, 0.2)  # half axes: a flat body, and one of a lathe


def turn(count: int, elevation: float, axes=LONG, way: int = 1) -> np.ndarray:
    """A whole turn around an ellipsoid that stands off the axis."""
    azimuth = [way * (40 + 360 * i / count) for i in range(count)]
    distance, raised = full((count,), 2.732), full((count,), float(elevation))
    cameras = orbit_cameras(
        names(count), SIZE, distance.double(), raised.double(), tensor(azimuth).double()
    )
    return silhouettes(cameras, axes, (0.06, 0.02, 0.03))
