"""Structure from motion by the features on the object alone, unless it went well without."""

import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import torch

from silmesh.cameras.attempt import read_attempt, write_attempt
from silmesh.progress import share_of
from silmesh.scene.motion import attempt_masked
from silmesh.settings.cameras import Colmap
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import add_settings, output_folder, parser, run
from silmesh.views import ImageFolder, read_views


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--features", type=Path, required=True, help="folder of all features")
    args.add_argument("--unmasked", type=Path, help="the attempt without masks")
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    args.add_argument("--silhouettes", type=Path, required=True, help="folder of the silhouettes")
    add_settings(args, Colmap)
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--output", type=output_folder, required=True, help="folder to make")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)
    views = read_views(given.views)
    given.output.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=given.output.parent, prefix=".part-") as scratch:
        attempt = attempt_masked(
            given.features,
            views,
            read_silhouettes(given.silhouettes, [view.view for view in views]),
            given.settings,
            given.threads,
            Path(scratch),
            given.unmasked and read_attempt(given.unmasked),
            share_of(f"colmap_masked {given.output}"),
            ImageFolder(given.views),
        )
    for line in (*attempt.warnings, *filter(None, [attempt.refusal])):
        print(f"silmesh: {line}", file=sys.stderr)
    write_attempt(given.output, attempt)


if __name__ == "__main__":
    run(main)
