"""Find the features of an object's photographs, for structure from motion."""

from collections.abc import Sequence
from pathlib import Path

from silmesh.cameras.features import extract
from silmesh.cameras.stages import Report, make_stage
from silmesh.progress import share_of
from silmesh.settings.cameras import Features
from silmesh.steps.command import add_settings, output_folder, parser, run
from silmesh.views import list_photographs


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, call, save."""
    args = parser(__doc__)
    args.add_argument("--images", nargs="+", type=Path, required=True, help="files, or a folder")
    add_settings(args, Features)
    args.add_argument("--threads", type=int, default=1)
    args.add_argument("--output", type=output_folder, required=True, help="folder to make")
    given = args.parse_args(argv)
    progress = share_of(f"colmap_features {given.output}")
    images = list_photographs(given.images)
    make_stage(
        given.output,
        Report(),
        lambda part, _: extract(images, given.settings, given.threads, part, progress),
    )


if __name__ == "__main__":
    run(main)
