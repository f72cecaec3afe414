"""Structure from motion by the features on the object alone, unless it went well without."""

import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import torch

from silmesh.cameras.attempt import Attempt, read_attempt, write_attempt
from silmesh.cameras.features import keep_inside
from silmesh.cameras.mapping import map_views
from silmesh.cameras.matching import match
from silmesh.cameras.stages import DATABASE, make_stage, read_report
from silmesh.progress import share_of, within
from silmesh.settings.cameras import Colmap
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.colmap import judge
from silmesh.steps.command import add_settings, output_folder, parser, run
from silmesh.thresholds import COHERENT
from silmesh.views import read_views

SOURCE = "colmap, masked"
MATCHED = 0.6  # share of the time, by which the photographs are matched


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
    attempt = _good_enough(given.unmasked)
    if attempt is None:
        views = read_views(given.views)
        progress = share_of(f"colmap_masked {given.output}")
        seen = read_silhouettes(given.silhouettes, [view.view for view in views])
        given.output.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=given.output.parent, prefix=".part-") as scratch:
            inside, matches, model = (Path(scratch) / name for name in ("f", "m", "s"))
            make_stage(
                inside,
                read_report(given.features),
                lambda part, report: keep_inside(
                    given.features / DATABASE, views, seen, part, report
                ),
            )
            make_stage(
                matches,
                read_report(inside),
                lambda part, report: match(
                    inside / DATABASE,
                    given.settings,
                    given.threads,
                    part,
                    report,
                    within(progress, 0, MATCHED),
                ),
            )
            make_stage(
                model,
                read_report(matches),
                lambda part, report: map_views(
                    matches / DATABASE,
                    given.settings,
                    part,
                    report,
                    within(progress, MATCHED, 1),
                ),
            )
            attempt = judge(SOURCE, model, views, given.silhouettes)
    for line in (*attempt.warnings, *filter(None, [attempt.refusal])):
        print(f"silmesh: {line}", file=sys.stderr)
    write_attempt(given.output, attempt)


def _good_enough(unmasked: Path | None) -> Attempt | None:
    """What stands for an attempt that is not needed."""
    if unmasked is None:
        return None
    coherence = read_attempt(unmasked).figures.get("coherence", 0.0)
    if coherence < COHERENT:
        return None
    why = f"not tried, for without masks the hull IoU is {coherence:.3f}"
    return Attempt(SOURCE, None, refusal=why)


if __name__ == "__main__":
    run(main)
