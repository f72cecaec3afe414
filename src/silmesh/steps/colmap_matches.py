"""Match the features of an object's photographs."""

from collections.abc import Sequence
from pathlib import Path

from silmesh.cameras.matching import match
from silmesh.cameras.stages import DATABASE, make_stage, read_report
from silmesh.progress import share_of
from silmesh.settings.cameras import Matches
from silmesh.steps.command import add_settings, output_folder, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--features", type=Path, required=True, help="folder of the features")
    add_settings(args, Matches)
    args.add_argument("--threads", type=int, default=1)
    args.add_argument("--output", type=output_folder, required=True, help="folder to make")
    given = args.parse_args(argv)
    progress = share_of(f"colmap_matches {given.output}")
    make_stage(
        given.output,
        read_report(given.features),
        lambda part, report: match(
            given.features / DATABASE,
            given.settings,
            given.threads,
            part,
            report,
            progress,
        ),
    )


if __name__ == "__main__":
    run(main)
