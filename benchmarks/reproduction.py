"""Our loss curves over the report's published ones: a table on standard output, and a figure.

bin/run --configfile config/report.yaml
python benchmarks/reproduction.py --published ../shared/data/published_losses.csv
"""

import argparse
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

ITERATIONS = (0, 100, 200, 300, 500, 1000, 1999)
# Our runs, the published curves that they repeat, and what both are.
PAIRS = [
    (("moisturiser", "uninitialised"), ("moisturiser", "uninitialised"), "sphere of 1,352"),
    (("moisturiser", "initialised"), ("moisturiser", "initialised"), "aligned sphere of 1,922"),
    (("plane", "uninitialised_64"), ("plane", "uninitialised"), "sphere of 1,352, 64 x 64"),
]


def main() -> None:
    """Print the table and draw the figure."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("--losses", type=Path, default=Path("results/report/losses.csv"))
    args.add_argument("--published", type=Path, required=True)
    args.add_argument("--figure", type=Path, default=Path("docs/reproduction.png"))
    given = args.parse_args()
    ours, published = pd.read_csv(given.losses), pd.read_csv(given.published)
    curves = [
        (f"{a[0]}: {what}", _curve(ours, *a, "loss"), _curve(published, *b, "loss"))
        for a, b, what in PAIRS
    ]
    print("\n".join(_table(curves)))
    _draw(curves).savefig(given.figure, dpi=120)


def _curve(losses: pd.DataFrame, name: str, variant: str, column: str) -> pd.Series:
    rows = losses[(losses["object"] == name) & (losses["variant"] == variant)]
    return rows.set_index("iteration")[column]


def _table(curves: list[tuple[str, pd.Series, pd.Series]]) -> list[str]:
    lines = [
        "| | " + " | ".join(f"{i:,}" for i in ITERATIONS) + " |",
        "|---|" + "---:|" * len(ITERATIONS),
    ]
    for title, *both in curves:
        for whose, curve in zip(("ours", "published"), both, strict=True):
            cells = [f"{curve[i]:.4f}" if i in curve.index else "–" for i in ITERATIONS]
            lines.append(f"| {title}, {whose} | " + " | ".join(cells) + " |")
    return lines


def _draw(curves: list[tuple[str, pd.Series, pd.Series]]) -> Figure:
    figure = Figure(figsize=(4.2 * len(curves), 3.6), layout="constrained")
    for axes, (title, ours, published) in zip(
        figure.subplots(1, len(curves), sharey=True), curves, strict=True
    ):
        axes.plot(published.index, published, "o--", color="0.55", ms=4, label="published")
        axes.plot(ours.index, ours, color="#0072b2", label="silmesh")
        axes.set(title=title, xlabel="iteration")
        axes.grid(alpha=0.3)
        axes.legend()
    figure.axes[0].set(ylabel="loss", ylim=(0, 0.9))
    return figure


if __name__ == "__main__":
    main()
