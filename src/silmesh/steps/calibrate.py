"""Find the cameras of a turntable from silhouettes, in a world whose axis y is the turntable's."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from silmesh.cameras.attempt import read_attempt, write_attempt
from silmesh.progress import share_of
from silmesh.scene.calibrated_sets import SOURCE, calibrate_sets
from silmesh.scene.sparing import spare_turntable
from silmesh.settings.cameras import Calibrate
from silmesh.settings.turntable import parse_turntable
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import add_settings, output_folder, parser, run
from silmesh.views import ImageFolder, read_views


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    args.add_argument("--silhouettes", type=Path, required=True, help="folder of the silhouettes")
    args.add_argument("--step", type=float, help="degrees from view to view, if known")
    args.add_argument("--elevation", type=float, help="in degrees, if known")
    args.add_argument("--distance", type=float, help="in sizes of the object, if known roughly")
    args.add_argument("--rounds", default="", help="of several rounds: what is known of each")
    args.add_argument(
        "--sets", type=json.loads, default=[], help="JSON: lists of the views of each set"
    )
    add_settings(args, Calibrate)
    args.add_argument(
        "--unless",
        type=Path,
        nargs="*",
        default=[],
        help="folders of attempts that may leave little to gain",
    )
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--output", type=output_folder, required=True, help="folder to make")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)
    views = read_views(given.views)
    before = [read_attempt(folder) for folder in given.unless]
    known = (given.step, given.elevation, given.distance, given.rounds, given.sets)
    spared = spare_turntable(SOURCE, before, len(views), named=any(known))
    attempt = spared or calibrate_sets(
        read_silhouettes(given.silhouettes, [view.view for view in views]),
        views,
        given.sets,
        ImageFolder(given.views),
        step=given.step,
        elevation=given.elevation,
        distance=given.distance,
        rounds=parse_turntable(given.rounds).rounds,
        above_table=given.settings.above_table,
        progress=share_of(f"calibrate {given.output}"),
    )
    for line in (*attempt.warnings, *filter(None, [before and attempt.refusal])):
        print(f"silmesh: {line}", file=sys.stderr)
    write_attempt(given.output, attempt)


if __name__ == "__main__":
    run(main)
