"""The figure of a comparison: differences with their intervals, and performance profiles."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from silmesh.report.conclusions import MEASURES, Fit
from silmesh.report.figures import FAINT, INK, STYLE, style_of
from silmesh.report.statistics import profile

SHOWN = ("loss", "steps")  # measures whose differences are drawn
RATIOS = np.linspace(1, 3, 201)  # over the best final loss of an object
WIDTH, ROW, AROUND = 11.0, 0.28, 1.5  # inches: of all, of a variant, of titles and axes


def draw_conclusions_figure(
    table: pd.DataFrame, fits: Sequence[Fit], order: Sequence[str]
) -> Figure:
    """Draw the differences of two measures, a row a variant, and beside them the profiles.

    Args:
        table: as ``draw_conclusions`` makes it
        fits: all of them
        order: of the experiments
    """
    with mpl.rc_context(STYLE):
        height = max(2.6, AROUND + ROW * len(order))
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        FigureCanvasAgg(figure)
        *panels, last = figure.subplots(1, len(SHOWN) + 1)
        for axes, measure in zip(panels, SHOWN, strict=True):
            _draw_differences(axes, table[table["measure"] == measure], measure, order)
        _draw_profiles(last, fits, order)
    return figure


def _draw_differences(axes: Axes, rows: pd.DataFrame, measure: str, order: Sequence[str]) -> None:
    """Medians as dots, their intervals as lines; left of zero is better than the baseline."""
    axes.axvline(0, color=INK, linewidth=0.8)
    names = [name for name in order if name in set(rows["variant"])]
    for place, name in enumerate(names):
        row = rows[rows["variant"] == name].iloc[0]
        colour = style_of(name, order)["color"]
        if pd.notna(row["low"]):
            axes.plot([row["low"], row["high"]], [place, place], color=colour, linewidth=1.6)
        axes.plot(row["difference"], place, "o", color=colour, ms=5)
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    baseline = rows["baseline"].iloc[0] if len(rows) else ""
    _name(axes, f"{MEASURES[measure]}, less that of {baseline}")


def _draw_profiles(axes: Axes, fits: Sequence[Fit], order: Sequence[str]) -> None:
    """The share of objects on which each variant's final loss is within a factor of the best."""
    ends = pd.DataFrame(
        {"object": f.object, "experiment": f.experiment, "loss": f.loss[-1]} for f in fits
    )
    costs = ends.pivot_table("loss", "object", "experiment", "median").reindex(columns=list(order))
    shares = profile(costs.to_numpy(), RATIOS)
    for name, share in zip(order, shares.T, strict=True):
        axes.plot(RATIOS, share, linewidth=1.6, label=name, **style_of(name, order))
    axes.set_ylim(0, 1.03)
    axes.set_xlim(RATIOS[0], RATIOS[-1])
    axes.legend(frameon=False, fontsize=8, labelcolor=INK)
    _name(axes, "final loss over the object's best")
    axes.set_ylabel("share of the objects", color=INK)


def _name(axes: Axes, label: str) -> None:
    axes.set_xlabel(label, color=INK)
    axes.grid(axis="x", color=FAINT, linewidth=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=INK)
