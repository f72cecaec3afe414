"""Bring silhouettes and cameras together: take the most coherent cameras, normalise the world."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from silmesh.cameras.attempt import Attempt, read_attempt
from silmesh.cameras.camera import Cameras, Similarity
from silmesh.errors import InputError, blaming
from silmesh.evaluation import coherence
from silmesh.hull import carve
from silmesh.scene import SILHOUETTES, VIEWS, normalising, refuse_camera_inside, write_scene
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import parser, run

DOUBTFUL = 0.5  # below this hull IoU a person is told before the fit, not only on the page


class Candidate(NamedTuple):
    """An attempt's cameras in the normalised world, and how coherent they are."""

    attempt: Attempt
    cameras: Cameras
    similarity: Similarity
    agreement: np.ndarray


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    args.add_argument("--silhouettes", type=Path, required=True, help="folder of the silhouettes")
    args.add_argument("--cameras", type=Path, nargs="+", required=True, help="attempts' folders")
    args.add_argument("--keep-world", action="store_true", help="it is normalised already")
    args.add_argument("--threads", type=int, default=torch.get_num_threads())
    args.add_argument("--output", type=Path, required=True, help="folder to make")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)
    attempts = {folder: read_attempt(folder) for folder in given.cameras}
    candidates = [
        _normalise(folder, attempt, given.silhouettes, given.keep_world)
        for folder, attempt in attempts.items()
        if attempt.cameras is not None
    ]
    if not candidates:
        raise InputError("\n".join(str(attempt.refusal) for attempt in attempts.values()))
    best = max(candidates, key=lambda candidate: candidate.agreement.mean())
    write_scene(
        given.output,
        best.cameras,
        best.similarity,
        best.agreement,
        {VIEWS: given.views, SILHOUETTES: given.silhouettes},
        {"cameras": best.attempt.source, "dropped": dict(best.attempt.dropped)},
    )
    if best.agreement.mean() < DOUBTFUL:
        print(
            f"warning: {given.silhouettes} and {given.cameras[0]} hardly agree: hull IoU "
            f"{best.agreement.mean():.2f}. The fit will be poor unless the cameras (a turntable's "
            "distance, elevation and step) are those of the photographs"
        )


def _normalise(folder: Path, attempt: Attempt, silhouettes: Path, keep_world: bool) -> Candidate:
    cameras = attempt.cameras
    seen = read_silhouettes(silhouettes, cameras.views)
    shown = np.flatnonzero(seen.any(axis=(1, 2)))  # an empty one that was spared says nothing
    with blaming(folder):
        similarity = (
            Similarity.identity() if keep_world else normalising(cameras.select(shown), seen[shown])
        )
        cameras = cameras.in_world_of(similarity)
        refuse_camera_inside(cameras)
    agreement = np.zeros(len(cameras))
    kept = cameras.select(shown)
    agreement[shown] = coherence(carve(seen[shown], kept), kept, seen[shown])
    return Candidate(attempt, cameras, similarity, agreement)


if __name__ == "__main__":
    run(main)
