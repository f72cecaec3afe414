"""Make or read the cameras of the working images, in the world that they come in."""

import sys
from collections.abc import Sequence
from pathlib import Path

from silmesh.cameras.attempt import write_attempt
from silmesh.cameras.formats import attempt_from_file
from silmesh.cameras.known import attempt_turntable
from silmesh.errors import blaming
from silmesh.steps.command import output_folder, parser, run
from silmesh.views import read_views


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    source = args.add_mutually_exclusive_group(required=True)
    source.add_argument(
        "--turntable",
        nargs=3,
        type=float,
        metavar=("DISTANCE", "ELEVATION", "STEP"),
        help="in scene units and degrees",
    )
    source.add_argument("--file", type=Path, help="a file or a folder of cameras")
    args.add_argument("--output", type=output_folder, required=True, help="folder to make")
    given = args.parse_args(argv)
    views = read_views(given.views)
    if given.file:
        attempt = attempt_from_file(given.file, views)
    else:
        numbers = ",".join(f"{number:g}" for number in given.turntable)
        with blaming(f"turntable {numbers} of {given.views}"):
            attempt = attempt_turntable(views, *given.turntable)
    for warning in attempt.warnings:
        print(f"silmesh: {warning}", file=sys.stderr)
    write_attempt(given.output, attempt)


if __name__ == "__main__":
    run(main)
