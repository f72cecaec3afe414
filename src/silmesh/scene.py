"""The scene: the views that are fitted, their silhouettes and cameras, in the normalised world.

A scene's folder holds ``cameras.json`` (normalised), ``scene.json`` (the transform, how well
silhouettes and cameras agree, where the cameras come from), and the working images and silhouettes
of just the views that have a camera, in ``views/`` and ``silhouettes/``, undistorted where their
lenses matter.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from silmesh.cameras.camera import (
    OBJECT_RADIUS,
    Cameras,
    Similarity,
    read_cameras,
    write_cameras,
)
from silmesh.errors import InputError, name_some
from silmesh.files import making
from silmesh.straighten import Straightened

VIEWS, SILHOUETTES = "views", "silhouettes"  # folders of a scene


def normalising(cameras: Cameras, silhouettes: np.ndarray) -> Similarity:
    """The shift and scale that bring the object into the sphere of radius 0.5 at the origin.

    The centre is where the rays through the middles of the silhouettes' bounding boxes meet, by
    least squares; the radius is the furthest that any silhouette reaches from it.

    Args:
        cameras: in the input's world
        silhouettes: [views, height, width] bool

    Raises:
        InputError: the rays are parallel, or the object would be behind a camera
    """
    points = [torch.as_tensor(np.argwhere(s)[:, ::-1] + 0.5) for s in silhouettes]
    centre, depth = find_object(cameras, silhouettes)
    if not (depth > 0).all():
        raise InputError(_say_behind(cameras, depth))
    projected = cameras.project(centre.unsqueeze(0))
    scale = cameras.K[:, :2, :2].inverse()  # [views, 2, 2] pixels to units at depth 1
    reach = [
        ((p - c) @ s.mT).norm(dim=1).max() for p, c, s in zip(points, projected, scale, strict=True)
    ]
    return Similarity(centre, float(OBJECT_RADIUS / (torch.stack(reach) * depth).max()))


def find_object(cameras: Cameras, silhouettes: np.ndarray) -> tuple[Tensor, Tensor]:
    """Where the rays through the middles of the silhouettes' boxes meet [3], its depths [views].

    Raises:
        InputError: the rays are parallel
    """
    centre = cameras.meet(find_middles(silhouettes))
    return centre, cameras.depths(centre.unsqueeze(0)).squeeze(1)


def find_middles(silhouettes: np.ndarray) -> Tensor:
    """The middles of the silhouettes' bounding boxes, in pixels: [views, 2] float64."""
    middles = []
    for seen in silhouettes:
        rows, columns = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
        middles.append([columns[0] + columns[-1] + 1, rows[0] + rows[-1] + 1])
    return torch.tensor(middles, dtype=torch.float64) / 2


def _say_behind(cameras: Cameras, depth: Tensor) -> str:
    behind = [view for view, d in zip(cameras.views, depth.tolist(), strict=True) if not d > 0]
    view = cameras.views[int(depth.argmin())]
    if len(behind) == len(cameras):
        return (
            f"view {view!r}: the object would lie behind its camera, and behind those of all views:"
            " the cameras look away from it"
        )
    others = f" ({name_some(behind)})"
    return (
        f"view {view!r}: the object would lie behind its camera: {len(behind)} of {len(cameras)} "
        f"cameras look away from it{others * (len(behind) > 1)}; the cameras and the silhouettes "
        "should be of the same photographs"
    )


def refuse_camera_inside(cameras: Cameras) -> None:
    """Refuse a camera within the sphere of the normalised world that holds the object."""
    distance = cameras.centres.norm(dim=1)
    nearest = int(distance.argmin())
    if distance[nearest] <= OBJECT_RADIUS:
        raise InputError(
            f"the camera of view {cameras.views[nearest]!r} stands inside the object: "
            f"{distance[nearest]:.3g} from its middle, when the object reaches {OBJECT_RADIUS}"
        )


def write_scene(
    folder: Path,
    cameras: Cameras,
    similarity: Similarity,
    coherence: np.ndarray,
    pictures: Mapping[str, Path],
    told: Mapping[str, Any],
    straightened: Straightened | None = None,
) -> None:
    """Write a scene.

    Args:
        cameras: in the normalised world
        similarity: from the input's own world to that one
        coherence: [views]
        pictures: the folders of the working images, ``views``, and of the ``silhouettes``
        told: what else ``scene.json`` says, also of an undistortion that was before
        straightened: how the pictures become those of the cameras, if any had a lens
    """
    straightened = straightened or Straightened(cameras, {}, 0.0)
    scene = {
        "undistorted": len(straightened.sources),
        "displacement": straightened.displacement,
        **told,
        "centre": similarity.centre.tolist(),
        "scale": similarity.scale,
        "hull_iou_mean": float(coherence.mean()),
        "hull_iou": dict(zip(cameras.views, coherence.tolist(), strict=True)),
    }
    with making(folder) as part:
        write_cameras(part / "cameras.json", cameras)
        write = {VIEWS: straightened.write_image, SILHOUETTES: straightened.write_silhouette}
        for name, source in pictures.items():
            (part / name).mkdir()
            for view in cameras.views:
                write[name](view, source / f"{view}.png", part / name / f"{view}.png")
        (part / "scene.json").write_text(json.dumps(scene, indent=1) + "\n", encoding="utf-8")


def read_scene(folder: Path) -> tuple[Cameras, Similarity, dict]:
    """The normalised cameras, the transform into their world, and all of ``scene.json``."""
    scene = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
    centre = torch.tensor(scene["centre"], dtype=torch.float64)
    return read_cameras(folder / "cameras.json"), Similarity(centre, scene["scale"]), scene
