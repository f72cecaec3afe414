"""Cameras that all contradict the silhouettes a little are turned, if that makes them agree.

Where a few views are wrong the others say so (``silmesh.geometry.robust_hull``). Where each camera
looks a degree or two aside, all views contradict each other, none more than another, and the visual
hull is a splinter. Then each camera is turned about its own centre
(``silmesh.cameras.directions``). The turns are taken only where the silhouettes agree by them, each
with the hull of the others no worse than before.
"""

from dataclasses import dataclass, replace

import numpy as np

from silmesh.cameras.directions import measure_turns, turn_to_agree
from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras
from silmesh.geometry.robust_hull import ENOUGH, predict_held_out
from silmesh.geometry.thresholds import CONVINCING
from silmesh.scene.agreement import Normalised, normalise

GAIN = 0.05  # of hull IoU: turns that gain less are not taken
# Nor are turns by which the others' hulls predict the silhouettes worse by more than this IoU. A
# hull of the others is larger than the object, so that it hardly shows half a degree.
WORSE = 0.01
LARGEST = 5.0  # degrees: cameras whose mean turn is larger are wrong otherwise
OPEN = 0.04  # of the object's size: a mesh that may lie so far from its place is doubtful


@dataclass(frozen=True)
class Reoriented:
    """What became of cameras.

    Attributes:
        found: the cameras in the normalised world
        said: how they were turned; empty if they were not
        doubt: what stays open although they agree, and what to do; empty if nothing does
    """

    found: Normalised
    said: str = ""
    doubt: str = ""


def reorient(found: Normalised, silhouettes: np.ndarray) -> Reoriented:
    """Turn incoherent cameras until the silhouettes agree.

    Args:
        found: the cameras in the normalised world
        silhouettes: [views, height, width] bool, undistorted, of these views
    """
    full = silhouettes.all(axis=(1, 2)).any()
    shown = np.flatnonzero(silhouettes.any(axis=(1, 2)))
    if found.mean >= CONVINCING or len(shown) < ENOUGH or full:
        return Reoriented(found)
    old, frames = found.cameras.select(shown), found.undistorted.frames
    turned = turn_to_agree(silhouettes[shown], old, frames[shown])
    turns = measure_turns(old, turned)
    if turns.mean() > LARGEST:
        return Reoriented(found)
    cameras = _put(found.cameras, shown, turned).in_world_of(found.similarity.inverse)
    try:
        again = normalise(cameras, silhouettes, frames=frames)
    except InputError:  # one came to stand in the hull
        return Reoriented(found)
    parts = silhouettes[shown], frames[shown]
    before, after = (_predict(each.cameras.select(shown), *parts) for each in (found, again))
    if again.overall < max(CONVINCING, found.overall + GAIN) or after < before - WORSE:
        return Reoriented(found)
    said = (
        "the cameras contradict all silhouettes a little: each was turned about its own centre, "
        f"by {turns.mean():.1f} degrees in the mean and {turns.max():.1f} at most, and they agree "
        f"(hull IoU {found.overall:.2f} before, {again.overall:.2f} now; of each with the hull of "
        f"the others {before:.2f} and {after:.2f})"
    )
    focal = float(old.K[:, 0, 0].mean())
    doubt = say_open(turns, focal, silhouettes[shown])
    return Reoriented(replace(again, undistorted=found.undistorted), said, doubt)


def say_open(turns: np.ndarray, focal: float, silhouettes: np.ndarray) -> str:
    """What turned cameras leave open of where the object stands; empty if it is little.

    All cameras may turn after an object that is shifted, and no silhouette tells. What fixes its
    place is the mean of the directions that were given, whose error is that of one by the root of
    their number. Two thirds of a turn's square are not about the optical axis and move the image.

    Args:
        turns: [views] degrees
        focal: length, in pixels
        silhouettes: [views, height, width] bool
    """
    moved = focal * np.sqrt(2 / 3 * np.mean(np.radians(turns) ** 2))
    shift = moved / np.sqrt(len(turns))
    share = shift / np.sqrt(silhouettes.sum(axis=(1, 2)).mean())
    if share < OPEN:
        return ""
    return (
        f"cameras that were turned leave open where the object stands, by about {shift:.1f} pixels "
        f"or {share:.0%} of its size, though its shape may be right: give more exact cameras, or "
        "have them found (cameras 'auto')"
    )


def _predict(cameras: Cameras, silhouettes: np.ndarray, frames: np.ndarray) -> float:
    return float(predict_held_out(silhouettes, cameras, frames).mean())


def _put(cameras: Cameras, positions: np.ndarray, turned: Cameras) -> Cameras:
    """The cameras, those at some positions replaced."""
    R, t = cameras.R.clone(), cameras.t.clone()
    R[positions], t[positions] = turned.R, turned.t
    return replace(cameras, R=R, t=t)
