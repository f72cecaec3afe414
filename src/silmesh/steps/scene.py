"""Silhouettes and cameras: undistort, take the most coherent cameras, normalise the world."""

import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from silmesh.cameras.attempt import read_attempt
from silmesh.scene.assemble import build_scene
from silmesh.scene.scene import write_scene
from silmesh.silhouettes import read_lost, read_silhouettes
from silmesh.steps.command import output_folder, parser, run
from silmesh.views import read_views

INCOHERENT = 0.5  # below this hull IoU there is a warning before the fit, not only on the page


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
    views = read_views(given.views)
    attempts = [read_attempt(folder) for folder in given.cameras]
    made = build_scene(
        attempts,
        views,
        read_silhouettes(given.silhouettes, [view.view for view in views], given.threads),
        given.keep_world,
        read_lost(given.silhouettes),
        list(map(str, given.cameras)),
    )
    write_scene(given.output, made.scene, given.views, made.undistorted)
    for warning in made.attempt.warnings[len(attempts[made.taken].warnings) :]:
        print(f"silmesh: {warning}", file=sys.stderr)
    if len(attempts) > 1:
        why = made.scene.notes["cameras_because"]
        print(f"{given.silhouettes}: cameras from {made.attempt.source} are taken. {why}")
    if (mean := made.scene.coherence.mean()) < INCOHERENT:
        outliers = made.scene.notes["doubtful"]
        blamed = f", probable outliers: {', '.join(outliers)}" if outliers else ""
        named = made.attempt.figures.get("file", given.cameras[made.taken])
        print(
            f"warning: {given.silhouettes} and {named} hardly agree: hull IoU "
            f"{mean:.2f}{blamed}. The fit will be poor unless the cameras (a turntable's "
            "distance, elevation and step) are those of the photographs"
        )


if __name__ == "__main__":
    run(main)
