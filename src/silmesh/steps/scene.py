"""Silhouettes and cameras: undistort, take the most coherent cameras, normalise the world."""

import re
import sys
from argparse import Namespace
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import torch

from silmesh.agreement import Placed, choose, find_shown, refused_or
from silmesh.cameras.attempt import CHECK_SERIES, TRY_CALIBRATE, Attempt, read_attempt
from silmesh.conventions import settle
from silmesh.diagnosis import MEASURED, diagnose_folders
from silmesh.errors import InputError, blaming
from silmesh.hull import find_doubtful
from silmesh.scene import SILHOUETTES, VIEWS, write_scene
from silmesh.silhouettes import read_lost, read_silhouettes
from silmesh.steps.command import output_folder, parser, run
from silmesh.thresholds import COHERENT
from silmesh.views import read_views

DOUBTFUL = 0.5  # below this hull IoU a person is told before the fit, not only on the page


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    args.add_argument("--silhouettes", type=Path, required=True, help="folder of the silhouettes")
    args.add_argument("--cameras", type=Path, nargs="+", required=True, help="attempts' folders")
    args.add_argument("--keep-world", action="store_true", help="it is normalised already")
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--output", type=output_folder, required=True, help="folder to make")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)
    attempts, placed = zip(*(_place(folder, given) for folder in given.cameras), strict=True)
    if not any(placed):
        raise InputError(_explain(attempts, diagnose_folders(given.views, given.silhouettes)))
    index, why = choose(attempts, placed)
    attempt, best = attempts[index], placed[index]
    doubtful = _name_doubtful(best, given.silhouettes)
    frames = _frames(best, given.views)
    told = {
        "cameras": attempt.source,
        "cameras_because": why,
        "dropped": dict(attempt.dropped),
        "doubtful": doubtful,
        "warnings": list(attempt.warnings),
        "figures": dict(attempt.figures),
        "mirrored": attempt.mirrored,
        "measured": diagnose_folders(given.views, given.silhouettes, best.mean >= COHERENT),
        "lost": read_lost(given.silhouettes),
        "unreadable": [view.view for view in read_views(given.views) if view.unreadable],
        "frame": _around(frames.values()),
        "frames": frames,
        "attempts": [
            {"source": a.source, "came_to": refused_or(a, p), "warnings": list(a.warnings)}
            for a, p in zip(attempts, placed, strict=True)
        ],
    }
    write_scene(
        given.output,
        best.cameras,
        best.similarity,
        best.coherence,
        {VIEWS: given.views, SILHOUETTES: given.silhouettes},
        told,
        best.straightened,
    )
    for warning in attempt.warnings[len(read_attempt(given.cameras[index]).warnings) :]:
        print(f"silmesh: {warning}", file=sys.stderr)
    if len(attempts) > 1:
        print(f"{given.silhouettes}: cameras from {attempt.source} are taken. {why}")
    if best.mean < DOUBTFUL:
        blamed = f", to be doubted first: {', '.join(doubtful)}" if doubtful else ""
        named = attempt.figures.get("file", given.cameras[index])
        print(
            f"warning: {given.silhouettes} and {named} hardly agree: hull IoU "
            f"{best.mean:.2f}{blamed}. The fit will be poor unless the cameras (a turntable's "
            "distance, elevation and step) are those of the photographs"
        )


def _place(folder: Path, given: Namespace) -> tuple[Attempt, Placed | None]:
    """An attempt and its cameras in the normalised world; None, and why, if it gives none."""
    attempt = read_attempt(folder)
    if attempt.cameras is None:
        return attempt, None
    try:
        with blaming(attempt.figures.get("file", folder)):
            seen = read_silhouettes(given.silhouettes, attempt.cameras.views)
            return settle(attempt, seen, given.keep_world)
    except InputError as error:
        return replace(attempt, refusal=str(error)), None


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


def _frames(best: Placed, views: Path) -> dict[str, list[int]]:
    """Left, top, right and bottom of each photograph in its working image.

    An undistorted photograph has no straight border, and is taken to fill its image.
    """
    return {
        view.view: [0, 0, view.size, view.size]
        if view.view in best.straightened.sources
        else list(view.frame)
        for view in read_views(views)
        if view.view in best.cameras.views
    }


def _around(frames: Iterable[Sequence[int]]) -> list[int]:
    """The box that holds all of some frames: left, top, right and bottom."""
    left, top, right, bottom = zip(*frames, strict=True)
    return [min(left), min(top), max(right), max(bottom)]


def _name_doubtful(best: Placed, silhouettes: Path) -> list[str]:
    """The views that lower the coherence most, if it is low."""
    if best.mean >= COHERENT:
        return []
    views = best.cameras.views
    seen = best.straightened.silhouettes(read_silhouettes(silhouettes, views))
    shown = find_shown(seen)
    return [views[shown[i]] for i in find_doubtful(seen[shown], best.cameras.select(shown))]


if __name__ == "__main__":
    run(main)
