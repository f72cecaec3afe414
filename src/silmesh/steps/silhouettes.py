"""Find the silhouette of every view."""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from silmesh.silhouettes import NETWORKS, SOURCES, matting, write_silhouettes
from silmesh.steps.command import parser, run
from silmesh.views import read_views


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    args.add_argument("--source", choices=[*SOURCES, *NETWORKS], required=True)
    args.add_argument("--masks", nargs="*", type=Path, default=[], help="files, a view each")
    args.add_argument("--settings", type=json.loads, default={}, help="of a network, as JSON")
    args.add_argument(
        "--spare", action="store_true", help="an unusable silhouette is empty and not refused"
    )
    args.add_argument("--output", type=Path, required=True, help="folder to make")
    given = args.parse_args(argv)
    views = read_views(given.views)
    spared = write_silhouettes(
        given.source,
        views,
        given.views,
        given.masks,
        given.output,
        _prepare(given.source, given.settings),
        given.spare,
    )
    for wrong in spared:
        print(f"silmesh: {wrong}", file=sys.stderr)


def _prepare(source: str, values: Mapping[str, Any]) -> Any:
    """A network's settings; another source has none."""
    return matting.Settings(**values) if source == "matting" else None


if __name__ == "__main__":
    run(main)
