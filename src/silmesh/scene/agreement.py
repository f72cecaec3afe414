"""How well cameras agree with silhouettes, and which of several attempts is taken."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from silmesh.cameras.attempt import TRY_CALIBRATE, Attempt
from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras, Similarity
from silmesh.geometry.silhouette_iou import coherence
from silmesh.geometry.thresholds import COHERENT, REFUSED
from silmesh.geometry.undistortion import Undistorted, undistort
from silmesh.geometry.visual_hull import carve, find_enclosed
from silmesh.scene.outliers import find_outliers
from silmesh.scene.scene import find_similarity, refuse_enclosed

FEWEST = 2  # least number of silhouettes that are not empty
# Of attempts whose hull IoU differs by less than this, the one with the most views is taken.
NEAR = 0.02
ROUNDS = 2  # of looking for outliers among the views that are left


@dataclass(frozen=True)
class Normalised:
    """Cameras in the normalised world.

    Attributes:
        cameras: in that world, without lenses
        undistorted: how the pictures become those of these cameras
        similarity: from the cameras' own world to it
        coherence: [views], the hull's IoU with each silhouette; 0 where that is empty
        contradicted: positions of the views whose silhouettes the others contradict: the hull is
            that of the others
        empty: positions of the views whose silhouette is empty
    """

    cameras: Cameras
    undistorted: Undistorted
    similarity: Similarity
    coherence: np.ndarray
    contradicted: tuple[int, ...] = ()
    empty: tuple[int, ...] = ()

    @property
    def mean(self) -> float:
        """The mean coherence of the views that say something and are not contradicted."""
        return float(np.delete(self.coherence, [*self.contradicted, *self.empty]).mean())


def find_shown(silhouettes: np.ndarray) -> np.ndarray:
    """Positions of the views whose silhouette is not empty; an empty one says nothing."""
    return np.flatnonzero(silhouettes.any(axis=(1, 2)))


def normalise(
    cameras: Cameras,
    silhouettes: np.ndarray,
    keep_world: bool = False,
    resolution: int = 128,
    frames: np.ndarray | None = None,
    suspects: Collection[str] = (),
) -> Normalised:
    """Take the cameras' lenses away, normalise their world and measure their coherence.

    The views whose silhouette is empty have no say in it. If the coherence is low, those have none
    either whose silhouettes most others contradict, if the others then are more coherent.

    Args:
        cameras: in their own world
        silhouettes: [views, height, width] bool, of the cameras' views
        keep_world: it is normalised already
        resolution: of the hull, as ``carve`` takes it
        frames: [views, 4] of the photographs within the images; the whole images if not given
        suspects: views that the cameras' source names as contradicted, left out first

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
    kept, silhouettes = cameras.select(shown), silhouettes[shown]
    spoken = undistorted.frames[shown]
    all_views = np.arange(len(shown))
    outlined = _find_outlined(silhouettes)
    found = _measure(kept, silhouettes, spoken, outlined, all_views, keep_world, resolution)
    contradicted = all_views[:0]
    if found[1].mean() < COHERENT:
        found, contradicted = _measure_without_outliers(
            found, kept, silhouettes, spoken, keep_world, resolution, suspects
        )
    similarity, shares = found
    cameras = cameras.in_world_of(similarity)
    left = np.setdiff1d(all_views, contradicted)
    inside = cameras.select(shown[left])
    refuse_enclosed(inside, find_enclosed(silhouettes[left], inside, spoken[left]))
    agreement = np.zeros(len(cameras))
    agreement[shown] = shares
    empty = np.setdiff1d(np.arange(len(cameras)), shown)
    outliers = shown[contradicted]
    return Normalised(
        cameras, undistorted, similarity, agreement, tuple(outliers.tolist()), tuple(empty.tolist())
    )


def _find_outlined(silhouettes: np.ndarray) -> np.ndarray:
    """Positions of the silhouettes that do not fill their images, if they are the most."""
    outlined = np.flatnonzero(~silhouettes.all(axis=(1, 2)))
    return outlined if 2 * len(outlined) > len(silhouettes) else np.arange(len(silhouettes))


def _measure(
    cameras: Cameras,
    silhouettes: np.ndarray,
    frames: np.ndarray,
    placing: np.ndarray,
    carving: np.ndarray,
    keep_world: bool,
    resolution: int,
) -> tuple[Similarity, np.ndarray]:
    """The world that some views span, and the coherence of all with the hull of some: [views]."""
    similarity = (
        Similarity.identity()
        if keep_world
        else find_similarity(cameras.select(placing), silhouettes[placing], frames[placing])
    )
    cameras = cameras.in_world_of(similarity)
    chosen = cameras.select(carving)
    hull = carve(silhouettes[carving], chosen, resolution, frames=frames[carving])
    return similarity, coherence(hull, cameras, silhouettes, frames)


def _measure_without_outliers(
    found: tuple[Similarity, np.ndarray],
    cameras: Cameras,
    silhouettes: np.ndarray,
    frames: np.ndarray,
    keep_world: bool,
    resolution: int,
    suspects: Collection[str],
) -> tuple[tuple[Similarity, np.ndarray], np.ndarray]:
    """What ``_measure`` finds without the views that most others contradict, and those.

    In rounds, since the worst outliers hide others. Views are left out only if the rest is more
    coherent without them, and they are fewer than half.
    """
    everyone = np.arange(len(silhouettes))
    inliers, best = everyone, found[1].mean()
    left = np.array([i for i in everyone if cameras.views[i] not in suspects])
    if FEWEST <= len(left) < len(everyone):
        again = _measure(cameras, silhouettes, frames, left, left, keep_world, resolution)
        if again[1][left].mean() >= max(COHERENT, best):
            return again, np.setdiff1d(everyone, left)
    for _ in range(ROUNDS):
        verdict = find_outliers(
            silhouettes[inliers], cameras.select(inliers).in_world_of(found[0]), frames[inliers]
        )
        left = inliers[verdict.inliers]
        if verdict.refusal or not verdict.outliers or 2 * len(left) <= len(everyone):
            break
        again = _measure(cameras, silhouettes, frames, left, left, keep_world, resolution)
        mean = again[1][left].mean()
        if mean < best + NEAR:
            break
        found, inliers, best = again, left, mean
        if best >= COHERENT:
            break
    return found, np.setdiff1d(everyone, inliers)


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
        normalised = normalise(attempt.cameras, silhouettes, frames=frames)
    except InputError as error:
        why = f"cameras {attempt.source!r}: {error}"
        return replace(attempt, cameras=None, refusal=why)
    mean, views = normalised.mean, attempt.cameras.views
    figures = {"coherence": mean, "contradicted": [views[i] for i in normalised.contradicted]}
    attempt = replace(attempt, figures={**attempt.figures, **figures})
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
