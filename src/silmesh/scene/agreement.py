"""How well cameras agree with silhouettes, and which of several attempts is taken."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from silmesh.cameras.attempt import TRY_CALIBRATE, Attempt
from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras, Similarity
from silmesh.geometry.frame import find_shown
from silmesh.geometry.robust_hull import robust_carve
from silmesh.geometry.silhouette_iou import coherence
from silmesh.geometry.small_images import LARGEST, shrink, shrink_frames
from silmesh.geometry.thresholds import COHERENT, REFUSED
from silmesh.geometry.undistortion import Undistorted, undistort
from silmesh.geometry.visual_hull import carve, find_enclosed
from silmesh.scene.scene import find_similarity, refuse_enclosed

FEWEST = 2  # least number of silhouettes that are not empty
# Of attempts whose hull IoU differs by less than this, the one with the most views is taken.
NEAR = 0.02
MOST_WRONG = 0.4  # of the views: of cameras that more of them contradict nothing is believed
MOVED = 0.05  # change of the world's scale by which the views are judged anew


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
        disbelieved: [views], the share of each silhouette's area that it shows or lacks although
            the others contradict it; 0 of those that are contradicted as a whole
        empty: positions of the views whose silhouette is empty
    """

    cameras: Cameras
    undistorted: Undistorted
    similarity: Similarity
    coherence: np.ndarray
    contradicted: tuple[int, ...] = ()
    empty: tuple[int, ...] = ()
    disbelieved: np.ndarray | None = None

    @property
    def mean(self) -> float:
        """The mean coherence of the views that say something and are not contradicted."""
        return float(np.delete(self.coherence, [*self.contradicted, *self.empty]).mean())

    @property
    def overall(self) -> float:
        """The same of all views that say something: that views are contradicted does not lift it.

        By it cameras are compared and refused, since wrong ones agree with a few views by chance.
        """
        return float(np.delete(self.coherence, self.empty).mean())

    @property
    def figures(self) -> dict[str, Any]:
        """What an attempt says of it among its figures, by which ``sparing`` decides."""
        return {
            "coherence": self.overall,
            "coherence_uncontradicted": self.mean,
            "contradicted": [self.cameras.views[i] for i in self.contradicted],
        }


