"""The fitted surface, moved to where the photographs agree: hollows that no outline shows."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh

from silmesh.geometry.camera import Cameras
from silmesh.geometry.originals import Originals
from silmesh.progress import Share, untold

OUTLINE, PHOTOGRAPHS, GUESS = 0, 1, 2  # what a vertex stands on
STANDINGS = ("outline", "photographs", "guess")  # their names, in this order


@dataclass(frozen=True)
class Relief:
    """A refined surface.

    Attributes:
        verts: [verts, 3] in the cameras' world
        faces: [faces, 3], closed, the outside counterclockwise
        standing: [verts] uint8, what each vertex stands on, a position in ``STANDINGS``
        changed: whether the surface is another than the one that was given
        notes: for JSON: the share of each standing, the depths that were found, seconds, and why
            the surface stays as it is if it does
    """

    verts: np.ndarray
    faces: np.ndarray
    standing: np.ndarray
    changed: bool
    notes: dict[str, Any]


def refine(
    mesh: trimesh.Trimesh,
    originals: Originals,
    silhouettes: np.ndarray,
    cameras: Cameras,
    kept: Sequence[int] | None = None,
    seed: int = 0,
    progress: Share = untold,
) -> Relief:
    """Move a surface to where the photographs agree; where they do not it stays as it is.

    Args:
        mesh: closed, in the world of the cameras; it bounds the object from outside
        originals: the photographs, with cameras in the same world and order as ``cameras``
        silhouettes: [views, height, width] bool, of the working images, without lenses
        cameras: in pixels of the working images
        kept: positions of the views that are believed; all if not given
        seed: of the random guesses; the same seed gives the same surface
        progress: is told which share is done
    """
    standing = np.full(len(mesh.vertices), OUTLINE, np.uint8)
    notes = {"changed": False, "reason": "no depths were looked for"}
    return Relief(np.asarray(mesh.vertices), np.asarray(mesh.faces), standing, False, notes)
