"""Structure from motion by all features or those on the object, unless others leave little."""

import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import torch

from silmesh.cameras.attempt import read_attempt, write_attempt
from silmesh.progress import share_of
from silmesh.scene.motion import SOURCE, attempt_features
from silmesh.scene.sparing import spare
from silmesh.settings.cameras import Colmap
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import add_settings, output_folder, parser, run
from silmesh.views import ImageFolder, read_views


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--features", type=Path, required=True, help="folder of all features")
    args.add_argument("--masked", action="store_true", help="only those on the object")
    args.add_argument("--unless", type=Path, help="folder of an attempt that may leave little")
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    args.add_argument("--silhouettes", type=Path, required=True, help="folder of the silhouettes")
    add_settings(args, Colmap)
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--output", type=output_folder, required=True, help="folder to make")
    given = args.parse_args(argv)
    torch.set_num_threads(given.threads)
    views = read_views(given.views)
    before = [read_attempt(given.unless)] if given.unless else []
    given.output.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=given.output.parent, prefix=".part-") as scratch:
        attempt = spare(SOURCE, before, len(views)) or attempt_features(
            given.features,
            given.masked,
            views,
            read_silhouettes(given.silhouettes, [view.view for view in views], given.threads),
            given.settings,
            given.threads,
            Path(scratch),
            share_of(f"colmap_attempt {given.output}"),
            ImageFolder(given.views),
        )
    for line in (*attempt.warnings, *filter(None, [attempt.refusal])):
        print(f"silmesh: {line}", file=sys.stderr)
    write_attempt(given.output, attempt)


if __name__ == "__main__":
    run(main)