def normalise(
    cameras: Cameras,
    silhouettes: np.ndarray,
    keep_world: bool = False,
    resolution: int = 128,
    frames: np.ndarray | None = None,
    suspects: Collection[str] = (),
    points: np.ndarray | None = None,
) -> Normalised:
    """Take the cameras' lenses away, normalise their world and measure their coherence.

    The views whose silhouette is empty have no say in it. If the coherence is low, those have none
    either that ``robust_carve`` does not believe, and the hull is the one that it carves. What it
    does not believe of the views that are left still counts as disagreement, so that it cannot make
    wrong cameras seem right.

    Args:
        cameras: in their own world
        silhouettes: [views, height, width] bool, of the cameras' views
        keep_world: it is normalised already
        resolution: of the hull, as ``carve`` takes it
        frames: [views, 4] of the photographs within the images; the whole images if not given
        suspects: views that the cameras' source names as contradicted, left out first
        points: [n, 3] that the cameras' source found, by which an object that most frames cut is
            placed

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
    kept = _Views(cameras.select(shown), silhouettes[shown], undistorted.frames[shown], points)
    all_views = np.arange(len(shown))
    outlined = _find_outlined(kept.silhouettes)
    found = _measure(kept, kept.select(outlined), kept, keep_world, resolution)
    if found.mean < COHERENT:
        found = _measure_believed(found, kept, keep_world, resolution, suspects)
    cameras = cameras.in_world_of(found.similarity)
    sound = kept.select(np.setdiff1d(all_views, found.contradicted)).in_world_of(found.similarity)
    refuse_enclosed(sound.cameras, find_enclosed(sound.silhouettes, sound.cameras, sound.frames))
    agreement, disbelieved = np.zeros((2, len(cameras)))
    agreement[shown], disbelieved[shown] = found.shares, found.disbelieved
    return Normalised(
        cameras,
        undistorted,
        found.similarity,
        agreement,
        tuple(shown[found.contradicted].tolist()),
        tuple(np.setdiff1d(np.arange(len(cameras)), shown).tolist()),
        disbelieved,
    )


class _Views(NamedTuple):
    """Views with a silhouette: their cameras, silhouettes [n, height, width] and frames [n, 4].

    And points [n, 3] by which their world may be normalised.
    """

    cameras: Cameras
    silhouettes: np.ndarray
    frames: np.ndarray
    points: np.ndarray | None = None

    def select(self, positions: np.ndarray) -> "_Views":
        return self._replace(
            cameras=self.cameras.select(positions),
            silhouettes=self.silhouettes[positions],
            frames=self.frames[positions],
        )

    def in_world_of(self, similarity: Similarity) -> "_Views":
        return self._replace(cameras=self.cameras.in_world_of(similarity), points=None)


def _find_outlined(silhouettes: np.ndarray) -> np.ndarray:
    """Positions of the silhouettes that do not fill their images, if they are the most."""
    outlined = np.flatnonzero(~silhouettes.all(axis=(1, 2)))
    return outlined if 2 * len(outlined) > len(silhouettes) else np.arange(len(silhouettes))


class _Found(NamedTuple):
    """What is measured: a world, [n] coherence, positions of views that had no say, [n] shares."""

    similarity: Similarity
    shares: np.ndarray
    contradicted: np.ndarray
    disbelieved: np.ndarray

    @property
    def mean(self) -> float:
        return float(np.delete(self.shares, self.contradicted).mean())


def _measure(
    views: _Views, placing: _Views, carving: _Views, keep_world: bool, resolution: int
) -> _Found:
    """The world that some views span, and the coherence of all with the hull of others."""
    similarity = Similarity.identity() if keep_world else find_similarity(*placing)
    views, carving = views.in_world_of(similarity), carving.in_world_of(similarity)
    hull = carve(carving.silhouettes, carving.cameras, resolution, frames=carving.frames)
    shares = coherence(hull, views.cameras, views.silhouettes, views.frames)
    said = set(carving.cameras.views)
    unheard = [i for i, view in enumerate(views.cameras.views) if view not in said]
    return _Found(similarity, shares, np.array(unheard, int), np.zeros(len(shares)))


def _measure_believed(
    found: _Found,
    views: _Views,
    keep_world: bool,
    resolution: int,
    suspects: Collection[str],
) -> _Found:
    """What ``_measure`` finds by what is believed, if that is more coherent and most views are."""
    names = views.cameras.views
    left = np.array([i for i, name in enumerate(names) if name not in suspects], int)
    if FEWEST <= len(left) < len(names):
        some = views.select(left)
        again = _measure(views, some, some, keep_world, resolution)
        if again.mean >= max(COHERENT, found.mean):
            return again
    again = _believe(found, views, keep_world, resolution)
    if again is None or again.mean < found.mean + NEAR:
        return found
    if abs(again.similarity.scale / found.similarity.scale - 1) > MOVED:
        once_more = _believe(again, views, keep_world, resolution)
        again = once_more if once_more and once_more.mean >= again.mean else again
    return again


def _believe(found: _Found, views: _Views, keep_world: bool, resolution: int) -> _Found | None:
    """The same by what ``robust_carve`` believes in the world that was found; None if it is all.

    Nor is anything found if more than ``MOST_WRONG`` of the views are not believed.
    """
    asked = views.in_world_of(found.similarity)
    verdict = robust_carve(asked.silhouettes, asked.cameras, asked.frames, resolution)
    wrong, parts = verdict.distrusted, verdict.disbelieved
    if not (wrong or verdict.corrected) or len(wrong) > MOST_WRONG * len(views.silhouettes):
        return None
    kept = verdict.trusted
    whole = np.setdiff1d(kept, verdict.corrected)
    placing = views.select(whole if 2 * len(whole) > len(kept) else kept)
    filled, cameras, frames = verdict.believed(views.silhouettes, views.cameras, views.frames)
    carving = _Views(cameras, filled, frames)
    again = _measure(views, placing, carving, keep_world, resolution)
    area = views.silhouettes.sum(axis=(1, 2))
    shares = np.where(verdict.reliability > 0, parts.sum(axis=(1, 2)) / area, 0)
    return again._replace(disbelieved=shares)


def normalise_small(
    attempt: Attempt, silhouettes: np.ndarray, frames: np.ndarray | None = None
) -> Normalised:
    """``normalise`` for an attempt's cameras, in images of ``LARGEST`` pixels at most.

    Judging asks for no more detail.
    """
    cameras = attempt.cameras
    if max(silhouettes.shape[1:]) > LARGEST:
        frames = shrink_frames(silhouettes, LARGEST, frames)
        silhouettes, cameras = shrink(silhouettes, cameras, LARGEST)
    return normalise(cameras, silhouettes, frames=frames, points=attempt.points)


def refuse_incoherent(
    attempt: Attempt, silhouettes: np.ndarray, frames: np.ndarray | None = None
) -> Attempt:
    """The attempt with its ``coherence`` among its figures, or refused for it.

    Args:
        silhouettes: [views, height, width] bool, of the views that have a camera
        frames: [views, 4] of their photographs within the images, as ``normalise`` takes them
    """
    if attempt.cameras is None:
        return attempt
    try:
        normalised = normalise_small(attempt, silhouettes, frames)
    except InputError as error:
        why = f"cameras {attempt.source!r}: {error}"
        return replace(attempt, cameras=None, refusal=why)
    mean = normalised.overall
    attempt = replace(attempt, figures={**attempt.figures, **normalised.figures})
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
    most = max(candidates[i].overall for i in there)
    near = [i for i in there if candidates[i].overall >= most - NEAR]
    best = max(near, key=lambda i: (len(candidates[i].cameras), candidates[i].overall))
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
    return f"hull IoU {normalised.overall:.3f} over {len(normalised.cameras)} views"
