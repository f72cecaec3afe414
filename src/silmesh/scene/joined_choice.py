"""Which of several ways to join two sets is taken, and which others are as good."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from silmesh.cameras.turned import Turning
from silmesh.cameras.turned_colours import correlate_colours
from silmesh.geometry.visual_hull import carve
from silmesh.scene.agreement import Normalised
from silmesh.scene.joined_parts import Part, bring

# Colours decide if their correlation is AGREE at least, and lacks of 1 at most BETTER of what that
# of any other rotation lacks.
AGREE, BETTER = 0.3, 0.8
RIVALS = 6  # most rotations that silhouettes leave, which are compared by colours
COARSE = 48  # samples a side of hulls whose surface is coloured
TURN, FINER = 5.0, 1.0  # degrees between the turns about the axis of a body of revolution
# Rivals about one axis, within so many degrees of it, from which the shape is taken for a body of
# revolution.
MANY, ONE_AXIS = 3, 15.0


def choose(
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
    return bool((np.abs(axes @ axes[0]) > np.cos(np.radians(ONE_AXIS))).all())


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
    joined = bring(*parts, worlds, best)
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
