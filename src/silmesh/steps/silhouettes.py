"""Find the silhouette of every view."""

from collections.abc import Sequence
from pathlib import Path

from silmesh.silhouettes import SOURCES, write_silhouettes
from silmesh.steps.command import parser, run
from silmesh.views import read_views


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    args.add_argument("--source", choices=list(SOURCES), required=True)
    args.add_argument("--masks", nargs="*", type=Path, default=[], help="files, a view each")
    args.add_argument("--output", type=Path, required=True, help="folder to make")
    given = args.parse_args(argv)
    views = read_views(given.views)
    write_silhouettes(given.source, views, given.views, given.masks, given.output)


if __name__ == "__main__":
    run(main)
