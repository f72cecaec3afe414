"""What is done with doubtful views: kept, dropped, or segmented again; never silently."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras
from silmesh.scene.outliers import Verdict, judge

KEPT, REPAIRED, DROPPED = "kept", "repaired", "dropped"
WEIGHTS = {KEPT: 1.0, REPAIRED: 0.5, DROPPED: 0.0}  # how much a view counts in a fit that weighs


@dataclass(frozen=True)
class Decision:
    """What became of the views of a scene.

    Attributes:
        verdict: on the silhouettes as they were found
        silhouettes: [views, height, width] bool, those of repaired views new
        fates: of each view, ``kept``, ``repaired`` or ``dropped``
    """

    verdict: Verdict
    silhouettes: np.ndarray
    fates: list[str]

    @property
    def fitted(self) -> list[int]:
        """The positions of the views that are left."""
        return [i for i, fate in enumerate(self.fates) if fate != DROPPED]


def decide(
    policy: str,
    fewest: int,
    silhouettes: np.ndarray,
    cameras: Cameras,
    segment: Callable[[Sequence[int], Sequence[int]], np.ndarray],
    frames: np.ndarray | None = None,
    lost: Mapping[int, str] | None = None,
    unreadable: Collection[int] = (),
) -> Decision:
    """Judge the silhouettes and deal with the doubtful ones.

    Args:
        policy: ``keep``, ``drop``, or ``repair``, which drops what stays doubtful
        fewest: views that must be left, if any is dropped
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        segment: gives new silhouettes of doubtful views, from their positions and the sound ones'
        frames: [views, 4] of the photographs within the images, as ``judge`` takes them
        lost: why silhouettes are empty, by position, where it is known
        unreadable: positions of the views without a photograph to segment again

    Raises:
        InputError: too few views would be left
    """
    verdict = judge(silhouettes, cameras, frames).explain(lost or {})
    doubtful, fates, new = verdict.doubtful, [KEPT] * len(silhouettes), silhouettes.copy()
    if policy == "repair" and doubtful:
        if seen := [i for i in doubtful if i not in unreadable]:
            new[seen] = segment(seen, verdict.sound)
        still = judge(new, cameras, frames).doubtful
        for i in doubtful:
            fates[i] = DROPPED if i in still else REPAIRED
            new[i] = silhouettes[i] if i in still else new[i]
    elif policy == "drop":
        for i in doubtful:
            fates[i] = DROPPED
    decision = Decision(verdict, new, fates)
    _refuse_too_few(decision, fewest, cameras.views)
    return decision


def _refuse_too_few(decision: Decision, fewest: int, views: Sequence[str]) -> None:
    if DROPPED not in decision.fates or len(decision.fitted) >= fewest:
        return
    doubts = decision.verdict.doubts
    lost = [f"{views[i]!r} ({doubts[i]})" for i, f in enumerate(decision.fates) if f == DROPPED]
    raise InputError(
        f"only {len(decision.fitted)} views are left, and quality.fewest is {fewest}: dropped are "
        f"{', '.join(lost)}. quality.policy 'keep' fits doubtful views as they are"
    )
