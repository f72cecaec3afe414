"""A scene whose outliers were kept, dropped or repaired."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from PIL import Image

from silmesh.cameras.arcs import CUT
from silmesh.geometry.frame import count_on_frame, is_cut
from silmesh.geometry.robust_hull import robust_carve
from silmesh.geometry.silhouette_iou import coherence
from silmesh.geometry.thresholds import COHERENT
from silmesh.progress import Share, untold
from silmesh.scene.colour_edges import Figures, compare_all, contradict, describe_offset
from silmesh.scene.diagnosis import MANY
from silmesh.scene.outliers import Verdict
from silmesh.scene.policy import DROPPED, REPAIRED, WEIGHTS, Decision, decide
from silmesh.scene.resegmentation import Solved, solve_jointly
from silmesh.scene.scene import Scene, find_similarity

HELD = 2**28  # bytes of working images in memory at a time
GREY = 128  # stands for the colours of a photograph whose colours mean nothing
LOWERING = "lowers the hull IoU most"  # reason of a view that is named although it is no outlier


@dataclass(frozen=True)
class Judged:
    """The result of judging a scene.

    Attributes:
        scene: the views that are left, normalised by their silhouettes
        views: all views that were judged
        frames: [views, 4] left, top, right and bottom of their photographs within the images
        decision: on each of them
        colours: how far the colours of each agree with its silhouette
    """

    scene: Scene
    views: Sequence[str]
    frames: np.ndarray
    decision: Decision
    colours: Sequence[Figures]

    def warnings(self) -> list[str]:
        """Sentences about outliers and about objects that the frame cuts."""
        verdict = self.decision.verdict
        said = [verdict.refusal] if verdict.refusal else []
        for view, fate, reason, (added, removed) in zip(
            self.views, self.decision.fates, verdict.reasons, self.decision.changes, strict=True
        ):
            changed = f"; {added:.1%} of its area added, {removed:.1%} removed"
            if reason:
                said.append(f"view {view!r} is {fate}: {reason}{changed * (fate == REPAIRED)}")
        for i in self.decision.fitted:
            if pixels := count_on_frame(self.decision.silhouettes[i], self.frames[i]):
                said.append(
                    f"view {self.views[i]!r}: the object leaves the photograph ({pixels} pixels on "
                    "its edge); what is beyond only other views show"
                )
        return said


def judge_scene(
    scene: Scene,
    policy: str,
    fewest: int = 3,
    keep_world: bool = False,
    progress: Share = untold,
) -> Judged:
    """Find the outliers among a scene's silhouettes, and keep, drop or segment them again.

    Args:
        scene: as it was built
        policy: ``keep``, ``drop`` or ``repair``
        fewest: views that must be left, if any is dropped
        keep_world: its world is normalised already
        progress: is told which share of what is segmented again is done

    Raises:
        InputError: too few views would be left
    """
    notes, views = scene.notes, scene.cameras.views
    frames = scene.frames

    position = {view: i for i, view in enumerate(views)}
    known = notes.get("disagreeing", {}) | notes["lost"]
    lost = {position[view]: why for view, why in known.items() if view in position}
    unreadable = [position[view] for view in notes["unreadable"] if view in position]

    height, width = scene.silhouettes.shape[1:]

    @lru_cache(max(1, HELD // (3 * height * width)))
    def look(i: int) -> np.ndarray:
        return _read_colours(scene.images[views[i]])

    def solve(verdict: Verdict) -> Solved:
        return solve_jointly(
            look, scene.silhouettes, scene.cameras, verdict, frames, unreadable, progress
        )

    suspects = _suspect(scene)
    decision = decide(
        policy, fewest, scene.silhouettes, scene.cameras, solve, frames, lost, suspects
    )
    colours = compare_all(scene.images, views, decision.silhouettes, frames)
    left = _measure(scene, decision, keep_world, frames)
    notes = notes | {"measured": _keep_measured(notes.get("measured", ()), decision, frames)}
    left = replace(left, notes=_note(notes, views, decision, colours))
    return Judged(left, views, frames, decision, colours)


def _read_colours(image: Image.Image) -> np.ndarray:
    """The colours of a photograph, [height, width, 3] uint8, all alike where they mean nothing.

    What is transparent has any colour, most often black, which would be taken for the background's.
    """
    if image.has_transparency_data:
        return np.full((image.height, image.width, 3), GREY, np.uint8)
    return np.asarray(image.convert("RGB"))


def _suspect(scene: Scene) -> list[int]:
    """Positions of the views whose photographs contradict them, where silhouettes are at odds."""
    if scene.coherence.mean() >= COHERENT:
        return []
    figures = compare_all(scene.images, scene.cameras.views, scene.silhouettes, scene.frames)
    return [i for i, each in enumerate(figures) if contradict(each)]


def _measure(scene: Scene, decision: Decision, keep_world: bool, frames: np.ndarray) -> Scene:
    """The views that are left, their world by their silhouettes, and coherence.

    A scene in which nothing changes is left as it is, to the last bit, but for empty silhouettes.
    """
    lost = [i for i, fate in enumerate(decision.fates) if fate == DROPPED]
    if REPAIRED not in decision.fates and not scene.silhouettes[lost].any():
        return scene.without_empty()  # which had no say
    kept = scene.cameras.select(decision.fitted)
    silhouettes, similarity = decision.silhouettes[decision.fitted], scene.similarity
    frames = frames[decision.fitted]
    if not keep_world and (sound := _find_sound(decision)):
        own = kept.in_world_of(similarity.inverse)
        similarity = find_similarity(
            own.select(sound), silhouettes[sound], frames[sound], scene.points
        )
        kept = own.in_world_of(similarity)
    hull = robust_carve(silhouettes, kept, frames).hull
    return replace(
        scene,
        cameras=kept,
        similarity=similarity,
        silhouettes=silhouettes,
        coherence=coherence(hull, kept, silhouettes, frames),
    )


def _find_sound(decision: Decision) -> list[int]:
    """Positions, among the views that are left, of those whose silhouettes are no outliers now."""
    fates, reasons = decision.fates, decision.verdict.reasons
    left = enumerate(decision.fitted)
    return [n for n, i in left if fates[i] == REPAIRED or not reasons[i]]


def _keep_measured(measured: Sequence[str], decision: Decision, frames: np.ndarray) -> list[str]:
    """What was measured before, but that the frame cuts what only wrong silhouettes showed."""
    left = decision.fitted
    cut = is_cut(decision.silhouettes[left], frames[left])
    if REPAIRED not in decision.fates or cut.sum() >= MANY * len(left):
        return list(measured)
    return [line for line in measured if not line.startswith(CUT)]


def _note(
    notes: Mapping[str, Any], views: Sequence[str], decision: Decision, colours: Sequence[Figures]
) -> dict[str, Any]:
    """What ``scene.json`` says of the views beside what is measured."""
    fates = dict(zip(views, decision.fates, strict=True))
    reasons = {
        v: reason for v, reason in zip(views, decision.verdict.reasons, strict=True) if reason
    }
    lost = {view: reasons[view] for view in reasons if fates[view] == DROPPED}
    return {
        **notes,
        "dropped": notes["dropped"] | lost,
        "measured": [*notes["measured"], *describe_offset(colours)],
        "doubtful": reasons or dict.fromkeys(notes["doubtful"], LOWERING),
        "contradicted": [views[i] for i in decision.fitted if contradict(colours[i])],
        "repaired": [view for view, fate in fates.items() if fate == REPAIRED],
        "repairs": {
            view: {"why": reasons[view], "added": added, "removed": removed}
            for view, (added, removed) in zip(views, decision.changes, strict=True)
            if fates[view] == REPAIRED
        },
        "weights": {views[i]: WEIGHTS[decision.fates[i]] for i in decision.fitted},
    }
