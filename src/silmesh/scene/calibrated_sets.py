"""Sets of photographs, each with the cameras of a turntable of its own, joined in one world."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from PIL import Image

from silmesh.cameras.attempt import CHECK_SERIES, Attempt
from silmesh.cameras.calibrate import calibrate_views
from silmesh.cameras.rounds import describe_short, propose, read_signs
from silmesh.cameras.sets import FEWEST
from silmesh.progress import Share, untold, within
from silmesh.scene.joined import join_attempts
from silmesh.views import View

SOURCE = "calibrate"
BEGINNING = f"cameras {SOURCE!r}: "  # of a refusal and of a warning
MANY = 0.3  # of the views: if one turntable leaves out so many, sets are tried as well
WHOLE = 0.9  # share of the progress when one turntable is fitted; sets are seldom tried
TRIED = 2  # proposals of sets that are tried at most, the clearest first


def calibrate_sets(
    silhouettes: np.ndarray,
    views: Sequence[View],
    sets: Sequence[Sequence[str]] = (),
    pictures: Mapping[str, Image.Image] | None = None,
    progress: Share = untold,
    **known: Any,
) -> Attempt:
    """``calibrate_views``, each set by itself, and the sets joined.

    Args:
        silhouettes: [views, size, size] bool
        views: these views, in the order in which they were taken
        sets: the views of each set by their names; if there are none and no one turntable explains
            most views, the sets that names, sizes, times or silhouettes of the photographs propose
        pictures: the working images by the views' names
        progress: is told which share is done
        known: of the turntable, as ``calibrate`` takes it
    """
    if sets:
        return _calibrate_each(silhouettes, views, _place(sets, views), pictures, progress, known)
    whole = calibrate_views(silhouettes, views, progress=within(progress, 0, WHOLE), **known)
    explained = whole.cameras is not None and len(_disagreeing(whole)) < MANY * len(views)
    if explained or len(known.get("rounds", ())) > 1:  # rounds that were given are no sets
        progress(1)
        return _tell_short(whole, views)
    tried: list[str] = []
    for split in propose(silhouettes, read_signs(views))[:TRIED]:
        start = WHOLE + (1 - WHOLE) * len(tried) / TRIED
        share = within(progress, start, start + (1 - WHOLE) / TRIED)
        parts = [part.tolist() for part in split.rounds]
        plain = {**known, "guess": False}
        joined = _calibrate_each(silhouettes, views, parts, pictures, share, plain)
        better = whole.cameras is None or len(_disagreeing(joined)) < len(_disagreeing(whole))
        if joined.cameras is not None and better:
            said = _say_taken(parts, views, split.because)
            return replace(joined, warnings=(said, *joined.warnings))
        why = str(joined.refusal).removeprefix(BEGINNING)
        why = why.replace(CHECK_SERIES, "")  # which the first refusal ends with
        tried.append(f"taken as {len(parts)} sets, {split.because}: {why}")
    if whole.cameras is not None:
        return whole
    return replace(whole, refusal="; ".join([str(whole.refusal), *tried]))


def _disagreeing(attempt: Attempt) -> Mapping[str, str]:
    """The views that had no say, and why."""
    return attempt.figures.get("disagreeing", {})


def _tell_short(whole: Attempt, views: Sequence[View]) -> Attempt:
    """The attempt with a sentence on a part of the photographs that had no say and is too short."""
    out = [i for i, view in enumerate(views) if view.view in _disagreeing(whole)]
    if not out:
        return whole
    said = describe_short(read_signs(views), out)
    return replace(whole, warnings=(*whole.warnings, *said))


def _say_taken(parts: Sequence[Sequence[int]], views: Sequence[View], why: str) -> str:
    named = ", ".join(_name([views[i] for i in part]) for part in parts)
    return (
        f"{BEGINNING}no one turntable explains all {len(views)} views, so they were "
        f"taken as {len(parts)} sets, told apart {why}: {named}"
    )


def _place(sets: Sequence[Sequence[str]], views: Sequence[View]) -> list[list[int]]:
    """Positions of the views of each set, in the order of the views."""
    place = {view.view: i for i, view in enumerate(views)}
    return [sorted(place[name] for name in names) for names in sets]


def _calibrate_each(
    silhouettes: np.ndarray,
    views: Sequence[View],
    parts: Sequence[Sequence[int]],
    pictures: Mapping[str, Image.Image] | None,
    progress: Share,
    known: Mapping[str, Any],
) -> Attempt:
    attempts = []
    for n, part in enumerate(parts):
        some = [views[i] for i in part]
        if len(some) < FEWEST:
            why = f"is too short: a set that is joined with another takes {FEWEST} views or more"
            return _refuse(some, why, parts, views)
        share = within(progress, n / (len(parts) + 1), (n + 1) / (len(parts) + 1))
        attempt = calibrate_views(silhouettes[list(part)], some, progress=share, **known)
        if attempt.cameras is None:
            why = attempt.refusal.removeprefix(BEGINNING)
            return _refuse(some, f"taken by itself: {why}", parts, views)
        attempts.append(attempt)
    joined = join_attempts(attempts, views, silhouettes, pictures)
    if joined.cameras is not None:
        return joined
    return _join_mirrored(joined, attempts, views, silhouettes, pictures)


def _join_mirrored(
    refused: Attempt,
    attempts: Sequence[Attempt],
    views: Sequence[View],
    silhouettes: np.ndarray,
    pictures: Mapping[str, Image.Image] | None,
) -> Attempt:
    """The sets with one turned the other way, if they join so: a set alone may leave that open.

    The set that was seen most nearly from the level of its table is tried first, since there what
    tells an object from its mirror image says least. If no set does it, they are refused.
    """
    unsure = [n for n, attempt in enumerate(attempts) if _may_be_mirrored(attempt)]
    for n in sorted(unsure, key=lambda n: abs(_elevation_of(attempts[n]))):
        twin = _mirror(attempts[n])
        joined = join_attempts(
            [*attempts[:n], twin, *attempts[n + 1 :]], views, silhouettes, pictures
        )
        if joined.cameras is not None:
            return replace(joined, warnings=(_say_mirrored(twin), *joined.warnings))
    if not unsure:
        return refused
    said = "; nor do they join if one of them is taken to have turned the other way"
    return replace(refused, refusal=f"{refused.refusal}{said}")


def _may_be_mirrored(attempt: Attempt) -> bool:
    """Whether the set's silhouettes leave open which way the object turned."""
    figures = attempt.figures
    told = figures["mirror"] in ("perspective", "elevation") and figures["direction_certain"]
    return not told and "rounds" not in figures


