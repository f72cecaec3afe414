"""The runs' results in two tables: every iteration of every fit, and a row of metrics a run."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from silmesh.errors import reading
from silmesh.report.published import NUMBERS, RUN, check_published

Run = tuple[str, str]  # object and variant


def read_losses(files: Mapping[Run, Path]) -> dict[Run, pd.DataFrame]:
    """The ``loss.csv`` of each run, its numbers as they are written there."""
    return {run: pd.read_csv(file, dtype=str) for run, file in files.items()}


def read_metrics(files: Mapping[Run, Path]) -> dict[Run, dict[str, Any]]:
    """The ``metrics.json`` of each run."""
    return {run: json.loads(file.read_text(encoding="utf-8")) for run, file in files.items()}


def read_published(file: Path) -> dict[Run, pd.DataFrame]:
    """Published curves: ``iteration`` and ``loss`` of each object and variant of a table.

    Raises:
        InputError: as ``check_published``
    """
    check_published(file)
    with reading(file, "a table"):
        table = pd.read_csv(file, dtype=dict.fromkeys(RUN, str))
        for column in NUMBERS:
            table[column] = pd.to_numeric(table[column])
    curves = table.groupby(list(RUN), sort=False)
    return {run: rows[list(NUMBERS)].reset_index(drop=True) for run, rows in curves}


def gather_losses(losses: Mapping[Run, pd.DataFrame]) -> pd.DataFrame:
    """All losses below one another: ``object,variant`` and the columns of ``loss.csv``."""
    parts = []
    for (object_, variant), loss in losses.items():
        named = loss.copy()
        named.insert(0, "object", object_)
        named.insert(1, "variant", variant)
        parts.append(named)
    return pd.concat(parts, ignore_index=True)


def gather_metrics(metrics: Mapping[Run, Mapping[str, Any]]) -> pd.DataFrame:
    """A row of metrics a run, the metrics as columns in the order in which they first come.

    What has a value for each view is left out. A metric that a run lacks is None there; whole
    numbers stay whole.
    """
    columns = dict.fromkeys(key for values in metrics.values() for key in flat(values))
    rows = [
        {"object": object_, "variant": variant} | {key: values.get(key) for key in columns}
        for (object_, variant), values in metrics.items()
    ]
    return pd.DataFrame(rows, columns=["object", "variant", *columns], dtype=object)


def flat(values: Mapping[str, Any]) -> dict[str, Any]:
    """Metrics without those that are themselves a table or a list."""
    return {key: value for key, value in values.items() if not isinstance(value, dict | list)}


def objects_of(runs: Iterable[Run]) -> dict[str, list[str]]:
    """The variants of each object, both in the order in which they come."""
    variants: dict[str, list[str]] = {}
    for object_, variant in runs:
        variants.setdefault(object_, []).append(variant)
    return variants
