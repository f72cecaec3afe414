"""Sets of photographs between which the object was turned over, joined in one world.

Each set has cameras of its own. The similarity between two sets' worlds is that by which the
silhouettes of both agree best (``cameras.turned``); the photographs' colours decide where the
silhouettes leave several (``cameras.turned_colours``). What is joined agrees nearly as well as its
parts do alone; else the sets are refused, with what was measured.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from PIL import Image
from scipy.spatial.transform import Rotation

from silmesh.cameras.attempt import Attempt
from silmesh.cameras.sets import FEWEST
from silmesh.cameras.turned import DISTINCT, Half, Turning, find_turnings
from silmesh.cameras.turned_colours import correlate_colours
from silmesh.errors import InputError, blaming
from silmesh.geometry.camera import Cameras
from silmesh.geometry.visual_hull import carve
from silmesh.scene.agreement import Normalised, normalise
from silmesh.views import View, stack_pictures

# What both sets lack of a hull IoU of 1 may be so many times what the worse lacks alone, and LOSS
# more.
TIMES, LOSS = 2.0, 0.02
# Colours decide if their correlation is AGREE at least, and lacks of 1 at most BETTER of what that
# of any other rotation lacks.
AGREE, BETTER = 0.3, 0.8
RIVALS = 6  # most rotations that silhouettes leave, which are compared by colours
COARSE = 48  # samples a side of hulls whose surface is coloured
TURN, FINER = 5.0, 1.0  # degrees between the turns about the axis of a body of revolution
MANY = 3  # rivals about one axis, from which the shape is taken for a body of revolution


@dataclass(frozen=True)
class Part:
    """A set's views with its own cameras, in its own normalised world.

    Attributes:
        attempt: at its cameras
        views: those that have one, in the order of the cameras
        silhouettes: [views, size, size] bool
        pictures: [views, size, size, 3] uint8, the working images; None if they are not given
    """

    attempt: Attempt
    views: tuple[View, ...]
    silhouettes: np.ndarray
    pictures: np.ndarray | None

    @property
    def frames(self) -> np.ndarray:
        """[views, 4] of the photographs within the working images."""
        return np.array([view.frame for view in self.views])

    def normalised(self) -> Normalised:
        """Its cameras in its normalised world."""
        suspects = self.attempt.figures.get("disagreeing", ())
        with blaming(_name(self)):
            return normalise(
                self.attempt.cameras, self.silhouettes, frames=self.frames, suspects=suspects
            )


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
    parts = [_take_part(attempt, views, silhouettes, pictures) for attempt in attempts]
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
        "disagreeing": _merge(attempt.figures.get("disagreeing", {}) for attempt in attempts),
    }
    said = [warning for attempt in attempts for warning in attempt.warnings]
    said += [f"cameras {source!r}: {line}" for join in joins for line in join["said"]]
    dropped = _merge(attempt.dropped for attempt in attempts)
    return Attempt(source, cameras.select(sorted_), None, dropped, tuple(said), figures)


def _merge(mappings: Any) -> dict[str, Any]:
    merged: dict[str, Any] = {}
    for mapping in mappings:
        merged |= mapping
    return merged


def _take_part(
    attempt: Attempt,
    views: Sequence[View],
    silhouettes: np.ndarray,
    pictures: Mapping[str, Image.Image] | None,
) -> Part:
    place = {view.view: i for i, view in enumerate(views)}
    at = [place[view] for view in attempt.cameras.views]
    shown = None if pictures is None else stack_pictures(pictures, attempt.cameras.views)
    return Part(attempt, tuple(views[i] for i in at), silhouettes[at], shown)


def _join(first: Part, second: Part) -> tuple[Part, dict[str, Any]]:
    """Two sets as one, and what is said of it.

    Raises:
        InputError: a set is too small, or no rotation makes them agree
    """
    worlds = first.normalised(), second.normalised()
    halves = [_prepare(*both) for both in zip((first, second), worlds, strict=True)]
    turnings = find_turnings(*halves)
    best, judged = _choose(turnings, (first, second), worlds)
    joined = _bring(first, second, worlds, best)
    coherence, alone = joined.normalised().overall, [world.overall for world in worlds]
    if 1 - coherence > TIMES * (1 - min(alone)) + LOSS:
        raise InputError(_say_apart(first, second, coherence, alone))
    others = [one for one in turnings if best.angle_to(one) > DISTINCT / 2]
    join = {
        "views": [len(first.views), len(second.views)],
        "rotation": best.Q.tolist(),
        "scale": best.s,
        "shift": best.c.tolist(),
        "angle": float(np.degrees(Rotation.from_matrix(best.Q).magnitude())),
        "coherence": coherence,
        "alone": alone,
        "runner_up": None,
        **judged,
    }
    if others:
        rival = _bring(first, second, worlds, others[0]).normalised().overall
        join["runner_up"] = {"apart": best.angle_to(others[0]), "coherence": rival}
    join["said"] = [_say_join(first, second, join), *_say_ambiguous(join)]
    return joined, join


def _say_apart(first: Part, second: Part, coherence: float, alone: Sequence[float]) -> str:
    return (
        f"{_name(first)} and {_name(second)} do not join: at best, of all rotations, the body that "
        f"both sets allow fills {coherence:.3f} of the silhouettes (hull IoU), and those that each "
        f"allows alone {alone[0]:.3f} and {alone[1]:.3f}. Both should show the same object, which "
        "kept its shape when it was turned over"
    )


def _prepare(part: Part, world: Normalised) -> Half:
    """What the search takes of a set: views that say something and are not contradicted."""
    silhouettes = world.undistorted.silhouettes(part.silhouettes)
    silent = {*world.contradicted, *world.empty, *np.flatnonzero(silhouettes.all(axis=(1, 2)))}
    kept = [i for i in range(len(silhouettes)) if i not in silent]
    if len(kept) < FEWEST:
        raise InputError(
            f"{_name(part)}: {len(kept)} views of the set have a camera and a silhouette that can "
            f"be used; to find how the object was turned over it takes at least {FEWEST}"
        )
    frames = world.undistorted.frames[kept]
    return Half.prepare(silhouettes[kept], world.cameras.select(kept), frames)


def _bring(
    first: Part, second: Part, worlds: tuple[Normalised, Normalised], turning: Turning
) -> Part:
    """Both sets in the first one's normalised world, their lenses kept."""
    here = first.attempt.cameras.in_world_of(worlds[0].similarity)
    there = turning.bring(second.attempt.cameras.in_world_of(worlds[1].similarity))
    figures = {
        "disagreeing": _merge(p.attempt.figures.get("disagreeing", {}) for p in (first, second))
    }
    pictures = [part.pictures for part in (first, second)]
    return Part(
        replace(first.attempt, cameras=_concatenate(here, there), figures=figures),
        (*first.views, *second.views),
        np.concatenate([first.silhouettes, second.silhouettes]),
        None if any(p is None for p in pictures) else np.concatenate(pictures),
    )


