"""The table of published curves: its columns, and what is refused of it before any work.

Plans are checked by it, so it loads no pandas.
"""

import csv
import math
from collections.abc import Mapping
from pathlib import Path

from silmesh.errors import InputError, shorten

RUN, NUMBERS = ("object", "variant"), ("iteration", "loss")
COLUMNS = RUN + NUMBERS


def check_published(file: Path) -> None:
    """Refuse a table that lacks a column, or whose numbers are none.

    Raises:
        InputError: it does, or cannot be read
    """
    should = f"should be a table with the columns {','.join(COLUMNS)}"
    try:
        with open(file, encoding="utf-8-sig", newline="") as opened:
            rows = csv.DictReader(opened)
            header = rows.fieldnames or []
            if lacking := [column for column in COLUMNS if column not in header]:
                raise InputError(
                    f"{file}: lacks {', '.join(lacking)}; {should}. "
                    f"Found: {', '.join(header) or 'none'}"
                )
            for row in rows:
                _refuse_other_numbers(row, f"{file}, line {rows.line_num}")
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{file}: cannot be read: {why}; {should}") from error


def _refuse_other_numbers(row: Mapping[str, str], where: str) -> None:
    for column in NUMBERS:
        try:
            wrong = not math.isfinite(float(row[column]))
        except (TypeError, ValueError):
            wrong = True
        if wrong:
            raise InputError(f"{where}: {column}: should be a number, not {shorten(row[column])}")
