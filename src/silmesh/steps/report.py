"""Gather all runs' results in two tables and one page.

The plan says which runs there are, what their stages are called, and the configuration; see
``silmesh.report.run_files`` for what is read of each. Of more than 50 objects the page is an index,
and each object has a page of its own.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from silmesh.files import replacing
from silmesh.report.run_files import RunFiles, find_folder
from silmesh.report.tables import gather_losses, gather_metrics, read_losses, read_metrics
from silmesh.steps.command import output_file, output_folder, parser, run

CONCLUDED = ("iou", "steps")  # measures of which the page says what can be concluded


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--plan", type=Path, required=True, help="JSON: runs, settings, objects")
    args.add_argument("--results", type=Path, default=Path("results"), help="their folder")
    args.add_argument("--losses", type=output_file, required=True, help="losses.csv to write")
    args.add_argument("--summary", type=output_file, required=True, help="summary.csv to write")
    args.add_argument("--page", type=output_file, required=True, help="report.html to write")
    args.add_argument("--pages", type=output_folder, help="of the objects, if they are many")
    args.add_argument("--conclusions", type=Path, required=True, help="comparison.csv")
    given = args.parse_args(argv)
    plan = json.loads(given.plan.read_text(encoding="utf-8"))
    runs = RunFiles(plan, given.results, given.page.parent)
    page = runs.compose(given.page, given.pages, _read_conclusions(given.conclusions))
    folders = {(r["object"], r["variant"]): find_folder(given.results, r) for r in plan["runs"]}
    losses = read_losses({run: folder / "loss.csv" for run, folder in folders.items()})
    metrics = read_metrics({run: folder / "metrics.json" for run, folder in folders.items()})
    with replacing(given.losses) as part:
        gather_losses(losses).to_csv(part, index=False)
    with replacing(given.summary) as part:
        gather_metrics(metrics).to_csv(part, index=False)
    with replacing(given.page) as part:
        part.write_text(page, encoding="utf-8")


def _read_conclusions(table: Path) -> list[str]:
    compared = pd.read_csv(table)
    return list(compared[compared["measure"].isin(CONCLUDED)]["conclusion"])


if __name__ == "__main__":
    run(main)
