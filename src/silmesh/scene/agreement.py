"""How well cameras agree with silhouettes, and which of several attempts is taken."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from silmesh.cameras.attempt import TRY_CALIBRATE, Attempt
from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras, Similarity
from silmesh.geometry.silhouette_iou import coherence
from silmesh.geometry.thresholds import REFUSED
from silmesh.geometry.undistortion import Undistorted, undistort
from silmesh.geometry.visual_hull import carve, find_enclosed
from silmesh.scene.scene import find_similarity, refuse_enclosed

FEWEST = 2  # least number of silhouettes that are not empty
# Of attempts whose hull IoU differs by less than this, the one with the most views is taken.
NEAR = 0.02


@dataclass(frozen=True)
class Normalised:
    """Cameras in the normalised world.

    Attributes:
        cameras: in that world, without lenses
        undistorted: how the pictures become those of these cameras
        similarity: from the cameras' own world to it
        coherence: [views], the hull's IoU with each silhouette; 0 where that is empty
    """

    cameras: Cameras
    undistorted: Undistorted
    similarity: Similarity
    coherence: np.ndarray

    @property
    def mean(self) -> float:
        """The mean coherence."""
        return float(self.coherence.mean())


def find_shown(silhouettes: np.ndarray) -> np.ndarray:
    """Positions of the views whose silhouette is not empty; an empty one says nothing."""
    return np.flatnonzero(silhouettes.any(axis=(1, 2)))


def normalise(
    cameras: Cameras,
    silhouettes: np.ndarray,
    keep_world: bool = False,
    resolution: int = 128,
    frames: np.ndarray | None = None,
) -> Normalised:
    """Take the cameras' lenses away, normalise their world and measure their coherence.

    The views whose silhouette is empty have no say in it.

    Args:
        cameras: in their own world
        silhouettes: [views, height, width] bool, of the cameras' views
        keep_world: it is normalised already
        resolution: of the hull, as ``carve`` takes it
        frames: [views, 4] of the photographs within the images; the whole images if not given

    Raises:
        InputError: the cameras do not look at one object, one stands inside it, or fewer than two
            silhouettes show it
    """
    shown = find_shown(silhouettes)
    if len(shown) < FEWEST:
        raise InputError(
            f"{len(shown)} of the {len(cameras)} views with a camera have a silhouette that is not "
            f"empty; should be {FEWEST} or more"
        )
    undistorted = undistort(cameras, silhouettes, frames)
    cameras, silhouettes = undistorted.cameras, undistorted.silhouettes(silhouettes)
    kept, silhouettes, spoken = (
        cameras.select(shown),
        silhouettes[shown],
        undistorted.frames[shown],
    )
    similarity = Similarity.identity() if keep_world else find_similarity(kept, silhouettes, spoken)
    cameras, kept = cameras.in_world_of(similarity), kept.in_world_of(similarity)
    refuse_enclosed(kept, find_enclosed(silhouettes, kept, spoken))
    agreement = np.zeros(len(cameras))
    hull = carve(silhouettes, kept, resolution, frames=spoken)
    agreement[shown] = coherence(hull, kept, silhouettes, spoken)
    return Normalised(cameras, undistorted, similarity, agreement)


def refuse_incoherent(
    attempt: Attempt, silhouettes: np.ndarray, frames: np.ndarray | None = None
) -> Attempt:
    """The attempt with its ``coherence`` among its figures, or refused for it.

    Args:
        silhouettes: [views, height, width] bool, of the views that have a camera
        frames: [views, 4] of their photographs within the images, as ``place`` takes them
    """
    if attempt.cameras is None:
        return attempt
    try:
        mean = normalise(attempt.cameras, silhouettes, frames=frames).mean
    except InputError as error:
        why = f"cameras {attempt.source!r}: {error}"
        return replace(attempt, cameras=None, refusal=why)
    attempt = replace(attempt, figures={**attempt.figures, "coherence": mean})
    if mean >= REFUSED:
        return attempt
    why = (
        f"cameras {attempt.source!r}: {len(attempt.cameras)} photographs have a camera, but the "
        f"silhouettes contradict these: the largest body that they all allow fills {mean:.0%} of "
        f"them (at least {REFUSED:.0%} is asked). Perhaps the photographs were aligned by a "
        "background that stands still while the object turns (which masks leave out), or the "
        f"silhouettes are not the object's{TRY_CALIBRATE}"
    )
    return replace(attempt, cameras=None, refusal=why)


def choose(attempts: Sequence[Attempt], candidates: Sequence[Normalised | None]) -> tuple[int, str]:
    """Which attempt to take, and why: the most coherent.

    Of those that come within ``NEAR`` of it the one with the most views is taken, and of these
    again the most coherent: fewer views contradict each other less.

    Args:
        candidates: None where an attempt was refused; not all are
    """
    there = [i for i, p in enumerate(candidates) if p is not None]
    most = max(candidates[i].mean for i in there)
    near = [i for i in there if candidates[i].mean >= most - NEAR]
    best = max(near, key=lambda i: (len(candidates[i].cameras), candidates[i].mean))
    return best, _say_why(best, attempts, candidates)


def _say_why(
    best: int, attempts: Sequence[Attempt], candidates: Sequence[Normalised | None]
) -> str:
    others = [
        f"{attempt.source}: {refused_or(attempt, p)}"
        for i, (attempt, p) in enumerate(zip(attempts, candidates, strict=True))
        if i != best
    ]
    own = f"{attempts[best].source}: {refused_or(attempts[best], candidates[best])}"
    return "; ".join([own, *others])


def refused_or(attempt: Attempt, normalised: Normalised | None) -> str:
    """An attempt's coherence and views, or why it has no cameras."""
    if normalised is None:
        return f"no cameras ({attempt.refusal})"
    return f"hull IoU {normalised.mean:.3f} over {len(normalised.cameras)} views"
