"""Find the cameras of a turntable from silhouettes, in a world whose axis y is the turntable's."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from silmesh.cameras.calibrate import calibrate, write_report
from silmesh.cameras.camera import write_cameras
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import parser, run
from silmesh.views import read_views


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    args.add_argument("--silhouettes", type=Path, required=True, help="folder of the silhouettes")
    args.add_argument("--step", type=float, help="degrees from view to view, if known")
    args.add_argument("--elevation", type=float, help="in degrees, if known")
    args.add_argument(
        "--above-table",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="the camera does not look up at the table",
    )
    args.add_argument("--threads", type=int, default=torch.get_num_threads())
    args.add_argument("--report", type=Path, required=True, help="report to write, JSON")
    args.add_argument("--output", type=Path, required=True, help="cameras.json to write")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)
    views = read_views(given.views)
    names = [view.view for view in views]
    to_working = views[0].pixel_map
    aspect = float(to_working[1, 1] / to_working[0, 0])
    silhouettes = read_silhouettes(given.silhouettes, names)
    found = calibrate(silhouettes, names, given.step, given.elevation, given.above_table, aspect)
    for warning in found.warnings:
        print(f"silmesh: {warning}", file=sys.stderr)
    write_report(given.report, found)
    write_cameras(given.output, found.cameras)


if __name__ == "__main__":
    run(main)
