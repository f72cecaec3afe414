"""Sets of photographs between which the object was turned over, joined in one world.

Each set has cameras of its own. The similarity between two sets' worlds is that by which the
silhouettes of both agree best (``cameras.turned``); the photographs' colours decide where the
silhouettes leave several (``cameras.turned_colours``). Then the cameras of both are solved together
(``cameras.turned_together``). What is joined agrees nearly as well as its parts do alone; else the
sets are refused, with what was measured.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from silmesh.cameras.attempt import Attempt
from silmesh.cameras.turned import DISTINCT, Half, Turning, find_turnings
from silmesh.cameras.turned_together import solve_together
from silmesh.errors import InputError
from silmesh.scene.agreement import Normalised
from silmesh.scene.joined_choice import RIVALS, choose
from silmesh.scene.joined_parts import Part, bring, merge, prepare, take_part
from silmesh.views import View

# What both sets lack of a hull IoU of 1 may be so many times what the worse lacks alone, and LOSS
# more.
TIMES, LOSS = 2.0, 0.02


def join_attempts(
    attempts: Sequence[Attempt],
    views: Sequence[View],
    silhouettes: np.ndarray,
    pictures: Mapping[str, Image.Image] | None = None,
) -> Attempt:
    """One attempt of the cameras of several sets of one object.

    Args:
        attempts: of each set, with cameras; no view is in two
        views: all views
        silhouettes: [views, size, size] bool, of all views
        pictures: the working images by the views' names
    Returns:
        the attempt, whose world is the first set's; refused if the sets do not fit each other
    """
    source = attempts[0].source
    parts = [take_part(attempt, views, silhouettes, pictures) for attempt in attempts]
    try:
        whole, joins = parts[0], []
        for part in parts[1:]:
            whole, join = _join(whole, part)
            joins.append(join)
    except InputError as error:
        figures = {"sets": [list(attempt.cameras.views) for attempt in attempts]}
        return Attempt(source, None, refusal=f"cameras {source!r}: {error}", figures=figures)
    order = {view.view: i for i, view in enumerate(views)}
    cameras = whole.attempt.cameras
    sorted_ = sorted(range(len(cameras)), key=lambda i: order[cameras.views[i]])
    figures = {
        "sets": [list(attempt.cameras.views) for attempt in attempts],
        "joins": joins,
        "of_sets": [dict(attempt.figures) for attempt in attempts],
        "disagreeing": merge(attempt.figures.get("disagreeing", {}) for attempt in attempts),
        **whole.normalised.figures,
    }
    said = [warning for attempt in attempts for warning in attempt.warnings]
    said += [f"cameras {source!r}: {line}" for join in joins for line in join["said"]]
    dropped = merge(attempt.dropped for attempt in attempts)
    return Attempt(source, cameras.select(sorted_), None, dropped, tuple(said), figures)


def _join(first: Part, second: Part) -> tuple[Part, dict[str, Any]]:
    """Two sets as one, and what is said of it.

    Raises:
        InputError: a set is too small, or no rotation makes them agree
    """
    worlds = first.normalised, second.normalised
    halves = [prepare(*both) for both in zip((first, second), worlds, strict=True)]
    turnings = find_turnings(*halves)
    best, judged = choose(turnings, (first, second), worlds)
    joined, turning, solved = _solve((first, second), worlds, halves, best, judged)
    coherence, alone = joined.normalised.overall, [world.overall for world in worlds]
    accepted = 1 - TIMES * (1 - min(alone)) - LOSS
    if coherence < accepted:
        raise InputError(_say_apart(first, second, coherence, accepted, alone))
    others = [one for one in turnings if best.angle_to(one) > DISTINCT / 2]
    runner_up = None
    if others:
        rival = bring(first, second, worlds, others[0]).normalised.overall
        runner_up = {"apart": best.angle_to(others[0]), "coherence": rival}
    join = {
        "views": [len(first.views), len(second.views)],
        **_describe_turning(turning),
        "coherence": coherence,
        "alone": alone,
        "runner_up": runner_up,
        "together": solved,
        **judged,
    }
    join["said"] = [_say_join(first, second, join), *_say_together(join), *_say_ambiguous(join)]
    return joined, join


def _describe_turning(turning: Turning) -> dict[str, Any]:
    """A similarity for JSON; its angle is in degrees."""
    return {
        "rotation": turning.Q.tolist(),
        "scale": turning.s,
        "shift": turning.c.tolist(),
        "angle": float(np.degrees(Rotation.from_matrix(turning.Q).magnitude())),
    }


def _solve(
    parts: tuple[Part, Part],
    worlds: tuple[Normalised, Normalised],
    halves: Sequence[Half],
    best: Turning,
    judged: Mapping[str, Any],
) -> tuple[Part, Turning, dict[str, Any] | None]:
    """Both sets as one, how, and what was corrected of their cameras, if that joins them better.

    A turn about the axis of a body of revolution that colours chose stays: no silhouette shows it.
    """
    plain = bring(*parts, worlds, best)
    coloured = judged["by"] == "colours" and judged["revolution"]
    found = None if coloured else solve_together(halves, best)
    if found is None:
        return plain, best, None
    better, before = bring(*parts, worlds, found), plain.normalised.overall
    if better.normalised.overall < before:
        return plain, best, None
    corrections = found.corrections
    solved = {
        "coherence_before": before,
        "degrees": [one.degrees for one in corrections],
        "focal": [one.g for one in corrections],
    }
    return better, found.turning, solved


def _say_apart(
    first: Part, second: Part, coherence: float, accepted: float, alone: Sequence[float]
) -> str:
    return (
        f"{first.name} and {second.name} do not join: at best, of all rotations, the body that "
        f"both sets allow fills {coherence:.3f} of the silhouettes (hull IoU; at least "
        f"{accepted:.3f} is accepted), and those that each allows alone {alone[0]:.3f} and "
        f"{alone[1]:.3f}. Both should show the same object, which kept its shape when it was "
        "turned over"
    )


def _say_join(first: Part, second: Part, join: Mapping[str, Any]) -> str:
    alone = join["alone"]
    by = {
        "silhouettes": "silhouettes",
        "colours": "silhouettes and, where these leave several rotations, their colours",
    }[join["by"]]
    other = join["runner_up"]
    runner_up = (
        f"; the best other rotation, {other['apart']:.0f} degrees away, comes to "
        f"{other['coherence']:.3f}"
        if other
        else ""
    )
    return (
        f"{second.name} were joined to {first.name} by their {by}: the object was turned by "
        f"{join['angle']:.1f} degrees between them, with a joint hull IoU of "
        f"{join['coherence']:.3f} ({alone[0]:.3f} and {alone[1]:.3f} alone){runner_up}"
    )


def _say_together(join: Mapping[str, Any]) -> list[str]:
    solved = join["together"]
    if solved is None:
        return []
    (a, b), (f, g) = solved["degrees"], solved["focal"]
    return [
        f"the cameras of both sets were then solved together: seen from {a:.1f} and {b:.1f} "
        f"degrees elsewhere, with {f:.2f} and {g:.2f} times the focal lengths; joint hull IoU "
        f"{solved['coherence_before']:.4f} before, {join['coherence']:.4f} after"
    ]


def _say_ambiguous(join: Mapping[str, Any]) -> list[str]:
    if not join["ambiguous"]:
        return []
    what = (
        "any turn about its axis explains the silhouettes of both sets as well, as of a body of "
        "revolution"
        if join["revolution"]
        else "rotations that are "
        f"{', '.join(f'{a:.0f}' for a in sorted(join['rivals'])[:RIVALS])} degrees away explain "
        "the silhouettes of both sets as well, as of a symmetric object"
    )
    tried = join.get("colours")
    colours = (
        f", and the colours do not decide (correlation {tried['correlation']:.2f}, of another "
        f"{tried['runner_up']:.2f})"
        if tried
        else ""
    )
    return [
        f"how the object was turned over is ambiguous: {what}{colours}; the shape is right either "
        "way, colours of the second set may be on the wrong side"
    ]
