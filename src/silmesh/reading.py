"""Files of a person's, read within limits: text, JSON, YAML and ``.npy``.

What is read may be damaged, or made to do harm, so each of these gives a value or an InputError:
in a few seconds, with little more memory than the file takes, and without running anything.
"""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from silmesh.errors import InputError, reading, shorten

if TYPE_CHECKING:
    import numpy as np

LARGEST_TEXT, LARGEST_JSON = 1 << 30, 1 << 26  # bytes; a COLMAP model has the points in its text
LARGEST_HEADER = 10_000  # characters of a .npy file's header


def read_text(path: Path, what: str = "text", most: int = LARGEST_TEXT) -> str:
    """The content of a text file in UTF-8, with or without a mark that says so.

    Args:
        what: it should be, for messages
        most: bytes that it may have

    Raises:
        InputError: it is not there, too large, or not in UTF-8
    """
    with reading(path, what):
        if (size := path.stat().st_size) > most:
            raise InputError(f"{path}: has {size:,} bytes; {what} should have at most {most:,}")
        return path.read_text(encoding="utf-8-sig")


def read_json(path: Path) -> Any:
    """The content of a JSON file.

    Raises:
        InputError: it is not JSON, has a key twice in one object, is nested too deeply, or has a
            number of thousands of digits
    """
    text = read_text(path, "JSON", LARGEST_JSON)
    with reading(path, "JSON"):
        return parse_json(text)


def parse_json(text: str) -> Any:
    """The content of JSON.

    Raises:
        ValueError: it is not JSON, or has a key twice in one object
    """
    return json.loads(text, object_pairs_hook=_to_object)


def _to_object(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """An object of JSON, none of whose keys hides another."""
    content = dict(pairs)
    if len(content) < len(pairs):
        key = next(k for k, count in Counter(k for k, _ in pairs).items() if count > 1)
        raise ValueError(f"key {shorten(key)} comes twice in one object")
    return content


def open_array(path: Path) -> "np.ndarray":
    """The array of a ``.npy`` file, left on disk until it is looked at.

    Raises:
        InputError: it is not there, is no such file, truncated, or holds Python's objects
    """
    import numpy as np  # slow to load for those who read text

    if not path.is_file():
        raise InputError(f"{path}: is not there")
    with reading(path, "a .npy array"):
        return np.lib.format.open_memmap(path, mode="r", max_header_size=LARGEST_HEADER)
