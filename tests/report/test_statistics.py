"""Statistics of comparisons against hand-computed values, scipy's own, and simulation."""

import numpy as np
import pytest
from scipy import stats

from silmesh.report.statistics import (
    compare,
    conclude,
    correct_by_holm,
    first_at_most,
    interval_of_mean,
    interval_of_median,
    profile,
    signed_rank,
)


def cases(values, name="o"):
    """One replicate each of several objects."""
    return {(f"{name}{i}", 0): value for i, value in enumerate(values)}


def test_objects_are_cases_and_replicates_are_averaged_within_them():
    baseline = {("cup", r): 0.2 for r in range(3)} | {("jug", r): 0.4 for r in range(3)}
    variant = {("cup", r): 0.2 - d for r, d in enumerate((0.1, 0.02, 0.01))}
    variant |= {("jug", r): 0.4 + d for r, d in enumerate((0.0, 0.04, 0.3))}
    found = compare(baseline, variant)
    assert (found.cases, found.by) == (2, "object")
    assert found.median == pytest.approx((-0.02 + 0.04) / 2)
    assert (found.wins, found.ties, found.losses) == (1, 0, 1)
    assert found.p is None


def test_replicates_are_cases_of_a_single_object():
    baseline = {("cup", r): 0.5 for r in range(6)}
    found = compare(baseline, {("cup", r): 0.4 + r / 1000 for r in range(6)})
    assert (found.cases, found.by, found.wins) == (6, "replicate", 6)
    assert found.p == pytest.approx(2 / 2**6)  # all six signs alike


def test_pairs_that_failed_or_lack_one_are_left_out():
    baseline, variant = cases([0.1, 0.2, np.nan, 0.3]), cases([0.2, 0.2, 0.1])
    found = compare(baseline, variant)
    assert (found.cases, found.losses, found.ties) == (2, 1, 1)
    assert compare(cases([np.inf]), cases([0.1])) is None
    assert compare(cases([0.1]), cases([0.1], "p")) is None


def test_small_differences_are_ties():
    found = compare(cases([0.1, 0.2, 0.3]), cases([0.1005, 0.19, 0.2999]), tie=0.001)
    assert (found.wins, found.ties, found.losses) == (1, 2, 0)


@pytest.mark.parametrize("n", [6, 14, 30])
def test_the_test_is_scipys(n):
    values = np.random.default_rng(n).normal(0.4, 1, n)
    assert signed_rank(values) == pytest.approx(stats.wilcoxon(values).pvalue)


def test_too_few_cases_are_not_tested_and_equal_ones_differ_in_nothing():
    assert signed_rank(np.full(5, 1.0)) is None
    assert signed_rank(np.zeros(7)) == 1


def test_holms_correction_of_the_textbook():
    # Sorted 0.005, 0.01, 0.03, 0.04 times 4, 3, 2, 1 is 0.02, 0.03, 0.06, 0.04, kept rising.
    corrected = correct_by_holm([0.01, 0.04, None, 0.03, 0.005])
    assert corrected == [pytest.approx(0.03), pytest.approx(0.06), None, pytest.approx(0.06), 0.02]
    assert correct_by_holm([0.6, 0.7]) == [1, 1]


@pytest.mark.parametrize("n", [9, 14, 30])
@pytest.mark.parametrize("skewed", [False, True])
def test_the_medians_interval_covers_it_in_95_of_100_experiments(n, skewed, monkeypatch):
    monkeypatch.setattr("silmesh.report.statistics.RESAMPLES", 500)
    random = np.random.default_rng(n + skewed)
    draw, true = (random.lognormal, 1.0) if skewed else (random.normal, 0.0)
    ends = np.array([interval_of_median(draw(0, 1, n)) for _ in range(1000)])
    covered = ((ends[:, 0] <= true) & (true <= ends[:, 1])).mean()
    assert 0.93 <= covered <= 0.975


def test_the_means_interval_is_students():
    values = [1.0, 2.0, 4.0, 7.0]
    mean, half = interval_of_mean(values)
    low, high = stats.ttest_1samp(values, 0).confidence_interval()
    assert (mean - half, mean + half) == (pytest.approx(low), pytest.approx(high))
    assert interval_of_mean([3.0]) == (3.0, np.inf)


def test_profiles_by_hand():
    costs = np.array([[1.0, 2.0], [4.0, 2.0], [3.0, np.nan]])
    expected = [[2 / 3, 1 / 3], [1, 2 / 3]]
    np.testing.assert_allclose(profile(costs, [1, 2]), expected)


def test_the_first_step_at_a_goal():
    assert first_at_most(np.array([0.9, 0.5, 0.6, 0.3]), 0.5) == 1
    assert first_at_most(np.array([0.9, np.nan]), 0.5) is None


def test_sentences_say_what_is_shown_and_what_is_not():
    lower = compare(cases(np.linspace(0.2, 0.4, 8)), cases(np.linspace(0.1, 0.3, 8)))
    said = conclude("placed", "sphere", "final loss", lower, 0.01)
    assert said.startswith("placed against sphere, final loss: median difference -0.1 (95 %")
    assert said.endswith("over 8 objects; 8 better, 0 alike, 0 worse. It is lower (p = 0.01).")
    assert "is not shown (p = 0.2)" in conclude("a", "b", "loss", lower, 0.2)
    few = compare(cases([0.1, 0.2]), cases([0.2, 0.3]))
    said = conclude("a", "b", "loss", few, few.p)
    assert "a test needs 6 objects or more" in said
    assert "interval" not in said  # two cases cannot hold 95 %
