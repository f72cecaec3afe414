"""Variants against a baseline: what each fit is measured by, and what can be concluded.

Every measure is a number that is better when lower:

loss         the final loss
iou          1 - the final mean IoU
start        1 - the mean IoU of the initial mesh
steps        until the loss is within 1 % of the baseline's final one, or at a given goal; all of
             the fit's where it is never reached
seconds      the same in time
area         the mean loss over all steps of the longest fit; a fit that ended keeps its last loss
volume       1 - the volume IoU with the truth, where there is one
chamfer      the distance to it

A fit has failed that is *torn* (not closed, or more than one pair of intersecting triangles for
each hundred triangles), *collapsed* (final IoU below 0.5, or by 0.01 below that of its initial
mesh), or whose loss is not a finite number.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd

from silmesh.report.statistics import (
    Case,
    Comparison,
    compare,
    conclude,
    correct_by_holm,
    first_at_most,
)

NEAR = 0.01  # share of the baseline's final loss within which it counts as reached
TORN = 0.01  # intersecting pairs over faces
COLLAPSED, WORSE = 0.5, 0.01  # final IoU, and how far below the initial mesh's
TIE = 1e-3  # of a measure whose differences are losses or IoUs
MEASURES = {
    "loss": "final loss",
    "iou": "1 - IoU",
    "start": "1 - IoU of the initial mesh",
    "steps": "steps to the goal",
    "seconds": "seconds to the goal",
    "area": "mean loss over the fit",
    "volume": "1 - volume IoU",
    "chamfer": "chamfer distance",
}
TIES = dict.fromkeys(("loss", "iou", "start", "area", "volume"), TIE)


@dataclass(frozen=True)
class Fit:
    """A fit of an object by an experiment.

    Attributes:
        loss, seconds: [steps] before each
        metrics: as ``metrics.json`` has them
    """

    object: str
    experiment: str
    replicate: int
    loss: np.ndarray
    seconds: np.ndarray
    metrics: Mapping[str, Any]

    @property
    def case(self) -> Case:
        """The object and the replicate."""
        return self.object, self.replicate

    @property
    def failure(self) -> str | None:
        """How it failed, if it did."""
        metrics = self.metrics
        if not np.isfinite(self.loss).all():
            return "not finite"
        crossings = metrics.get("self_intersections") or 0
        if not metrics.get("watertight", True) or crossings > TORN * metrics.get("faces", 1):
            return "torn"
        end, start = metrics["iou_mean"], metrics.get("init_iou_mean")
        if end < COLLAPSED or (start is not None and end < start - WORSE):
            return "collapsed"
        return None

    def measure(self, goal: float, steps: int) -> dict[str, float]:
        """What it is measured by; NaN where it says nothing.

        Args:
            goal: the loss that is to be reached
            steps: of the longest fit of this object
        """
        reached = first_at_most(self.loss, goal)
        at = len(self.loss) - 1 if reached is None else reached
        area = self.loss.sum() + (steps - len(self.loss)) * self.loss[-1]
        found = {key: self.metrics.get(key) for key in ("init_iou_mean", "volume_iou", "chamfer")}
        start, volume, chamfer = (np.nan if v is None else v for v in found.values())
        return {
            "loss": float(self.loss[-1]),
            "iou": 1 - self.metrics["iou_mean"],
            "start": 1 - start,
            "steps": float(at),
            "seconds": float(self.seconds[at]),
            "area": float(area / steps),
            "volume": 1 - volume,
            "chamfer": chamfer,
        }


def draw_conclusions(
    fits: Iterable[Fit], order: Sequence[str], baseline: str, goal: float | None = None
) -> pd.DataFrame:
    """Compare every experiment with the baseline by every measure.

    Args:
        order: of the experiments
        baseline: one of them
        goal: loss that is to be reached; the baseline's final one of each object, within 1 %, if
            not given
    Returns:
        a row a measure and experiment: what is compared, medians, the difference and its interval,
        the test's p and the one corrected over the experiments, who wins, failures, the conclusion
    """
    fits = list(fits)
    measured = _measure_all(fits, baseline, goal)
    failures = {name: [f.failure for f in fits if f.experiment == name] for name in order}
    rows = []
    for measure, label in MEASURES.items():
        values = {name: _values_of(measured, fits, name, measure) for name in order}
        found = {
            name: compare(values[baseline], values[name], TIES.get(measure, 0.0))
            for name in order
            if name != baseline
        }
        found = {name: comparison for name, comparison in found.items() if comparison}
        corrected = correct_by_holm([comparison.p for comparison in found.values()])
        for (name, comparison), p in zip(found.items(), corrected, strict=True):
            rows.append(
                {
                    "baseline": baseline,
                    "variant": name,
                    "measure": measure,
                    "median_baseline": _median(values[baseline]),
                    "median_variant": _median(values[name]),
                    **_describe(comparison, p),
                    "failures_baseline": _count(failures[baseline]),
                    "failures_variant": _count(failures[name]),
                    "conclusion": conclude(name, baseline, label, comparison, p),
                }
            )
    return pd.DataFrame(rows, columns=COLUMNS)


COLUMNS = (
    "baseline", "variant", "measure", "median_baseline", "median_variant", "cases", "by",
    "difference", "low", "high", "p", "p_holm", "wins", "ties", "losses", "failures_baseline",
    "failures_variant", "conclusion",
)  # fmt: skip


def _measure_all(fits: Sequence[Fit], baseline: str, goal: float | None) -> list[dict[str, float]]:
    """The measures of each fit."""
    ends: dict[str, list[float]] = {}
    longest: dict[str, int] = {}
    for fit in fits:
        longest[fit.object] = max(longest.get(fit.object, 0), len(fit.loss))
        if fit.experiment == baseline:
            ends.setdefault(fit.object, []).append(float(fit.loss[-1]))
    goals = {name: goal or (1 + NEAR) * float(np.median(values)) for name, values in ends.items()}
    return [
        fit.measure(goals.get(fit.object, goal or -np.inf), longest[fit.object]) for fit in fits
    ]


def _values_of(
    measured: Sequence[Mapping[str, float]], fits: Sequence[Fit], name: str, measure: str
) -> dict[Case, float]:
    """A measure of an experiment's fits by their cases."""
    pairs = zip(fits, measured, strict=True)
    return {fit.case: values[measure] for fit, values in pairs if fit.experiment == name}


