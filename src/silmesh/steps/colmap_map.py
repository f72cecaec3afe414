"""Find cameras and points from matches: a COLMAP model."""

from collections.abc import Sequence
from pathlib import Path

from silmesh.cameras.mapping import map_views
from silmesh.cameras.stages import DATABASE, make_stage, read_report
from silmesh.progress import share_of
from silmesh.settings.cameras import Reconstruction
from silmesh.steps.command import add_settings, output_folder, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--matches", type=Path, required=True, help="folder of the matches")
    add_settings(args, Reconstruction)
    args.add_argument("--output", type=output_folder, required=True, help="folder to make")
    given = args.parse_args(argv)
    progress = share_of(f"colmap_map {given.output}")
    make_stage(
        given.output,
        read_report(given.matches),
        lambda part, report: map_views(
            given.matches / DATABASE, given.settings, part, report, progress
        ),
    )


if __name__ == "__main__":
    run(main)
