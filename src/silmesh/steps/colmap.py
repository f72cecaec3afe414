"""Bring a COLMAP model's cameras into our world, and judge them by the silhouettes."""

import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from silmesh.agreement import refuse_incoherent
from silmesh.cameras.attempt import Attempt, write_attempt
from silmesh.cameras.colmap import attempt_model
from silmesh.cameras.stages import MODEL, read_report
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import output_folder, parser, run
from silmesh.views import View, read_views


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
    attempt = judge("colmap", given.model, read_views(given.views), given.silhouettes)
    for line in (*attempt.warnings, *filter(None, [attempt.refusal])):
        print(f"silmesh: {line}", file=sys.stderr)
    write_attempt(given.output, attempt)


def judge(source: str, stage: Path, views: Sequence[View], silhouettes: Path) -> Attempt:
    """The attempt that a model's stage comes to."""
    attempt = attempt_model(source, stage / MODEL, read_report(stage), views)
    if attempt.cameras is None:
        return attempt
    return refuse_incoherent(attempt, read_silhouettes(silhouettes, attempt.cameras.views))


if __name__ == "__main__":
    run(main)
