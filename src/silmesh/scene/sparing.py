"""When cameras need not be sought, because those of another source leave little to gain."""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from silmesh.cameras.attempt import Attempt
from silmesh.geometry.camera import Cameras
from silmesh.geometry.thresholds import UNBEATEN
from silmesh.scene.agreement import MOST_WRONG

# Degrees by which the turns from view to view leave one axis, the median. Those that COLMAP finds
# of turntables leave it by 0.5 at most, turned by hand as well; of a walk around an object by 2.
ONE_AXIS = 1.0
FEWEST_TURNS = 6  # pairs of turns, one after the other, by which that is told


def spare(source: str, before: Sequence[Attempt], views: int) -> Attempt | None:
    """A refusal of a source whose cameras could hardly be taken; None if they are to be sought.

    Args:
        before: attempts by other sources, judged by ``refuse_incoherent``
        views: how many there are
    """
    for attempt in _of_all(before, views):
        coherence = attempt.figures["coherence"]
        if coherence >= UNBEATEN and not attempt.figures["contradicted"]:
            why = (
                f"not tried, for by {attempt.source!r} all have a camera, hull IoU {coherence:.3f}"
            )
            return Attempt(source, None, refusal=why)
    return None


def spare_turntable(
    source: str, before: Sequence[Attempt], views: int, named: bool = False
) -> Attempt | None:
    """``spare``, or a refusal where other cameras show that nothing turned on a turntable.

    Where many silhouettes are wrong they contradict right cameras, and a turntable is sought in
    vain. Cameras by which the other silhouettes, most of all, agree are right, and tell whether the
    views were taken turn after turn about one axis.

    Args:
        named: whether a person says that there was a turntable, and what is known of it
    """
    if spared := spare(source, before, views):
        return spared
    for attempt in () if named else _of_all(before, views):
        contradicted = attempt.figures["contradicted"]
        coherence = attempt.figures["coherence_uncontradicted"]
        if coherence < UNBEATEN or len(contradicted) > MOST_WRONG * views:
            continue
        angle = measure_swerve(attempt.cameras, contradicted)
        if angle > ONE_AXIS:
            agree = f"{views - len(contradicted)} of {views} views agree"
            why = (
                f"not tried, for by {attempt.source!r} {agree}, hull IoU {coherence:.3f}, and were "
                f"not taken on a turntable: their turns leave one axis by {angle:.1f} degrees (a "
                f"turntable's by {ONE_AXIS:g} at most)"
            )
            return Attempt(source, None, refusal=why)
    return None


def _of_all(before: Sequence[Attempt], views: int) -> Iterator[Attempt]:
    """The attempts that have a camera for each view, and were judged."""
    for attempt in before:
        whole = attempt.cameras is not None and len(attempt.cameras) == views
        if whole and "coherence_uncontradicted" in attempt.figures:
            yield attempt


def measure_swerve(cameras: Cameras, left_out: Sequence[str] = ()) -> float:
    """Degrees by which the turns from view to view leave the axis of the one before, the median.

    A camera that stands still sees a table turn about one axis, evenly or not; where the table is
    tilted or the object turned over, only one turn of many leaves it. Where two rounds were taken
    by turns, every second view is of one; so the least is meant, of all views and of either half.
    0 if too few views follow each other.

    Args:
        cameras: in the order in which they were taken
        left_out: views that are not believed
    """
    R, told = cameras.R.numpy(), ~np.isin(cameras.views, left_out)
    return min(_measure_turns(R[part], told[part]) for part in (np.s_[:], np.s_[::2], np.s_[1::2]))


def _measure_turns(R: np.ndarray, told: np.ndarray) -> float:
    """The same of rotations [views, 3, 3], of which those ``told`` [views] are believed."""
    turns = Rotation.from_matrix(R[:-1].transpose(0, 2, 1) @ R[1:]).as_rotvec(degrees=True)
    told = told[:-2] & told[1:-1] & told[2:]
    if told.sum() < FEWEST_TURNS:
        return 0.0
    before, after = turns[:-1][told], turns[1:][told]
    axes = before / np.maximum(np.linalg.norm(before, axis=1, keepdims=True), 1e-9)
    return float(np.median(np.linalg.norm(np.cross(axes, after), axis=1)))
