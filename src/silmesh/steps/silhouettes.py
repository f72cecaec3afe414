"""Find the silhouette of every view."""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from silmesh.progress import Progress
from silmesh.silhouettes import NETWORKS, SOURCES, write_silhouettes
from silmesh.steps.command import output_folder, parser, run
from silmesh.views import read_views


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    args.add_argument("--source", choices=[*SOURCES, *NETWORKS], required=True)
    args.add_argument("--masks", nargs="*", type=Path, default=[], help="files, a view each")
    args.add_argument("--settings", type=json.loads, default={}, help="of a network, as JSON")
    args.add_argument("--threads", type=int, help="of a network")
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
        given.masks,
        given.output,
        _prepare(given.source, given.settings, given.threads),
        given.spare,
        Progress(f"silhouettes {given.output}", len(views)),
    )
    for wrong in spared:
        print(f"silmesh: {wrong}", file=sys.stderr)


def _prepare(source: str, values: Mapping[str, Any], threads: int | None) -> Any:
    """A network's settings, imported and set up only for it; another source has none."""
    if source == "matting":
        from silmesh.silhouettes.matting import Settings

        return Settings(**values, threads=threads or 1)
    if source == "deeplab":
        import torch

        from silmesh.silhouettes.deeplab import Settings

        torch.set_num_threads(threads or torch.get_num_threads())
        return Settings(**values)
    return None


if __name__ == "__main__":
    run(main)
