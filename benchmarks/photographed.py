"""A run from made-up photographs that show silhouettes alone, to measure the mesh it comes to."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from silmesh.api import Reconstruction, reconstruct
from silmesh.geometry.frame import whole_frames

OBJECT, BACKGROUND = 150, 20  # grey


def reconstruct_silhouettes(
    names: Sequence[str],
    silhouettes: np.ndarray,
    frames: np.ndarray | None = None,
    pictures: Mapping[str, Image.Image] | None = None,
    **known: str,
) -> Reconstruction:
    """What becomes of photographs with masks, whose cameras are found by ``calibrate``.

    Args:
        silhouettes: [views, size, size] bool
        frames: [views, 4] of the photographs within these; the whole images if not given
        pictures: by name, to be the photographs; grey on grey if not given
        known: what else ``silmesh.reconstruct`` takes
    """
    frames = whole_frames(silhouettes) if frames is None else frames
    with TemporaryDirectory() as folder:
        photographs, masks = Path(folder) / "photographs", Path(folder) / "masks"
        photographs.mkdir()
        masks.mkdir()
        for name, seen, (left, top, right, bottom) in zip(names, silhouettes, frames, strict=True):
            part = seen[top:bottom, left:right]
            grey = np.where(part, OBJECT, BACKGROUND).astype(np.uint8)
            picture = pictures[name] if pictures else Image.fromarray(np.stack([grey] * 3, axis=2))
            picture.save(photographs / f"{name}.png")
            Image.fromarray(part.astype(np.uint8) * 255).save(masks / f"{name}.png")
        size = silhouettes.shape[1]
        return reconstruct(photographs, masks, "calibrate", size=size, **known)


def measure_fit(made: Reconstruction) -> dict[str, float]:
    """IoU of the mesh with the silhouettes, and of their hull: means and least."""
    return {
        "coherence": float(made.scene.coherence.mean()),
        "coherence_least": float(made.scene.coherence.min()),
        "iou": float(made.metrics["iou_mean"]),
        "iou_least": float(made.metrics["iou_min"]),
    }
