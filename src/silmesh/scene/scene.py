"""The scene: the views that are fitted, their silhouettes and cameras, in the normalised world.

A scene's folder holds ``cameras.json`` (normalised), ``scene.json`` (the transform, how well
silhouettes and cameras agree, where the cameras come from), and the working images and silhouettes
of just the views that have a camera, in ``views/`` and ``silhouettes/``, undistorted where their
lenses matter. ``points.npy``, if it is there, has points of structure from motion, in the input's
own world, by which an object is placed that most frames cut.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from silmesh.ahead import ahead
from silmesh.errors import InputError, name_some
from silmesh.files import making
from silmesh.geometry.camera import (
    OBJECT_RADIUS,
    Cameras,
    Similarity,
    read_cameras,
    write_cameras,
)
from silmesh.geometry.frame import find_box, find_shown, find_whole, is_cut
from silmesh.geometry.small_images import LARGEST
from silmesh.geometry.undistortion import Undistorted
from silmesh.geometry.whereabouts import find_body
from silmesh.silhouettes import read_silhouettes, write_silhouette
from silmesh.views import ImageFolder

AROUND = 0.05  # mean squared sine of the angles to the line that most cameras look along
VIEWS, SILHOUETTES = "views", "silhouettes"  # folders of a scene
POINTS = "points.npy"  # in its folder


@dataclass(frozen=True)
class Scene:
    """The views that are fitted, in the normalised world.

    Attributes:
        cameras: of these views, in that world, without lenses
        similarity: from the input's own world to it
        silhouettes: [views, height, width] bool, undistorted
        coherence: [views], the visual hull's IoU with each silhouette
        notes: the other entries of ``scene.json``
        images: the working images, undistorted
        points: [n, 3] by which the world is normalised if most frames cut the object, in the
            input's own world
    """

    cameras: Cameras
    similarity: Similarity
    silhouettes: np.ndarray
    coherence: np.ndarray
    notes: Mapping[str, Any]
    images: Mapping[str, Image.Image] = field(default_factory=dict)
    points: np.ndarray | None = None

    @property
    def frames(self) -> np.ndarray | None:
        """Left, top, right and bottom of the photographs within the images: [views, 4].

        None if it is not noted, as of views that fill their images.
        """
        return find_frames(self.notes, self.cameras.views)

    def without_empty(self) -> "Scene":
        """The same without the views whose silhouette is empty; the scene itself if none is."""
        shown = find_shown(self.silhouettes)
        if len(shown) == len(self.silhouettes):
            return self
        return replace(
            self,
            cameras=self.cameras.select(shown.tolist()),
            silhouettes=self.silhouettes[shown],
            coherence=self.coherence[shown],
        )

    def describe(self) -> dict[str, Any]:
        """All that ``scene.json`` says."""
        return {
            **self.notes,
            "centre": self.similarity.centre.tolist(),
            "scale": self.similarity.scale,
            "hull_iou_mean": float(self.coherence.mean()),
            "hull_iou": dict(zip(self.cameras.views, self.coherence.tolist(), strict=True)),
        }


def find_frames(notes: Mapping[str, Any], views: Sequence[str]) -> np.ndarray | None:
    """The frames [views, 4] that ``scene.json`` notes of some views, None if it notes none."""
    frames = notes.get("frames")
    return None if frames is None else np.array([frames[view] for view in views])


MEASURED = ("centre", "scale", "hull_iou_mean", "hull_iou")  # keys of scene.json beside the notes


def find_similarity(
    cameras: Cameras,
    silhouettes: np.ndarray,
    frames: np.ndarray | None = None,
    points: np.ndarray | None = None,
) -> Similarity:
    """The shift and scale that bring the object into the sphere of radius 0.5 at the origin.

    The centre is where the rays through the middles of the silhouettes' bounding boxes meet, by
    least squares; the radius is the furthest that any silhouette reaches from it. Silhouettes that
    the frame cuts have no say in that; if the others are too few, or all seen along one line, the
    object is looked for where most views see it, and where points on it lie.

    Args:
        cameras: in the input's world
        silhouettes: [views, height, width] bool, none empty
        frames: [views, 4] of the photographs within the images; the whole images if not given
        points: [n, 3] of structure from motion in the same world, of whatever was photographed

    Raises:
        InputError: the rays are parallel, or the object would be behind a camera
    """
    if is_cut(silhouettes, frames).any():
        whole = find_whole(silhouettes, frames)
        if len(whole) == len(silhouettes) or not _look_around(cameras.select(whole)):
            return find_body(cameras, silhouettes, frames, points)
        cameras, silhouettes = cameras.select(whole), silhouettes[whole]
    points = (torch.as_tensor(_find_furthest(s)[:, ::-1] + 0.5) for s in silhouettes)
    centre, depth = find_object(cameras, silhouettes)
    if not (depth > 0).all():
        raise InputError(_say_behind(cameras, depth))
    projected = cameras.project(centre.unsqueeze(0))
    scale = cameras.K[:, :2, :2].inverse()  # [views, 2, 2] pixels to units at depth 1
    reach = [
        ((p - c) @ s.mT).norm(dim=1).max() for p, c, s in zip(points, projected, scale, strict=True)
    ]
    return Similarity(centre, float(OBJECT_RADIUS / (torch.stack(reach) * depth).max()))


def _find_furthest(silhouette: np.ndarray) -> np.ndarray:
    """Rows and columns [n, 2] of pixels among which is that furthest from any point.

    Those are the ends of the rows; of a small silhouette all pixels.
    """
    if max(silhouette.shape) <= LARGEST:
        return np.argwhere(silhouette)
    rows = np.flatnonzero(silhouette.any(axis=1))
    first = silhouette[rows].argmax(axis=1)
    last = silhouette.shape[1] - 1 - silhouette[rows, ::-1].argmax(axis=1)
    return np.concatenate([np.stack([rows, end], axis=1) for end in (first, last)])


def _look_around(cameras: Cameras) -> bool:
    """Whether cameras look from several sides, so that depths are seen as widths by others."""
    ahead = cameras.R[:, 2]
    spread = torch.linalg.eigvalsh(torch.eye(3).to(ahead) - ahead.mT @ ahead / len(cameras))
    return bool(spread[0] > AROUND)


def find_object(cameras: Cameras, silhouettes: np.ndarray) -> tuple[Tensor, Tensor]:
    """Where the rays through the middles of the silhouettes' boxes meet [3], its depths [views].

    Raises:
        InputError: the rays are parallel
    """
    centre = cameras.meet(find_middles(silhouettes))
    return centre, cameras.depths(centre.unsqueeze(0)).squeeze(1)


def find_middles(silhouettes: np.ndarray) -> Tensor:
    """The middles of the silhouettes' bounding boxes, in pixels: [views, 2] float64."""
    boxes = torch.tensor([find_box(s) for s in silhouettes], dtype=torch.float64)
    return (boxes[:, :2] + boxes[:, 2:]) / 2


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


