"""Conclusions from made-up fits whose answer is known."""

import numpy as np
import pandas as pd
import pytest

from silmesh.report.conclusions import Fit, draw_conclusions, to_latex

GOOD = {"iou_mean": 0.9, "init_iou_mean": 0.4, "watertight": True, "faces": 1000}


def fit(object_, experiment, end, replicate=1, steps=11, **metrics):
    """A loss that falls by even steps from 1 to ``end``, a second a step."""
    loss = np.linspace(1, end, steps)
    return Fit(object_, experiment, replicate, loss, np.arange(steps) * 1.0, GOOD | metrics)


@pytest.fixture
def table():
    """Of eight objects ``placed`` always ends lower by 0.1; ``same`` as the baseline does."""
    ends = {"plain": 0.3, "placed": 0.2, "same": 0.3}
    fits = [
        fit(f"o{i}", name, end + 0.01 * i, replicate)
        for i in range(8)
        for name, end in ends.items()
        for replicate in (1, 2)
    ]
    return draw_conclusions(fits, list(ends), "plain")


def row(table, variant, measure):
    (found,) = table[(table["variant"] == variant) & (table["measure"] == measure)].to_dict(
        "records"
    )
    return found


def test_what_is_lower_everywhere_is_concluded_to_be(table):
    found = row(table, "placed", "loss")
    assert found["difference"] == pytest.approx(-0.1)
    assert (found["low"], found["high"]) == (pytest.approx(-0.1), pytest.approx(-0.1))
    assert (found["cases"], found["by"], found["wins"], found["losses"]) == (8, "object", 8, 0)
    assert found["p"] == pytest.approx(2 / 2**8)
    assert found["p_holm"] == pytest.approx(2 * 2 / 2**8)  # two variants
    assert "It is lower" in found["conclusion"]


def test_what_is_equal_is_not_concluded_to_differ(table):
    found = row(table, "same", "loss")
    assert (found["difference"], found["ties"], found["p_holm"]) == (0, 8, 1)
    assert "A difference is not shown" in found["conclusion"]


def test_the_goal_is_the_baselines_end_or_a_given_one():
    fits = [fit("o", "plain", 0.5), fit("o", "fast", 0.0), fit("o", "slow", 0.8)]
    by = draw_conclusions(fits, ["plain", "fast", "slow"], "plain")
    # The goal is 0.505. plain, 1 - 0.05 i, is there at 10; fast, 1 - 0.1 i, at 5; slow never.
    assert row(by, "fast", "steps")["median_variant"] == 5
    assert row(by, "fast", "seconds")["difference"] == -5
    assert row(by, "slow", "steps")["median_variant"] == 10
    given = draw_conclusions(fits, ["plain", "fast", "slow"], "plain", goal=0.91)
    assert row(given, "fast", "steps")["median_variant"] == 1


def test_a_fit_that_ended_keeps_its_loss():
    fits = [fit("o", "long", 0.0, steps=11), fit("o", "short", 0.5, steps=6)]
    found = row(draw_conclusions(fits, ["long", "short"], "long"), "short", "area")
    assert found["median_baseline"] == pytest.approx(0.5)
    assert found["median_variant"] == pytest.approx((6 * 0.75 + 5 * 0.5) / 11)


@pytest.mark.parametrize(
    ("metrics", "kind"),
    [
        ({}, None),
        ({"watertight": False}, "torn"),
        ({"self_intersections": 11}, "torn"),
        ({"self_intersections": 9}, None),
        ({"iou_mean": 0.45}, "collapsed"),
        ({"init_iou_mean": 0.92}, "collapsed"),
    ],
)
def test_failures(metrics, kind):
    assert fit("o", "a", 0.2, **metrics).failure == kind


def test_failures_are_counted():
    fits = [fit("o", "a", 0.2), fit("o", "b", 0.2, 1, iou_mean=0.1), fit("o", "b", 0.2, 2)]
    found = row(draw_conclusions(fits, ["a", "b"], "a"), "b", "loss")
    assert (found["failures_baseline"], found["failures_variant"]) == ("0/1", "1/2 (collapsed)")


def test_a_truth_is_compared_where_there_is_one(table):
    assert set(table["measure"]) == {"loss", "iou", "start", "steps", "seconds", "area"}
    fits = [fit("o", n, 0.2, volume_iou=v, chamfer=0.1) for n, v in (("a", 0.7), ("b", 0.8))]
    found = row(draw_conclusions(fits, ["a", "b"], "a"), "b", "volume")
    assert found["difference"] == pytest.approx(-0.1)


def test_one_experiment_has_nothing_to_be_compared_with():
    assert draw_conclusions([fit("o", "a", 0.2)], ["a"], "a").empty


def test_the_table_for_latex(table):
    lines = to_latex(table).splitlines()
    assert lines[1] == r"\begin{tabular}{llrrrr}"
    assert lines[-1] == r"\end{tabular}"
    assert r"placed & final loss & -0.1 & [-0.1, -0.1] & 0.016 & 8/0/0 \\" in lines
    assert pd.notna(table["conclusion"]).all()
