"""``shape: auto``: every first mesh is fitted for a few steps in small images."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from silmesh.cameras.camera import Cameras
from silmesh.shapes.looks import look_smaller

SIZE, VIEWS = 64, 12  # of the looks in which meshes are tried
VERTICES = 642  # of the meshes that are tried
STEPS = 80  # of the fit; its loss is the mean of the last quarter, for single steps are noisy

# Fits a mesh at unit size to silhouettes [views, height, width] bool for so many steps; gives the
# loss before each step and after the last.
Trial = Callable[[trimesh.Trimesh, Cameras, np.ndarray, int], Sequence[float]]


@dataclass(frozen=True)
class Score:
    """How a first mesh did: the loss before the fit and at the end of its few steps."""

    before: float
    after: float


def score_meshes(
    meshes: Mapping[str, trimesh.Trimesh],
    silhouettes: np.ndarray,
    cameras: Cameras,
    trial: Trial,
) -> dict[str, Score]:
    """Try each first mesh; the best come first.

    Args:
        meshes: at unit size
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        trial: fits for a few steps
    """
    small, eyes = look_smaller(silhouettes, cameras, SIZE, VIEWS)
    scores = {}
    for name, mesh in meshes.items():
        losses = trial(mesh, eyes, small, STEPS)
        scores[name] = Score(losses[0], float(np.mean(losses[-(STEPS // 4) :])))
    return dict(sorted(scores.items(), key=lambda item: item[1].after))
