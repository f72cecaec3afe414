"""A turntable of outlines whose lower or upper arcs are wrong, as by a plate, a stand or a hand.

Then no choice of whole views is right. The outlines' lower arcs and their upper ones are separate
evidence: the geometry is found again without the one and without the other, as if the frame cut the
object there, and is taken if what is left agrees far better.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from silmesh.cameras.turntable_fit import SUSPECT
from silmesh.errors import InputError
from silmesh.geometry.frame import whole_frames
from silmesh.progress import Share, untold, within

if TYPE_CHECKING:
    from silmesh.cameras.calibrate import Calibration

ARCS = {"lower": 0.2, "upper": 0.2}  # shares of each silhouette's height that are left out
DISAGREEING = 0.2  # of the views: if more disagree, or outlines miss by much, arcs are left out
FAR_BETTER = 0.6  # of the residual with the wrong arcs: the most without them
FINEST = 0.1  # pixels: outlines of pixels leave a larger residual however well they agree
WHOLE = 0.9  # share of the progress when whole outlines are fitted; the rest seldom comes
CUT = "the frame cuts the object in"  # how a warning begins that the left-out arcs bring about


def find_without_arcs(
    calibrate: Callable[..., "Calibration"],
    silhouettes: np.ndarray,
    views: Sequence[str],
    frames: np.ndarray | None = None,
    guess: bool = True,
    progress: Share = untold,
    **known: Any,
) -> "Calibration":
    """The turntable by all of the outlines or, where these contradict each other, by most of each.

    Args:
        calibrate: finds it; takes the other arguments
        silhouettes: [views, size, size] bool
        frames: [views, 4] left, top, right and bottom of the photographs within the images
        guess: whether arcs are left out, and then nothing else is guessed: two guesses at once are
            too many
        progress: is told which share is done

    Raises:
        InputError: neither whole outlines nor those without an arc give a turntable
    """
    first = partial(calibrate, silhouettes, views, progress=within(progress, 0, WHOLE), **known)
    try:
        whole, failure = first(frames=frames, guess=guess), None
    except InputError as error:
        whole, failure = None, error
    if guess and not _is_final(whole, silhouettes):
        again = partial(calibrate, silhouettes, views, guess=False, **known)
        rest = within(progress, WHOLE, 1)
        whole = _find_better(again, whole, silhouettes, frames, rest) or whole
    if whole is None:
        raise failure
    progress(1)
    return whole


def _find_better(
    calibrate: Callable[..., "Calibration"],
    whole: "Calibration | None",
    silhouettes: np.ndarray,
    frames: np.ndarray | None,
    progress: Share,
) -> "Calibration | None":
    """The turntable without an arc by which the outlines agree far better, if there is one."""
    parts = {}
    for n, arc in enumerate(ARCS):
        share = within(progress, n / len(ARCS), (n + 1) / len(ARCS))
        with suppress(InputError):
            parts[arc] = calibrate(frames=leave_out(arc, silhouettes, frames), progress=share)
    for arc, part in parts.items():
        others = [other for name, other in parts.items() if name != arc]
        believed = _is_shown(part) and not _is_doubtful(part, silhouettes)
        if believed and _is_better(part, whole, others):
            return _tell(part, whole, arc)
    return None


def leave_out(arc: str, silhouettes: np.ndarray, frames: np.ndarray | None) -> np.ndarray:
    """Frames [views, 4] that leave out the lower or the upper arc of each silhouette."""
    left = np.array(whole_frames(silhouettes) if frames is None else frames)
    for frame, silhouette in zip(left, silhouettes, strict=True):
        rows = np.flatnonzero(silhouette.any(axis=1))
        if not len(rows):
            continue
        depth = round(ARCS[arc] * len(rows))
        if arc == "lower":
            frame[3] = min(frame[3], rows[-1] + 1 - depth)
        else:
            frame[1] = max(frame[1], rows[0] + depth)
    return left


def _is_doubtful(found: "Calibration", silhouettes: np.ndarray) -> bool:
    limit = SUSPECT * silhouettes.shape[1] / 256
    return found.rms > limit or len(found.disagreeing) > DISAGREEING * len(silhouettes)


def _is_final(whole: "Calibration | None", silhouettes: np.ndarray) -> bool:
    """Whether no doubt is left, or the views that agree do so as well as outlines of pixels can."""
    if whole is None:
        return False
    return not _is_doubtful(whole, silhouettes) or FAR_BETTER * whole.rms <= FINEST


def _is_shown(part: "Calibration") -> bool:
    """Whether what is left shows the turntable, as its roll if anything.

    Rays that leave the frames miss nothing, so cameras by which all leave them explain anything.
    """
    roll = part.estimates.get("roll")
    return part.rms > 0 and (roll is None or roll.status != "open")


def _is_better(
    part: "Calibration", whole: "Calibration | None", others: Sequence["Calibration"]
) -> bool:
    """Whether outlines agree far better without an arc than whole and than without another one.

    Any outlines agree a little better where less of them counts.
    """
    if whole is not None and len(part.disagreeing) > len(whole.disagreeing):
        return False
    before = others if whole is None else [whole, *others]
    return all(part.rms <= FAR_BETTER * other.rms for other in before)


def _tell(found: "Calibration", whole: "Calibration | None", arc: str) -> "Calibration":
    """The calibration with what was left out among its warnings."""
    known = () if whole is None else whole.warnings
    kept = [line for line in found.warnings if not line.startswith(CUT) or line in known]
    said = (
        f"the {arc} arcs of the outlines contradict the rest, as where a plate, a stand or a hand "
        f"is taken for the object: the {arc} {ARCS[arc]:.0%} of each had no say in the cameras"
    )
    return replace(found, warnings=(*kept, said))
