"""Resize an object's photographs into square working images, and keep the pixel maps."""

import sys
from collections.abc import Sequence
from pathlib import Path

from silmesh.progress import share_of
from silmesh.settings.views import Views
from silmesh.steps.command import add_settings, output_folder, parser, run
from silmesh.views import count_frames, describe_shapes, list_photographs, write_views


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, call, save."""
    args = parser(__doc__)
    args.add_argument(
        "--images", nargs="+", type=Path, required=True, help="files, their folder, or one .npy"
    )
    add_settings(args, Views)
    args.add_argument(
        "--fewest", type=int, help="photographs that must be readable; all if not given"
    )
    args.add_argument("--threads", type=int, default=1, help="to use")
    args.add_argument("--output", type=output_folder, required=True, help="folder to make")
    given = args.parse_args(argv)
    progress = share_of(f"views {given.output}")
    size, resize = given.settings.size, given.settings.resize
    images = list_photographs(given.images)
    views = write_views(images, size, resize, given.output, given.fewest, progress, given.threads)
    for view in views:
        if view.unreadable:
            print(f"silmesh: {view.unreadable}; the view is dropped", file=sys.stderr)
    shapes = [(view.width, view.height) for view in views if not view.unreadable]
    if said := describe_shapes(shapes):
        print(f"silmesh: {said}", file=sys.stderr)
    for image in images:
        if (frames := count_frames(image)) > 1:
            print(f"silmesh: {image}: has {frames} frames; the first is taken", file=sys.stderr)


if __name__ == "__main__":
    run(main)