def _elevation_of(attempt: Attempt) -> float:
    return attempt.figures["estimates"]["elevation"]["value"]


def _mirror(attempt: Attempt) -> Attempt:
    """The cameras that see the mirrored object nearly the same, if they are far from it.

    Negating depth, with D = diag(1, 1, -1), takes R to D R D in the world that D mirrors.
    """
    D = torch.tensor([1.0, 1.0, -1.0], dtype=attempt.cameras.R.dtype)
    cameras = replace(attempt.cameras, R=D[:, None] * attempt.cameras.R * D)
    estimates = {
        name: {**one, "value": -one["value"]} if name in ("elevation", "step") else one
        for name, one in attempt.figures["estimates"].items()
    }
    figures = {**attempt.figures, "estimates": estimates, "mirror": "sets"}
    return replace(attempt, cameras=cameras, figures=figures)


def _say_mirrored(twin: Attempt) -> str:
    views = twin.cameras.views
    return (
        f"{BEGINNING}{views[0]!r} to {views[-1]!r} ({len(views)} views) are taken to turn "
        f"the other way, seen from {_elevation_of(twin):.1f} degrees instead of "
        f"{-_elevation_of(twin):.1f}: their silhouettes alone explain a mirrored object as well, "
        "and only so do the sets join; if the mesh is mirrored, it was another set"
    )


def _refuse(
    some: Sequence[View], why: str, parts: Sequence[Sequence[int]], views: Sequence[View]
) -> Attempt:
    refusal = f"{BEGINNING}the set {_name(some)} {why}"
    figures = {"sets": [[views[i].view for i in part] for part in parts]}
    return Attempt(SOURCE, None, refusal=refusal, figures=figures)


def _name(some: Sequence[View]) -> str:
    return f"{some[0].view!r} to {some[-1].view!r} ({len(some)} views)"
