"""What happens to outliers: they are kept, dropped, or segmented again, and always reported."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras
from silmesh.scene.outliers import Verdict, find_outliers
from silmesh.scene.resegmentation import Solved

KEPT, REPAIRED, DROPPED = "kept", "repaired", "dropped"
WEIGHTS = {KEPT: 1.0, REPAIRED: 0.5, DROPPED: 0.0}  # of a view in the fit's loss, by its fate


@dataclass(frozen=True)
class Decision:
    """What happened to the views of a scene.

    Attributes:
        verdict: on the silhouettes as they were found
        silhouettes: [views, height, width] bool, those of repaired views new
        fates: of each view, ``kept``, ``repaired`` or ``dropped``
        changes: of each view, which share of its silhouette's area was added, and which removed
    """

    verdict: Verdict
    silhouettes: np.ndarray
    fates: list[str]
    changes: list[tuple[float, float]]

    @property
    def fitted(self) -> list[int]:
        """Positions of the views that are left."""
        return [i for i, fate in enumerate(self.fates) if fate != DROPPED]


def decide(
    policy: str,
    fewest: int,
    silhouettes: np.ndarray,
    cameras: Cameras,
    solve: Callable[[Verdict], Solved],
    frames: np.ndarray | None = None,
    lost: Mapping[int, str] | None = None,
    suspects: Sequence[int] = (),
) -> Decision:
    """Find outliers among the silhouettes, and keep, drop or repair them.

    Args:
        policy: ``keep``, which drops only what is empty, since there is nothing to fit; ``drop``,
            or ``repair``, which segments again also parts of silhouettes that the other views
            contradict, and drops what stays an outlier
        fewest: least number of views that may be left when any is dropped
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        solve: gives the silhouettes that all views and colours agree on
        frames: [views, 4] of the photographs within the images, as ``judge`` takes them
        lost: why silhouettes are empty or outliers, by position, where it is known
        suspects: positions of views that something else speaks against. Where the silhouettes alone
            cannot tell which are wrong, the others judge them, and the outliers among them are
            dropped by any policy that does not repair them, since no mesh fits both sides

    Raises:
        InputError: too few views would be left
    """
    found, suspected = _judge(silhouettes, cameras, frames, suspects)
    solved = solve(found) if policy == "repair" else Solved(silhouettes)
    verdict = found.explain(lost or {}, also=solved.reasons)
    new, fates = solved.silhouettes.copy(), [KEPT] * len(silhouettes)
    for i in verdict.outliers:
        side = policy == "keep" and i in suspected
        if side or policy == "drop" or i in solved.left or not new[i].any():
            fates[i], new[i] = DROPPED, silhouettes[i]
        elif (new[i] != silhouettes[i]).any():
            fates[i] = REPAIRED
    changes = [_compare(*pair) for pair in zip(silhouettes, new, strict=True)]
    decision = Decision(verdict, new, fates, changes)
    _refuse_too_few(decision, fewest, cameras.views)
    return decision


def _compare(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """Which shares of a silhouette's area were added and removed; of the new one's if it is new."""
    area = max(int(before.sum()) or int(after.sum()), 1)
    return float((after & ~before).sum() / area), float((before & ~after).sum() / area)


def _judge(
    silhouettes: np.ndarray,
    cameras: Cameras,
    frames: np.ndarray | None,
    suspects: Sequence[int],
) -> tuple[Verdict, Collection[int]]:
    """The verdict on the silhouettes, and the views by whose suspicion it was found, if any."""
    verdict = find_outliers(silhouettes, cameras, frames)
    if not suspects or 2 * len(suspects) > len(silhouettes):
        return verdict, ()
    again = find_outliers(silhouettes, cameras, frames, suspects)
    if again.refusal or len(again.outliers) <= len(verdict.outliers):
        return verdict, ()
    return again, suspects


def _refuse_too_few(decision: Decision, fewest: int, views: Sequence[str]) -> None:
    if DROPPED not in decision.fates or len(decision.fitted) >= fewest:
        return
    reasons = decision.verdict.reasons
    lost = [f"{views[i]!r} ({reasons[i]})" for i, f in enumerate(decision.fates) if f == DROPPED]
    raise InputError(
        f"only {len(decision.fitted)} views are left, and quality.fewest is {fewest}: dropped are "
        f"{', '.join(lost)}. quality.policy 'keep' (in the command: --quality keep) "
        "fits outliers as they are"
    )
