"""What a job needs of a machine: threads, memory, time and GPUs, from a table with a row a step.

What a job is asked for grows in a straight line with its photographs, in megapixels of its working
images, and doubles each time that it is tried again: one that was ended for taking more has room
the next time.

    need = (base + slope * megapixels) * 2 ** (attempt - 1)
"""

import csv
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

from silmesh.errors import InputError

MOST_MINUTES = 24 * 60  # that a job is ever asked for: queues refuse more


@dataclass(frozen=True)
class Needs:
    """Of a step.

    Attributes:
        threads: where a job has a machine's cores to itself, as on a cluster
        memory, minutes: MB, and by the clock, of an object without photographs
        memory_slope, minutes_slope: what each megapixel of its working images adds
        gpus: that it can make use of
    """

    threads: int
    memory: int
    memory_slope: int
    minutes: int
    minutes_slope: float
    gpus: int

    def memory_of(self, megapixels: float, attempt: int = 1) -> int:
        """MB of a job."""
        return round((self.memory + self.memory_slope * megapixels) * 2 ** (attempt - 1))

    def minutes_of(self, megapixels: float, attempt: int = 1) -> int:
        """Minutes of a job."""
        minutes = (self.minutes + self.minutes_slope * megapixels) * 2 ** (attempt - 1)
        return min(round(minutes), MOST_MINUTES)


def read_needs(table: Path) -> Mapping[str, Needs]:
    """The rows of a table, separated by tabs, by their steps; lines that begin with # say why.

    Raises:
        InputError: a column is missing, or a cell is no number; with the line
    """
    lines = [line for line in table.read_text(encoding="utf-8").splitlines() if line[:1] != "#"]
    rows = csv.DictReader(lines, delimiter="\t")
    return {row["step"]: _read_row(row, table) for row in rows}


def _read_row(row: Mapping[str, str], table: Path) -> Needs:
    values = {}
    for field in fields(Needs):
        try:
            values[field.name] = field.type(row[field.name])
        except (KeyError, TypeError, ValueError) as error:
            found = row.get(field.name)
            raise InputError(
                f"{table}: {row['step']}: {field.name}: {found!r}; should be a number"
            ) from error
    return Needs(**values)
