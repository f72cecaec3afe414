"""Trial fits by the report's procedure, which ``shape: auto`` compares initial meshes by."""

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np
import torch
import trimesh

from silmesh.fitting.loop import NotFinite
from silmesh.fitting.softras import SoftRas
from silmesh.geometry.camera import Cameras
from silmesh.geometry.mesh_files import to_tensors
from silmesh.settings.fit import SoftRasFit


def trial_with(
    settings: SoftRasFit,
) -> Callable[[trimesh.Trimesh, Cameras, np.ndarray, np.ndarray | None], Iterator[float]]:
    """A function that fits a mesh at unit size to silhouettes [views, height, width] bool.

    It also takes which pixels count, likewise, or None for all. It yields the loss before each
    step, without the limit ``iterations``, and ends if a number is not finite.
    """

    def trial(
        mesh: trimesh.Trimesh,
        cameras: Cameras,
        silhouettes: np.ndarray,
        known: np.ndarray | None = None,
    ) -> Iterator[float]:
        target = torch.tensor(silhouettes, dtype=torch.float32)
        counted = None if known is None else torch.tensor(known, dtype=torch.float32)
        fit = SoftRas(*to_tensors(mesh), cameras, target, settings, None, counted)
        with suppress(NotFinite):
            while True:  # for as long as it is asked
                yield fit.step()["loss"]

    return trial
