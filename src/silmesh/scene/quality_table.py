"""The table of a judged scene, ``quality.csv``: what was found of each view, what became of it."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from silmesh.scene.policy import WEIGHTS, Decision

TABLE = "quality.csv"  # in the scene's folder


def write_table(
    folder: Path,
    views: Sequence[str],
    decision: Decision,
    colours: Sequence[Mapping[str, float]],
) -> None:
    """Write a row for each view: its measures, ``doubt`` (why), ``fate``, ``weight``, ``added``
    and ``removed``.

    Args:
        colours: of each view, how far its photograph's colours agree with its silhouette
    """
    verdict = decision.verdict
    judged = zip(verdict.reasons, decision.fates, decision.changes, strict=True)
    ends = [
        {"doubt": why, "fate": fate, "weight": WEIGHTS[fate], "added": added, "removed": removed}
        for why, fate, (added, removed) in judged
    ]
    rows = [
        {"view": view, **row, **agreement, **end}
        for view, row, agreement, end in zip(views, verdict.rows, colours, ends, strict=True)
    ]
    with (folder / TABLE).open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows({name: _shorten(value) for name, value in row.items()} for row in rows)


def _shorten(value: Any) -> Any:
    """A number to four places, nothing for one that is not known."""
    if not isinstance(value, float):
        return value
    return "" if value != value else round(float(value), 4)


def read_table(folder: Path) -> list[dict[str, str]]:
    """The rows of a judged scene's table, all cells as they are written."""
    with (folder / TABLE).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))
