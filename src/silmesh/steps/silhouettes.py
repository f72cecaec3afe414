"""Find the silhouette of every view."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from silmesh.errors import InputError
from silmesh.naming import match_masks, tell_spare
from silmesh.progress import Progress
from silmesh.settings.silhouettes import Networks, check_source
from silmesh.silhouettes import write_silhouettes
from silmesh.steps.command import add_settings, output_folder, parser, run
from silmesh.views import View, list_masks, read_views


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    args.add_argument("--source", type=_source, required=True, help="as in the table")
    args.add_argument(
        "--masks", nargs="*", type=Path, default=[], help="files, a view each, or their folder"
    )
    add_settings(args, Networks, of="the networks")
    args.add_argument("--threads", type=int, help="to use")
    args.add_argument(
        "--spare", action="store_true", help="an unusable silhouette is empty and not refused"
    )
    args.add_argument("--output", type=output_folder, required=True, help="folder to make")
    given = args.parse_args(argv)
    views = read_views(given.views)
    spared = write_silhouettes(
        given.source,
        views,
        given.views,
        _list_masks(given.masks, views),
        given.output,
        getattr(given.settings, given.source, None),
        given.spare,
        Progress(f"silhouettes {given.output}", len(views)),
        given.threads,
    )
    for wrong in spared:
        print(f"silmesh: {wrong}", file=sys.stderr)


def _list_masks(masks: Sequence[Path], views: Sequence[View]) -> list[Path]:
    """The mask of each view; of a folder, which is the only path then, by their names."""
    if len(masks) != 1 or not masks[0].is_dir():
        return list(masks)
    images = [Path(view.source) for view in views]
    found, spare = match_masks(images, list_masks(masks[0], images))
    for line in tell_spare(spare):
        print(f"silmesh: {line}", file=sys.stderr)
    return found


def _source(name: str) -> str:
    """The type of the argument that names the source."""
    try:
        return check_source(name)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


if __name__ == "__main__":
    run(main)
