"""``shape: auto``: every first mesh is fitted for a few steps in small images."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
import trimesh
from torch import Tensor

from silmesh.cameras.camera import Cameras
from silmesh.meshes import to_tensors
from silmesh.shapes.looks import look_smaller

SIZE, VIEWS = 64, 12  # of the looks in which meshes are tried
VERTICES = 642  # of the meshes that are tried
STEPS = 60  # of the fit

# Fits a template [verts, 3] at unit size with faces [faces, 3] to silhouettes [views, height,
# width] for so many steps; returns the loss before each step and after the last.
Trial = Callable[[Tensor, Tensor, Cameras, Tensor, int], Sequence[float]]


@dataclass(frozen=True)
class Score:
    """How a first mesh did: the loss before the fit and after its few steps."""

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
    target = torch.tensor(small, dtype=torch.float32)
    scores = {}
    for name, mesh in meshes.items():
        losses = trial(*to_tensors(mesh), eyes, target, STEPS)
        scores[name] = Score(losses[0], losses[-1])
    return dict(sorted(scores.items(), key=lambda item: item[1].after))
