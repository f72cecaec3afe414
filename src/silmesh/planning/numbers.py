"""Lists of numbered objects, as a person writes them: ``1-10,17``."""

import re
from collections.abc import Iterable

from silmesh.errors import InputError, shorten


def parse_numbers(text: str, least: int, most: int) -> list[int]:
    """The numbers that a list names, in rising order and each once.

    Args:
        text: numbers and ranges of them, both ends included, as ``1-10,17``
        least, most: what there is

    Raises:
        InputError: it is written otherwise, or names a number that there is none of

    >>> parse_numbers("1-3,17", 1, 1000)
    [1, 2, 3, 17]
    """
    numbers: set[int] = set()
    for part in text.split(","):
        found = re.fullmatch(r"\s*(\d{1,9})\s*(?:-\s*(\d{1,9})\s*)?", part, re.ASCII)
        if not found:
            raise InputError(
                f"{shorten(text)}: should be numbers and ranges of them, as '1-10,17', "
                f"not {shorten(part)}"
            )
        first, last = int(found[1]), int(found[2] or found[1])
        if not least <= first <= last <= most:
            raise InputError(
                f"{shorten(text)}: {part.strip()} should rise within {least} to {most}"
            )
        numbers.update(range(first, last + 1))
    return sorted(numbers)


def write_numbers(numbers: Iterable[int]) -> str:
    """The shortest list that names numbers in rising order.

    >>> write_numbers([1, 2, 3, 17])
    '1-3,17'
    """
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1][1:] = [number]
        else:
            runs.append([number])
    return ",".join("-".join(map(str, run)) for run in runs)
