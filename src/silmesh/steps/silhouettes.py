"""Find the silhouette of every view."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from silmesh.silhouettes import NETWORKS, SOURCES, write_silhouettes
from silmesh.steps.command import parser, run
from silmesh.views import read_views


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    args.add_argument("--source", choices=[*SOURCES, *NETWORKS], required=True)
    args.add_argument("--masks", nargs="*", type=Path, default=[], help="files, a view each")
    args.add_argument("--deeplab", type=json.loads, default={}, help="its settings, as JSON")
    args.add_argument("--threads", type=int, help="of a network")
    args.add_argument("--output", type=Path, required=True, help="folder to make")
    given = args.parse_args(argv)
    views = read_views(given.views)
    settings = _prepare(given.deeplab, given.threads) if given.source == "deeplab" else None
    write_silhouettes(given.source, views, given.views, given.masks, given.output, settings)


def _prepare(values: Mapping[str, Any], threads: int | None) -> Any:
    """The network's settings; torch, which the other sources do without, set up for it."""
    import torch

    from silmesh.silhouettes.deeplab import Settings

    torch.set_num_threads(threads or torch.get_num_threads())
    return Settings(**values)


if __name__ == "__main__":
    run(main)
