"""The figure of an object: every variant's loss against the iteration, and the meshes beside it.

Published losses are dots in their variant's colour.

Colours are those of Okabe and Ito, told apart under every common colour blindness; beyond seven
variants the dashes change. A variant has the same style in the figures of all objects.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from types import MappingProxyType
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, SubFigure
from matplotlib.text import Text
from PIL import Image

from silmesh.files import replacing
from silmesh.report.statistics import interval_of_mean

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#333333")
DASHES = ("-", (0, (5, 2)), (0, (6, 2, 1.5, 2)))
INK, FAINT = "#24292f", "#d8dbde"
STYLE = {
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "silmesh",  # the same ids, and so the same bytes, each time
    "font.family": "sans-serif",
    "font.size": 10,
}
WIDTH, HEIGHT, CELL, GAP = 8.4, 4.1, 1.72, 0.15  # inches: of the curves, and of a picture
TOP = 0.87  # of the height: where the pictures begin
LETTERS = 22  # in a line above a picture
DOTS = {"linestyle": "none", "marker": "o", "ms": 3.6, "mfc": "none", "mew": 1.1}
EDGE = 0.01  # of the curves' width, that is left free on either side
LABEL = 1.105  # of the axes' width: where the labels begin
BAND = 0.2  # opacity of the interval of a mean curve
LABEL_HEIGHT = 0.058  # of the axes: labels stand at least so far apart


def style_of(variant: str, order: Sequence[str]) -> dict[str, Any]:
    """How a variant's line is drawn, by its place among all variants of the run.

    Args:
        order: all variants of the configuration
    """
    place = list(order).index(variant)
    return {
        "color": COLOURS[place % len(COLOURS)],
        "linestyle": DASHES[place // len(COLOURS) % len(DASHES)],
    }


def draw_figure(
    object_: str,
    losses: Mapping[str, Sequence[pd.DataFrame]],
    order: Sequence[str],
    columns: Sequence[Sequence[Image.Image]],
    published: Mapping[str, pd.DataFrame] = MappingProxyType({}),
) -> Figure:
    """Draw an object's losses, a line a variant, each labelled at its end; right, the meshes.

    The line of replicates is their mean, in a band of its 95 % interval.

    Args:
        object_: the title
        losses: of each variant the ``loss.csv`` of its replicates
        order: all variants of the configuration, which decide the styles
        columns: two views of the photographs, then of each variant's mesh, square pictures
        published: ``iteration`` and ``loss`` of the variants that repeat a published curve
    """
    with mpl.rc_context(STYLE):
        beside = CELL * len(columns) + GAP
        figure = Figure(figsize=(WIDTH + beside, HEIGHT))
        FigureCanvasAgg(figure)
        curves, pictures = figure.subfigures(1, 2, width_ratios=(WIDTH, beside))
        draw_losses(curves, object_, losses, order, published)
        _draw_columns(pictures, ["photographs", *losses], columns)
    return figure


def draw_losses(
    figure: Figure | SubFigure,
    object_: str,
    losses: Mapping[str, Sequence[pd.DataFrame]],
    order: Sequence[str],
    published: Mapping[str, pd.DataFrame],
) -> None:
    """Draw the losses in a figure; see ``draw_figure``."""
    axes = figure.add_axes((0.1, 0.13, 0.8, 0.77))  # moved below
    ends = {}
    for variant, replicates in losses.items():
        style = style_of(variant, order)
        loss, half = average(replicates)
        axes.plot(loss["iteration"], loss["loss"], linewidth=1.6, **style)
        if half is not None:
            low, high = loss["loss"] - half, loss["loss"] + half
            axes.fill_between(loss["iteration"], low, high, color=style["color"], alpha=BAND, lw=0)
        ends[f"{variant}  {loss['loss'].iloc[-1]:.4f}"] = (loss.iloc[-1], style)
        if variant in published:
            curve = published[variant]
            curve = curve[curve["iteration"] <= loss["iteration"].iloc[-1]]
            axes.plot(curve["iteration"], curve["loss"], **DOTS, color=style["color"])
    _name_axes(axes, object_)
    if published:
        axes.plot([], [], label="published in the report", **DOTS, color=INK)
        axes.legend(loc="upper right", frameon=False, labelcolor=INK)
    _label_ends(axes, ends)


def average(replicates: Sequence[pd.DataFrame]) -> tuple[pd.DataFrame, np.ndarray | None]:
    """The mean loss of replicates and half the width of its 95 % interval; None of a single one.

    A fit that ended keeps its last loss until the longest one ends.
    """
    longest = max(replicates, key=len)
    if len(replicates) == 1:
        return longest, None
    curves = np.stack(
        [
            np.pad(r["loss"].to_numpy(float), (0, len(longest) - len(r)), mode="edge")
            for r in replicates
        ]
    )
    mean = longest.assign(loss=curves.mean(axis=0))
    return mean, np.array([interval_of_mean(column)[1] for column in curves.T])


def _draw_columns(
    figure: SubFigure, titles: Sequence[str], columns: Sequence[Sequence[Image.Image]]
) -> None:
    """Draw pictures in columns, each below its title, which is broken where it is too wide."""
    wide, high = 1 / len(columns), CELL / HEIGHT
    for j, (title, pictures) in enumerate(zip(titles, columns, strict=True)):
        for i, picture in enumerate(pictures):
            place = (j * wide, TOP - (i + 1) * high, 0.97 * wide, 0.97 * high)
            axes = figure.add_axes(place)
            axes.imshow(picture, interpolation="lanczos", aspect="equal")
            axes.set_axis_off()
        figure.text(
            (j + 0.485) * wide, TOP + 0.02, break_name(title), ha="center", va="bottom", color=INK,
            fontsize=9, parse_math=False,
        )  # fmt: skip


def break_name(title: str) -> str:
    """A name in lines that fit over a picture, broken behind ``_`` and ``-`` where it can be."""
    pieces = re.sub(r"(?<=[_-])(?=.)", " ", title).split()
    lines = [""]
    for piece in pieces:
        if lines[-1] and len(lines[-1]) + len(piece) > LETTERS:
            lines.append("")
        lines[-1] += piece
    return "\n".join(part for line in lines for part in wrap(line, LETTERS))


def _name_axes(axes: Axes, object_: str) -> None:
    axes.set_title(object_, loc="left", fontweight="bold", color=INK, parse_math=False)
    axes.set_xlabel("iteration", color=INK)
    axes.set_ylabel("loss (IoU loss and weighted smoothness)", color=INK)
    axes.set_ylim(0, 1.05 * axes.dataLim.y1)
    axes.set_xlim(0, axes.dataLim.x1 + 1)  # as many as there are: the last of 1,000 is 999
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.grid(axis="y", color=FAINT, linewidth=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=INK)


def _label_ends(axes: Axes, ends: Mapping[str, tuple[pd.Series, dict[str, Any]]]) -> None:
    """Mark where each line ends, and name it at that height to the right of the axes."""
    wanted = [axes.transLimits.transform((0, end["loss"]))[1] for end, _ in ends.values()]
    beside = {"transform": axes.transAxes, "clip_on": False}
    labels = []
    for (label, (end, style)), height in zip(
        ends.items(), spread(wanted, LABEL_HEIGHT), strict=True
    ):
        axes.plot(end["iteration"], end["loss"], "o", color=style["color"], ms=4, clip_on=False)
        axes.plot((1.03, 1.09), (height, height), linewidth=1.6, **style, **beside)
        labels.append(
            axes.text(LABEL, height, label, va="center", color=INK, parse_math=False, **beside)
        )
    _make_room(axes, labels)


def _make_room(axes: Axes, labels: Sequence[Text]) -> None:
    """Move and narrow the axes until what is written on either side ends at the figure's edge."""
    whole = axes.figure.bbox.width
    before = (axes.bbox.x0 - axes.yaxis.get_tightbbox().x0) / whole
    longest = max(label.get_window_extent().width for label in labels) / whole
    box = axes.get_position()
    left = before + EDGE
    width = max((1 - left - 2 * EDGE - longest) / LABEL, 0.3)
    axes.set_position((left, box.y0, width, box.height))


def spread(wanted: Sequence[float], apart: float) -> np.ndarray:
    """Heights near the wanted ones, in the same order, at least ``apart`` from one another.

    They move as little as least squares allows: labels that touch form a group about its mean.
    They stay between 0 and 1, unless there are too many for that.
    """
    order = np.argsort(wanted, kind="stable")
    groups: list[tuple[float, int]] = []  # mean of wanted height less place in the group, count
    for i, k in enumerate(order):
        mean, count = wanted[k] - i * apart, 1
        while groups and groups[-1][0] >= mean:
            before, n = groups.pop()
            mean, count = (before * n + mean * count) / (n + count), n + count
        groups.append((mean, count))
    shifted = np.concatenate([np.full(count, mean) for mean, count in groups])
    shifted = np.maximum(np.minimum(shifted, 1 - (len(shifted) - 1) * apart), 0)
    heights = np.empty(len(shifted))
    heights[order] = shifted + apart * np.arange(len(shifted))
    return heights


def write_figure(path: Path, figure: Figure) -> None:
    """Write a figure as its ending names, the same bytes each time."""
    date = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix, {})
    with replacing(path) as part, mpl.rc_context(STYLE):
        figure.savefig(part, dpi=160, metadata=date)