def _concatenate(*cameras: Cameras) -> Cameras:
    return Cameras(
        tuple(view for one in cameras for view in one.views),
        *(torch.cat([getattr(one, name) for one in cameras]) for name in ("sizes", "K", "R", "t")),
        tuple(lens for one in cameras for lens in one.lenses),
    )


def _choose(
    turnings: Sequence[Turning], parts: tuple[Part, Part], worlds: tuple[Normalised, Normalised]
) -> tuple[Turning, dict[str, Any]]:
    """The similarity that is taken, by what it was found, and which others are as good."""
    best, *others = turnings
    rivals = [one for one in others if best.explains_as_well(one)]
    notes = {"by": "silhouettes", "ambiguous": False, "rivals": []}
    if not rivals:
        return best, notes
    apart = [best.angle_to(one) for one in rivals]
    lathe = len(rivals) >= MANY and _share_axis(best, rivals)
    notes |= {"ambiguous": True, "rivals": apart, "revolution": lathe}
    if any(part.pictures is None for part in parts):
        return best, notes
    candidates = _turn_about(best, rivals) if lathe else [best, *rivals[:RIVALS]]
    agreed = _compare_colours(candidates, best, parts, worlds)
    order = np.argsort(-agreed)
    chosen = candidates[order[0]]
    far = [i for i in order if chosen.angle_to(candidates[i]) > 2 * TURN]
    second = float(agreed[far[0]]) if far else 0.0
    notes["colours"] = {"correlation": float(agreed[order[0]]), "runner_up": second}
    if agreed[order[0]] < AGREE or 1 - agreed[order[0]] > BETTER * (1 - second):
        return best, notes
    if lathe:
        chosen = _refine(chosen, best, rivals, parts, worlds)
    return chosen, notes | {"by": "colours", "ambiguous": False}


