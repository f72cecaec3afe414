"""A scene from attempts at cameras: undistort, take the most coherent, normalise the world."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from silmesh.cameras.attempt import CHECK_SERIES, FILE, TRY_CALIBRATE, Attempt
from silmesh.errors import InputError, blaming, name_some
from silmesh.geometry.frame import find_shown, is_cut
from silmesh.geometry.thresholds import COHERENT
from silmesh.geometry.undistortion import Undistorted
from silmesh.geometry.visual_hull import find_outlier_views
from silmesh.scene.agreement import Normalised, choose, refused_or
from silmesh.scene.conventions import settle
from silmesh.scene.diagnosis import MEASURED, diagnose
from silmesh.scene.outliers import LEAST
from silmesh.scene.reorientation import Reoriented, reorient
from silmesh.scene.scene import Scene
from silmesh.scene.shown import Shown
from silmesh.views import View


@dataclass(frozen=True)
class Assembled:
    """A scene, and what it was made of.

    Attributes:
        scene: the views that have a camera
        undistorted: how the working images become those of the scene's cameras
        taken: position of the attempt that was taken
        attempt: the same, with what the silhouettes say among its warnings
    """

    scene: Scene
    undistorted: Undistorted
    taken: int
    attempt: Attempt


def build_scene(
    attempts: Sequence[Attempt],
    views: Sequence[View],
    silhouettes: np.ndarray,
    keep_world: bool = False,
    lost: Mapping[str, str] | None = None,
    names: Sequence[str] | None = None,
) -> Assembled:
    """Take the cameras that agree best with the silhouettes, and normalise their world.

    Args:
        attempts: at the cameras of these views
        views: all views, in the order in which they were taken
        silhouettes: [views, size, size] bool, empty where there is none
        keep_world: the cameras' world is normalised already
        lost: of which views something could not be read, and what
        names: what messages call each attempt that came of no file; its source if not given

    Raises:
        InputError: no attempt gives cameras that can be used; says why, and what was measured
    """
    shown = Shown(views, silhouettes)
    named = zip(attempts, names or [attempt.source for attempt in attempts], strict=True)
    settled = [_normalise(attempt, name, shown, keep_world) for attempt, name in named]
    attempts, normalised = [attempt for attempt, _ in settled], [cameras for _, cameras in settled]
    if not any(normalised):
        # Of a file's cameras, and between sets, the order of the views says nothing.
        ordered = any(a.source != FILE and "sets" not in a.figures for a in attempts)
        raise InputError(_explain(attempts, diagnose(silhouettes, views, ordered=ordered)))
    taken, why = choose(attempts, normalised)
    attempt, best = attempts[taken], normalised[taken]
    undistorted = best.undistorted.silhouettes(shown.silhouettes(best.cameras.views))
    turned = Reoriented(best) if keep_world else reorient(best, undistorted)
    best = turned.found
    attempt = replace(attempt, warnings=(*attempt.warnings, *filter(None, [turned.said])))
    attempt = _warn_of_contradicted(attempt, best)
    findings = diagnose(silhouettes, views, coherent=best.mean >= COHERENT)
    notes = {
        **_note_cameras(attempt, best, why),
        "disagreeing": _explain_contradicted(best) | attempt.figures.get("disagreeing", {}),
        "doubtful": _name_outliers(best, undistorted),
        "warnings": list(attempt.warnings),
        "figures": dict(attempt.figures),
        "mirrored": attempt.mirrored,
        "measured": [*findings, *filter(None, [turned.doubt])],
        "lost": dict(lost or {}),
        **_note_views(best, views),
        **_note_lenses(best.undistorted),
        "attempts": [
            {"source": a.source, "came_to": refused_or(a, p), "warnings": list(a.warnings)}
            for a, p in settled
        ],
    }
    points = attempt.points if is_cut(undistorted, best.undistorted.frames).any() else None
    scene = Scene(best.cameras, best.similarity, undistorted, best.coherence, notes, points=points)
    return Assembled(scene, best.undistorted, taken, attempt)


def _normalise(
    attempt: Attempt, name: str, shown: Shown, keep_world: bool
) -> tuple[Attempt, Normalised | None]:
    """An attempt and its cameras in the normalised world; None, and why, if it gives none."""
    if attempt.cameras is None:
        return attempt, None
    try:
        with blaming(attempt.figures.get("file", name)):
            named = attempt.cameras.views
            return settle(attempt, shown.silhouettes(named), keep_world, shown.frames(named))
    except InputError as error:
        return replace(attempt, refusal=str(error)), None


def _warn_of_contradicted(attempt: Attempt, best: Normalised) -> Attempt:
    """The attempt with a warning that names the views that had no say, if there are any."""
    if not best.contradicted:
        return attempt
    names = name_some([repr(best.cameras.views[i]) for i in best.contradicted])
    warning = (
        f"the hull by which the cameras are judged leaves out {len(best.contradicted)} of "
        f"{len(best.cameras)} views, whose silhouettes the others contradict: {names}"
    )
    return replace(attempt, warnings=(*attempt.warnings, warning))


def _explain_contradicted(best: Normalised) -> dict[str, str]:
    """Why the others contradict each view that had no say, or of which much was not believed."""
    views = best.cameras.views
    said = {}
    if best.disbelieved is not None:
        parts = np.flatnonzero(best.disbelieved > LEAST)
        said = {views[i]: f"other views contradict {best.disbelieved[i]:.0%} of it" for i in parts}
    return said | {views[i]: "other views contradict it" for i in best.contradicted}


def _note_cameras(attempt: Attempt, best: Normalised, why: str) -> dict[str, Any]:
    """What ``scene.json`` says of the cameras that are taken."""
    return {
        "undistorted": len(best.undistorted.sources),
        "displacement": best.undistorted.displacement,
        "cameras": attempt.source,
        "cameras_because": why,
        "dropped": dict(attempt.dropped),
    }


def _note_views(best: Normalised, views: Sequence[View]) -> dict[str, Any]:
    """What it says of photographs, and where they lie in their working images."""
    kept = zip(best.cameras.views, best.undistorted.frames.tolist(), strict=True)
    there = dict(kept)
    frames = {view.view: there[view.view] for view in views if view.view in there}
    return {
        "unreadable": [view.view for view in views if view.unreadable],
        "frame": _around(frames.values()),
        "frames": frames,
    }


def _note_lenses(undistorted: Undistorted) -> dict[str, Any]:
    """What it says of lenses, by which photographs are undistorted at their own size."""
    bent = {view: one.describe() for view, one in undistorted.bent.items()}
    return {"lenses": bent} if bent else {}


def _explain(attempts: Sequence[Attempt], findings: Sequence[str]) -> str:
    """Why there are no cameras: what each attempt came to, and what was measured beside it.

    Advice is left out of which the attempts or the findings show that it leads nowhere.
    """
    tried = {attempt.source for attempt in attempts}
    idle = [TRY_CALIBRATE] * ("calibrate" in tried) + [CHECK_SERIES] * bool(findings)
    refusals = [str(attempt.refusal) for attempt in attempts]
    for advice in idle:
        refusals = [refusal.replace(advice, "") for refusal in refusals]
    refusals = _drop_alike(refusals)
    several = ["no cameras were found:"] if len(refusals) > 1 else []
    measured = [f"{MEASURED}{finding}" for finding in findings]
    return "\n  ".join([*several, *refusals, *measured])


def _drop_alike(refusals: Sequence[str]) -> list[str]:
    """Those that differ in more than their figures, as COLMAP's with and without masks may not."""
    return list({re.sub(r"\d+", "", refusal): refusal for refusal in refusals}.values())


def _around(frames: Iterable[Sequence[int]]) -> list[int]:
    """The box that holds all of some frames: left, top, right and bottom."""
    left, top, right, bottom = zip(*frames, strict=True)
    return [min(left), min(top), max(right), max(bottom)]


def _name_outliers(best: Normalised, silhouettes: np.ndarray) -> list[str]:
    """The views that lower the coherence most, if it is low."""
    if best.mean >= COHERENT:
        return []
    views, shown = best.cameras.views, find_shown(silhouettes)
    frames = best.undistorted.frames[shown]
    cameras = best.cameras.select(shown)
    return [views[shown[i]] for i in find_outlier_views(silhouettes[shown], cameras, frames)]
