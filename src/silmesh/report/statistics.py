"""What can be concluded of two variants: paired differences, an interval, a test, who wins.

Fits of one object repeat one another and are no independent cases, so where there are several
objects each is one case: the median of its replicates' differences. Of a single object the
replicates are the cases, and what follows holds for that object alone.

median and its interval   percentile bootstrap with the percentiles widened for few cases
                          (Hesterberg 2015, section 5): of 2,000 simulated experiments with 6 to 30
                          normal, lognormal or t-distributed cases it covers 95.5 to 97.8 %
test                      Wilcoxon's signed rank, two-sided; several variants corrected by Holm 1979
profiles                  Dolan and Moré 2002
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

LEVEL = 0.05  # of significance; intervals hold 1 - LEVEL
# Cases: with fewer no two-sided signed-rank test reaches the level (2 / 2^5 = 0.06), and not even
# the least and the greatest enclose the median in 95 of 100 experiments.
FEWEST = 6
RESAMPLES, SEED = 10_000, 0

Case = tuple[str, int]  # object and replicate


@dataclass(frozen=True)
class Comparison:
    """A variant against a baseline; differences are variant minus baseline.

    Attributes:
        cases: how many independent ones there are
        by: what a case is: ``object`` or ``replicate``
        median: of the differences
        low, high: the interval of the median; None of fewer than six cases
        p: of the signed-rank test; None of fewer than six cases
        wins, ties, losses: of the cases, where lower is better
    """

    cases: int
    by: str
    median: float
    low: float | None
    high: float | None
    p: float | None
    wins: int
    ties: int
    losses: int


def compare(
    baseline: Mapping[Case, float], variant: Mapping[Case, float], tie: float = 0.0
) -> Comparison | None:
    """Compare two variants by what both measured; None if they have no case in common.

    Args:
        baseline, variant: a value of each object and replicate, lower is better; what is not finite
            is left out with its pair
        tie: difference up to which neither wins
    """
    both = [
        case
        for case in baseline
        if case in variant and np.isfinite([baseline[case], variant[case]]).all()
    ]
    if not both:
        return None
    by_object: dict[str, list[float]] = {}
    for case in both:
        by_object.setdefault(case[0], []).append(variant[case] - baseline[case])
    alone = len(by_object) == 1
    (first, *_) = by_object.values()
    differences = np.array(first if alone else [np.median(v) for v in by_object.values()])
    low, high = interval_of_median(differences)
    return Comparison(
        len(differences),
        "replicate" if alone else "object",
        float(np.median(differences)),
        low,
        high,
        signed_rank(differences),
        int((differences < -tie).sum()),
        int((np.abs(differences) <= tie).sum()),
        int((differences > tie).sum()),
    )


def interval_of_median(values: np.ndarray) -> tuple[float | None, float | None]:
    """The bootstrap's interval of the median; None of too few values, which cannot hold 95 %."""
    n = len(values)
    if n < FEWEST:
        return None, None
    chosen = np.random.default_rng(SEED).integers(0, n, (RESAMPLES, n))
    medians = np.median(np.asarray(values)[chosen], axis=1)
    share = stats.norm.cdf(np.sqrt(n / (n - 1)) * stats.t.ppf(LEVEL / 2, n - 1))
    low, high = np.quantile(medians, [share, 1 - share], method="inverted_cdf")
    return float(low), float(high)


def interval_of_mean(values: Sequence[float]) -> tuple[float, float]:
    """The mean and half the width of its interval by Student's t; infinite of one value."""
    n, mean = len(values), float(np.mean(values))
    if n < 2:
        return mean, float("inf")
    error = float(np.std(values, ddof=1)) / np.sqrt(n)
    return mean, float(stats.t.ppf(1 - LEVEL / 2, n - 1) * error)


def signed_rank(differences: np.ndarray) -> float | None:
    """The p of Wilcoxon's signed-rank test against 0, 1 if all are 0; None of too few."""
    if len(differences) < FEWEST:
        return None
    if not differences.any():
        return 1.0
    return float(stats.wilcoxon(differences, zero_method="pratt").pvalue)


def correct_by_holm(ps: Sequence[float | None]) -> list[float | None]:
    """The p of several tests such that any wrong rejection among them is rare; None stays None."""
    known = sorted((p, i) for i, p in enumerate(ps) if p is not None)
    corrected, least = list(ps), 0.0
    for rank, (p, i) in enumerate(known):
        least = max(least, min(1.0, (len(known) - rank) * p))
        corrected[i] = least
    return corrected


def profile(costs: np.ndarray, ratios: np.ndarray) -> np.ndarray:
    """Performance profiles: the share of objects on which each variant is near the best.

    Args:
        costs: [objects, variants], lower is better and all positive; not finite for a failure
        ratios: [n], over the best of each object
    Returns:
        [n, variants] shares
    """
    costs = np.where(np.isfinite(costs), costs, np.inf)
    best = costs.min(axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        over = np.where(np.isfinite(costs), costs / best, np.inf)
    return (over[None] <= np.asarray(ratios)[:, None, None]).mean(axis=1)


def first_at_most(losses: np.ndarray, goal: float) -> int | None:
    """The first step whose loss is at most a goal; None if there is none."""
    below = np.flatnonzero(np.asarray(losses) <= goal)
    return int(below[0]) if len(below) else None


def conclude(name: str, baseline: str, what: str, found: Comparison, p: float | None) -> str:
    """What can be concluded of a variant and its baseline, in one sentence.

    Args:
        what: is compared, lower is better, as ``final loss``
        p: corrected for how many variants were compared
    """
    cases = f"{found.cases} {found.by}{'s' * (found.cases != 1)}"
    said = f"{name} against {baseline}, {what}: median difference {found.median:+.4g}"
    if found.low is not None:
        said += f" (95 % interval {found.low:+.4g} to {found.high:+.4g})"
    said += f" over {cases}; {found.wins} better, {found.ties} alike, {found.losses} worse"
    if p is None:
        return f"{said}. Nothing can be concluded: a test needs {FEWEST} {found.by}s or more."
    if p > LEVEL:
        return f"{said}. A difference is not shown (p = {p:.2g})."
    better = "lower" if found.median < 0 else "higher"
    alone = " on this object" * (found.by == "replicate")
    return f"{said}. It is {better}{alone} (p = {p:.2g})."