def _share_axis(best: Turning, rivals: Sequence[Turning]) -> bool:
    """Whether all rivals are turned against the best about one axis."""
    axes = np.array([best.axis_to(one)[0] for one in rivals])
    return bool((np.abs(axes @ axes[0]) > np.cos(np.radians(15))).all())


def _axis_of(best: Turning, rivals: Sequence[Turning]) -> tuple[np.ndarray, np.ndarray]:
    """The axis of a body of revolution, by the rival that is turned nearest to a quarter."""
    return best.axis_to(min(rivals, key=lambda one: abs(best.angle_to(one) - 90)))


def _turn_about(best: Turning, rivals: Sequence[Turning]) -> list[Turning]:
    """Turns all about the axis of a body of revolution."""
    axis, point = _axis_of(best, rivals)
    return [best.turned_about(axis, point, angle) for angle in np.arange(0, 360, TURN)]


def _refine(
    chosen: Turning,
    best: Turning,
    rivals: Sequence[Turning],
    parts: tuple[Part, Part],
    worlds: tuple[Normalised, Normalised],
) -> Turning:
    axis, point = _axis_of(best, rivals)
    near = [chosen.turned_about(axis, point, a) for a in np.arange(-TURN, TURN + FINER, FINER)]
    return near[int(_compare_colours(near, best, parts, worlds).argmax())]


def _compare_colours(
    candidates: Sequence[Turning],
    best: Turning,
    parts: tuple[Part, Part],
    worlds: tuple[Normalised, Normalised],
) -> np.ndarray:
    """How well the colours of both sets agree by each candidate, on the hull of the best."""
    joined = _bring(*parts, worlds, best)
    hull = carve(joined.silhouettes, joined.attempt.cameras, COARSE, frames=joined.frames)
    if hull.empty:
        return np.zeros(len(candidates))
    verts, faces = hull.surface()
    normals = _normals(verts, faces)
    shown = [
        (part.attempt.cameras.in_world_of(world.similarity), part.pictures)
        for part, world in zip(parts, worlds, strict=True)
    ]
    return correlate_colours(verts, normals, *shown, candidates)


def _normals(verts: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals of a closed mesh's vertices, outwards: [verts, 3]."""
    a, b, c = (verts[faces[:, i]] for i in range(3))
    across = np.cross(b - a, c - a)
    if (across * (a + b + c)).sum() < 0:
        across = -across
    total = np.zeros_like(verts)
    for i in range(3):
        np.add.at(total, faces[:, i], across)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)


def _name(part: Part) -> str:
    return f"the {len(part.views)} views {part.views[0].view!r} to {part.views[-1].view!r}"


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
        f"{_name(second)} were joined to {_name(first)} by their {by}: the object was turned by "
        f"{join['angle']:.1f} degrees between them, with a joint hull IoU of "
        f"{join['coherence']:.3f} ({alone[0]:.3f} and {alone[1]:.3f} alone){runner_up}"
    )


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
