"""Judge the silhouettes of a scene, and keep, drop or segment again the doubtful views."""

import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numba
import numpy as np
import torch
from PIL import Image

from silmesh.cameras.camera import Cameras, Similarity
from silmesh.errors import blaming
from silmesh.evaluation import coherence
from silmesh.files import making
from silmesh.geometry.frame import count_on_frame
from silmesh.hull import carve
from silmesh.judging.colours import Figures, compare_all, contradict
from silmesh.judging.policy import DROPPED, KEPT, REPAIRED, WEIGHTS, Decision, decide
from silmesh.judging.repair import repair
from silmesh.judging.table import write_table
from silmesh.progress import share_of
from silmesh.scene import SILHOUETTES, VIEWS, normalising, read_scene, write_scene
from silmesh.settings.quality import Quality
from silmesh.silhouettes import encode, read_silhouettes
from silmesh.steps.command import add_settings, output_folder, parser, run

ORIGINALS = "originals"  # in the scene's folder
LOWERING = "lowers the hull IoU most"  # what the scene says of views, where nothing worse is found
MEASURED = ("centre", "scale", "hull_iou_mean", "hull_iou")  # of scene.json: measured again


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    add_settings(args, Quality)
    args.add_argument("--source", default="", help="of the silhouettes, by which policy auto goes")
    args.add_argument("--keep-world", action="store_true", help="it is normalised already")
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--output", type=output_folder, required=True, help="folder to make")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)
    numba.set_num_threads(min(given.threads, numba.config.NUMBA_NUM_THREADS))
    cameras, similarity, told = read_scene(given.scene)
    found = read_silhouettes(given.scene / SILHOUETTES, cameras.views)
    frames = np.array([told["frames"][view] for view in cameras.views])

    def segment(doubtful: Sequence[int], sound: Sequence[int]) -> np.ndarray:
        shown = [Image.open(given.scene / VIEWS / f"{cameras.views[i]}.png") for i in doubtful]
        progress = share_of(f"judge {given.output}")
        return repair(shown, found, cameras, doubtful, sound, frames, progress)

    place = {view: i for i, view in enumerate(cameras.views)}
    lost = {place[view]: why for view, why in told["lost"].items() if view in place}
    unreadable = [place[view] for view in told["unreadable"] if view in place]
    with blaming(given.scene):
        decision = decide(
            given.settings.policy_for(given.source),
            given.settings.fewest,
            found,
            cameras,
            segment,
            frames,
            lost,
            unreadable,
        )
    colours = compare_all(given.scene / VIEWS, cameras.views, decision.silhouettes, frames)
    world = _measure(cameras, similarity, told, decision, given.keep_world)
    told = _tell(told, cameras.views, decision, colours)
    _write(given.output, given.scene, world, told, cameras.views, decision, colours)
    _say(given.scene, cameras.views, frames, decision)


def _measure(
    cameras: Cameras,
    similarity: Similarity,
    told: Mapping[str, Any],
    decision: Decision,
    keep_world: bool,
) -> tuple[Cameras, Similarity, np.ndarray]:
    """The cameras of the fitted views, their world by the fitted silhouettes, and coherence.

    A scene in which nothing changes is left as it is, to the last bit.
    """
    if set(decision.fates) == {KEPT}:
        return cameras, similarity, np.array([told["hull_iou"][view] for view in cameras.views])
    kept = cameras.select(decision.fitted)
    seen = decision.silhouettes[decision.fitted]
    if not keep_world:
        kept = kept.in_world_of(similarity.inverse)
        similarity = normalising(kept, seen)
        kept = kept.in_world_of(similarity)
    return kept, similarity, coherence(carve(seen, kept), kept, seen)


def _tell(
    told: Mapping[str, Any], views: Sequence[str], decision: Decision, colours: Sequence[Figures]
) -> dict[str, Any]:
    """What ``scene.json`` says of the views beside what is measured."""
    fates = dict(zip(views, decision.fates, strict=True))
    doubts = {v: doubt for v, doubt in zip(views, decision.verdict.doubts, strict=True) if doubt}
    lost = {view: doubts[view] for view in doubts if fates[view] == DROPPED}
    return {key: value for key, value in told.items() if key not in MEASURED} | {
        "dropped": told["dropped"] | lost,
        "doubtful": doubts or dict.fromkeys(told["doubtful"], LOWERING),
        "contradicted": [views[i] for i in decision.fitted if contradict(colours[i])],
        "repaired": [view for view, fate in fates.items() if fate == REPAIRED],
        "weights": {views[i]: WEIGHTS[decision.fates[i]] for i in decision.fitted},
    }


def _write(
    output: Path,
    scene: Path,
    world: tuple[Cameras, Similarity, np.ndarray],
    told: Mapping[str, Any],
    views: Sequence[str],
    decision: Decision,
    colours: Sequence[Figures],
) -> None:
    """Write the scene anew, with ``quality.csv`` and the doubtful silhouettes as they were."""
    with making(output) as part, TemporaryDirectory() as made:
        for i in decision.fitted:
            encode(decision.silhouettes[i]).save(Path(made) / f"{views[i]}.png")
        write_scene(part, *world, {VIEWS: scene / VIEWS, SILHOUETTES: Path(made)}, told)
        (part / ORIGINALS).mkdir()
        for view in told["doubtful"]:
            shutil.copyfile(scene / SILHOUETTES / f"{view}.png", part / ORIGINALS / f"{view}.png")
        write_table(part, views, decision, colours)


def _say(scene: Path, views: Sequence[str], frames: np.ndarray, decision: Decision) -> None:
    """Tell a person of doubtful and cut views before the fit, not only on the page."""
    if decision.verdict.refusal:
        print(f"silmesh: {scene}: {decision.verdict.refusal}", file=sys.stderr)
    for view, fate, doubt in zip(views, decision.fates, decision.verdict.doubts, strict=True):
        if doubt:
            print(f"silmesh: {scene}: view {view!r} is {fate}: {doubt}", file=sys.stderr)
    for i in decision.fitted:
        if pixels := count_on_frame(decision.silhouettes[i], frames[i]):
            print(
                f"silmesh: {scene}: view {views[i]!r}: the object leaves the photograph ({pixels} "
                "pixels on its edge); what is beyond only other views show",
                file=sys.stderr,
            )


if __name__ == "__main__":
    run(main)
