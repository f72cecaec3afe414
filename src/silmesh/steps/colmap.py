"""Bring a COLMAP model's cameras into our world, and judge them by the silhouettes."""

import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from silmesh.cameras.attempt import write_attempt
from silmesh.scene.motion import SOURCE, judge_model
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import output_folder, parser, run
from silmesh.views import ImageFolder, read_views


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--model", type=Path, required=True, help="folder of the model's stage")
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    args.add_argument("--silhouettes", type=Path, required=True, help="folder of the silhouettes")
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--output", type=output_folder, required=True, help="folder to make")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)
    views = read_views(given.views)
    silhouettes = read_silhouettes(given.silhouettes, [view.view for view in views])
    attempt = judge_model(SOURCE, given.model, views, silhouettes, ImageFolder(given.views))
    for line in (*attempt.warnings, *filter(None, [attempt.refusal])):
        print(f"silmesh: {line}", file=sys.stderr)
    write_attempt(given.output, attempt)


if __name__ == "__main__":
    run(main)
