"""Loss curves as the page shows them: fewer points where they lie close, and a table to read."""

from typing import Any

import numpy as np
import pandas as pd

POINTS = 120  # evenly along the iterations, and again along their logarithm
DIGITS = 5
COLUMNS = 7  # columns of the table of losses


def thin(length: int) -> np.ndarray:
    """Which of so many rows are kept: all if they are few, the first and the last in any case."""
    if length <= 2 * POINTS:
        return np.arange(length)
    even = np.linspace(0, length - 1, POINTS)
    early = np.geomspace(1, length, POINTS) - 1
    return np.unique(np.concatenate([even, early]).round().astype(int))


def describe_curve(table: pd.DataFrame) -> dict[str, list[Any]]:
    """``iteration`` and ``loss`` of a thinned curve, of five digits."""
    kept = table.iloc[thin(len(table))]
    losses = [float(f"{loss:.{DIGITS}g}") for loss in kept["loss"]]
    return {"iteration": kept["iteration"].tolist(), "loss": losses}


def table_of(curves: dict[str, pd.DataFrame]) -> tuple[list[int], dict[str, list[str]]]:
    """Losses at a few round iterations and the last: the iterations, and a row a curve."""
    last = max(int(curve["iteration"].iloc[-1]) for curve in curves.values())
    step = max(last / (COLUMNS - 1), 1)
    unit = 10 ** int(np.log10(step))
    step = next(unit * k for k in (1, 2, 2.5, 5, 10) if unit * k >= step)
    at = [int(step * i) for i in range(COLUMNS) if step * i < last] + [last]
    rows = {}
    for name, curve in curves.items():
        losses = dict(zip(curve["iteration"], curve["loss"], strict=True))
        rows[name] = [f"{losses[i]:.4f}" if i in losses else "" for i in at]
    return at, rows