def _median(values: Mapping[Case, float]) -> float:
    return float(np.nanmedian([*values.values()]))


def _describe(found: Comparison, p: float | None) -> dict[str, Any]:
    said = asdict(found)
    return {**said, "difference": said.pop("median"), "p_holm": p}


def _count(failures: Sequence[str | None]) -> str:
    """How many failed of how many, and how, as ``2/5 (torn)``."""
    kinds = sorted({kind for kind in failures if kind})
    how = f" ({', '.join(kinds)})" if kinds else ""
    return f"{sum(map(bool, failures))}/{len(failures)}{how}"


def to_latex(table: pd.DataFrame, measures: Sequence[str] = ("loss", "iou", "steps")) -> str:
    """The comparison as a table for LaTeX's booktabs: difference, interval, p, wins, a row each."""
    lines = [
        r"% \usepackage{booktabs}",
        r"\begin{tabular}{llrrrr}",
        r"\toprule",
        r"variant & measure & difference & 95\,\% interval & $p$ & better/alike/worse \\",
        r"\midrule",
    ]
    for row in table[table["measure"].isin(measures)].to_dict("records"):
        interval = "--" if pd.isna(row["low"]) else f"[{row['low']:.4g}, {row['high']:.4g}]"
        p = "--" if pd.isna(row["p_holm"]) else f"{row['p_holm']:.2g}"
        name = str(row["variant"]).replace("_", r"\_")
        wins = f"{row['wins']}/{row['ties']}/{row['losses']}"
        cells = (name, MEASURES[row["measure"]], f"{row['difference']:.4g}", interval, p, wins)
        lines.append(" & ".join(cells) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])
