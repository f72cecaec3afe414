"""Curves for the page: which points are kept, and the table's iterations."""

import numpy as np
import pandas as pd
import pytest

from silmesh.report.curves import POINTS, describe_curve, table_of, thin


@pytest.mark.parametrize("length", [1, 2, 240, 241, 2000])
def test_the_ends_are_kept_and_long_curves_get_short(length):
    kept = thin(length)
    assert (kept[0], kept[-1]) == (0, length - 1)
    assert (np.diff(kept) > 0).all()
    assert len(kept) <= min(length, 2 * POINTS)


def test_early_steps_are_closer_together():
    kept = thin(2000)
    assert (np.diff(kept[:5]) == 1).all()
    assert np.diff(kept).max() <= 2000 / (POINTS - 1) + 1


def test_a_curve_of_five_digits():
    table = pd.DataFrame({"iteration": [0, 1], "loss": [0.123456789, 2e-7]})
    assert describe_curve(table) == {"iteration": [0, 1], "loss": [0.12346, 2e-7]}


@pytest.mark.parametrize(
    ("last", "expected"),
    [
        (199, [0, 50, 100, 150, 199]),
        (1999, [0, 500, 1000, 1500, 1999]),
        (4, [0, 1, 2, 3, 4]),
        (0, [0]),
    ],
)
def test_the_table_has_round_iterations_and_the_last(last, expected):
    curve = pd.DataFrame({"iteration": range(last + 1), "loss": 0.5})
    short = curve.iloc[:1]
    at, rows = table_of({"long": curve, "short": short})
    assert at == expected
    assert rows["long"] == ["0.5000"] * len(expected)
    assert rows["short"] == ["0.5000"] + [""] * (len(expected) - 1)
