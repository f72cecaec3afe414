"""Compare the variants with a baseline: a table, one for LaTeX, and figures.

The plan says which runs there are, which experiment and replicate each is, and the configuration. A
run is read from ``<results>/<object>/<variant>/`` (``loss.csv``, ``metrics.json``).
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from silmesh.files import replacing
from silmesh.report.conclusions import Fit, draw_conclusions, to_latex
from silmesh.report.conclusions_figure import draw_conclusions_figure
from silmesh.report.figures import write_figure
from silmesh.steps.command import output_file, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--plan", type=Path, required=True, help="JSON: runs and configuration")
    args.add_argument("--results", type=Path, default=Path("results"), help="their folder")
    args.add_argument("--table", type=output_file, required=True, help="comparison.csv to write")
    args.add_argument("--latex", type=output_file, required=True, help="comparison.tex to write")
    args.add_argument(
        "--figures", type=output_file, nargs="+", required=True, help="to write: svg, pdf"
    )
    given = args.parse_args(argv)
    plan = json.loads(given.plan.read_text(encoding="utf-8"))
    fits = [read_fit(given.results, planned) for planned in plan["runs"]]
    order = list(dict.fromkeys(fit.experiment for fit in fits))
    asked = plan["configuration"]["comparison"]
    table = draw_conclusions(fits, order, plan["baseline"], asked["goal"])
    with replacing(given.table) as part:
        table.to_csv(part, index=False)
    with replacing(given.latex) as part:
        part.write_text(to_latex(table), encoding="utf-8")
    figure = draw_conclusions_figure(table, fits, order)
    for path in given.figures:
        write_figure(path, figure)


def read_fit(results: Path, planned: Mapping[str, Any]) -> Fit:
    """Read a run that the plan says to be one fit of an experiment."""
    folder = results / planned["object"] / planned["variant"]
    curve = pd.read_csv(folder / "loss.csv")
    metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    named = planned["object"], planned["experiment"], planned["replicate"]
    return Fit(*named, curve["loss"].to_numpy(), curve["seconds"].to_numpy(), metrics)


if __name__ == "__main__":
    run(main)
