"""Photographs as an archive of many objects leaves them: whether those of an object are all there.

Archives that were unpacked in part lack views, or end within one. All that are read here are PNGs,
which say at their beginning how large they are, and at their end that this is it; so a thousand
objects are looked through without decoding any.
"""

import os
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from silmesh.errors import InputError, name_some
from silmesh.naming import natural_key
from silmesh.planning.numbers import write_numbers

SIGNATURE, LAST = b"\x89PNG\r\n\x1a\n", b"IEND"  # how a PNG begins, and the name of its last chunk
NAMED = 4  # views that a line names

Row = dict[str, str]  # of the table: its cells by their columns


@dataclass
class Collection:
    """What a table can be made of, and what not.

    Attributes:
        rows: of the table, an object or several each
        size: of the working images that suits the photographs, in pixels
        said: lines about all
        lacking: of each object that is left out, why
    """

    rows: list[Row] = field(default_factory=list)
    size: int = 256
    said: list[str] = field(default_factory=list)
    lacking: dict[str, str] = field(default_factory=dict)

    def tell(self) -> list[str]:
        """The lines: about all, then what is left out, objects that lack the same in one."""
        by_reason: dict[str, list[str]] = {}
        for name, why in self.lacking.items():
            by_reason.setdefault(why, []).append(name)
        return [
            *self.said,
            *(f"left out: {_list(names)}: {why}" for why, names in by_reason.items()),
        ]

    def refuse_empty(self, folder: Path) -> None:
        """Refuse a collection of which nothing can be used."""
        if not self.rows:
            raise InputError("\n".join([f"{folder}: no object is there whole", *self.tell()]))


def _list(names: Sequence[str]) -> str:
    """Objects as a line names them: numbers as ranges."""
    if all(name.isdecimal() for name in names):
        return write_numbers(sorted(map(int, names)))
    return name_some(sorted(names, key=natural_key))


def measure_png(path: Path) -> tuple[int, int] | None:
    """Width and height of a PNG in pixels; None if it is none, or cut short."""
    try:
        with open(path, "rb") as file:
            begins = file.read(24)
            file.seek(-12, os.SEEK_END)
            ends = file.read()
    except OSError:
        return None
    if not begins.startswith(SIGNATURE) or ends[4:8] != LAST:
        return None
    return struct.unpack(">II", begins[16:24])


def find_faults(
    what: str, folder: Path, name: str, endings: Sequence[str]
) -> tuple[str, set[tuple[int, int]]]:
    """What is wrong with the files of an object, "" if nothing is, and their sizes.

    Args:
        what: they are, for messages
        name: that all files begin with
        endings: that files in the folder should have after it
    """
    there = set(os.listdir(folder)) if folder.is_dir() else set()
    lacking = [ending for ending in endings if name + ending not in there]
    if len(lacking) == len(endings):
        return f"has no {what}", set()
    of = f"of {len(endings)} {what}"
    if lacking:
        return f"lacks {len(lacking)} {of}: {name_some(lacking, NAMED)}", set()
    sizes = {ending: measure_png(folder / (name + ending)) for ending in endings}
    if short := [ending for ending, size in sizes.items() if size is None]:
        return f"{len(short)} {of} are cut short: {name_some(short, NAMED)}", set()
    return "", set(sizes.values())


def describe_sizes(sizes: Iterable[tuple[int, int]]) -> str:
    """Sizes of pictures as a line names them."""
    return ", ".join(f"{width}x{height}" for width, height in sorted(sizes))