def refuse_enclosed(cameras: Cameras, enclosed: Sequence[int]) -> None:
    """Refuse cameras that stand inside the visual hull of the other views.

    Args:
        cameras: in the normalised world
        enclosed: positions of those, as ``find_enclosed`` gives them
    """
    if not len(enclosed):
        return
    distance = cameras.centres.norm(dim=1)
    nearest = min(enclosed, key=lambda i: float(distance[i]))
    others = f", and {len(enclosed) - 1} others do" * (len(enclosed) > 1)
    raise InputError(
        f"the camera of view {cameras.views[nearest]!r} stands inside the object: "
        f"{distance[nearest]:.3g} from its middle, when the object reaches {OBJECT_RADIUS}, and "
        f"all views that see the place see it within their silhouettes{others}"
    )


def write_scene(
    folder: Path, scene: Scene, images: Path, undistorted: Undistorted | None = None
) -> None:
    """Write a scene.

    Args:
        images: the folder of the working images, ``<view>.png``
        undistorted: how these become the images of the cameras, if any had a lens
    """
    undistorted = undistorted or Undistorted(scene.cameras, {}, 0.0)
    with making(folder) as part:
        write_cameras(part / "cameras.json", scene.cameras)
        if scene.points is not None:
            np.save(part / POINTS, scene.points)
        for name in (VIEWS, SILHOUETTES):
            (part / name).mkdir()

        def write(place: int) -> None:
            view = scene.cameras.views[place]
            name = f"{view}.png"
            undistorted.write_image(view, images / name, part / VIEWS / name)
            write_silhouette(part / SILHOUETTES / name, scene.silhouettes[place])

        for _ in ahead(write, range(len(scene.cameras)), torch.get_num_threads()):
            pass
        said = json.dumps(scene.describe(), indent=1)
        (part / "scene.json").write_text(said + "\n", encoding="utf-8")


def load_scene(folder: Path) -> Scene:
    """The scene that a folder holds."""
    cameras, similarity, whole = read_scene(folder)
    coherence = np.array([whole["hull_iou"][view] for view in cameras.views])
    notes = {key: value for key, value in whole.items() if key not in MEASURED}
    silhouettes = read_silhouettes(folder / SILHOUETTES, cameras.views, torch.get_num_threads())
    images = ImageFolder(folder / VIEWS)
    points = np.load(folder / POINTS) if (folder / POINTS).is_file() else None
    return Scene(cameras, similarity, silhouettes, coherence, notes, images, points)


def read_scene(folder: Path) -> tuple[Cameras, Similarity, dict]:
    """The normalised cameras, the transform into their world, and all of ``scene.json``."""
    scene = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
    centre = torch.tensor(scene["centre"], dtype=torch.float64)
    return read_cameras(folder / "cameras.json"), Similarity(centre, scene["scale"]), scene
