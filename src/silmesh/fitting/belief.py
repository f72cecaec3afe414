"""How far a fit believes the views: what contradicts the other views has no say.

The visual hull of the others judges each view (``silmesh.geometry.robust_hull``). Where the hull of
all silhouettes explains them, which is the rule, every view and pixel counts as it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from silmesh.errors import name_some
from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import known_pixels
from silmesh.geometry.robust_hull import robust_carve
from silmesh.geometry.silhouette_iou import SHARP, as_sharp, known_iou
from silmesh.geometry.small_images import LARGEST, shrink, shrink_silhouettes
from silmesh.scene.scene import Scene


@dataclass(frozen=True)
class Belief:
    """What counts of the views that a fit is to see.

    Attributes:
        views: their positions in the scene, without those that have no weight
        weights: [views] how much each counts
        known: [views, height, width] bool, the pixels that count; None if all do
        distrusted: names of the views that lost all weight because the others contradict them
        corrected: names of those of which a part does not count
    """

    views: list[int]
    weights: np.ndarray
    known: np.ndarray | None
    distrusted: Sequence[str] = ()
    corrected: Sequence[str] = ()

    @property
    def contested(self) -> int:
        """How many views do not count as they are."""
        return len(self.distrusted) + len(self.corrected)

    @property
    def warnings(self) -> list[str]:
        """What does not count, in sentences for a person."""
        said = []
        if self.distrusted:
            views = name_some(self.distrusted)
            said.append(f"the other views contradict {views}: no weight in the fit")
        if self.corrected:
            said.append(
                f"parts of the silhouettes contradict those of other views in "
                f"{name_some(self.corrected)}: they do not count in the fit"
            )
        return said

    def measure(self, verts: Tensor, faces: Tensor, cameras: Cameras, scene: Scene) -> float:
        """Mean IoU of a mesh with what counts of the silhouettes; of large ones in small images.

        Args:
            verts: [verts, 3] float32 in the cameras' world
            faces: [faces, 3] int64
            cameras: of all views of the scene
        """
        silhouettes, known = scene.silhouettes[self.views], self.known
        small, seen = shrink(silhouettes, cameras.select(self.views), LARGEST)
        known = None if known is None else shrink_silhouettes(known, LARGEST)
        sharp = as_sharp(SHARP, small.shape[1:])
        values = known_iou(verts, faces, seen, small, sharp, known)
        return float(np.average(values, weights=self.weights))


def believe_all(scene: Scene, views: list[int]) -> Belief:
    """Everything that these views of a scene show.

    Args:
        views: their positions, of those that the scene gives weight
    """
    given = scene.notes.get("weights", {})
    weights = np.array([given.get(scene.cameras.views[i], 1.0) for i in views])
    return Belief(views, weights, known_pixels(scene.silhouettes[views], _frames(scene, views)))


def find_belief(scene: Scene, views: list[int], cameras: Cameras) -> Belief:
    """What these views of a scene show and the others do not contradict.

    Args:
        views: as ``believe_all`` takes them
        cameras: of all views, in the normalised world, by which they are judged
    """
    plain, cameras = believe_all(scene, views), cameras.select(views)
    hull = robust_carve(scene.silhouettes[views], cameras, _frames(scene, views))
    if not (hull.distrusted or hull.corrected):
        return plain
    return Belief(
        [views[i] for i in hull.trusted],
        plain.weights[hull.trusted],
        hull.count(plain.known),
        [cameras.views[i] for i in hull.distrusted],
        [cameras.views[i] for i in hull.corrected],
    )


def _frames(scene: Scene, views: list[int]) -> np.ndarray | None:
    return None if scene.frames is None else scene.frames[views]
