"""Files of a person's, read within limits: text, JSON, YAML, ``.npy`` and rows of ``.npz``.

What is read may be damaged, or made to do harm, so each of these gives a value or an InputError:
in a few seconds, with little more memory than the file takes, and without running anything.

A path ``<file>.npz#3`` stands for the fourth object of the one array that the file holds, packed or
not. The papers on differentiable rendering have ShapeNet so (Kato, Ushiku and Harada, *Neural 3D
Mesh Renderer*, 2018; Liu et al., *Soft Rasterizer*, 2019): images [objects, 24, 4, 64, 64] of
uint8 in one file, voxels [objects, 32, 32, 32] in another.
"""

import json
import os
import re
import zipfile
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from silmesh.errors import InputError, name_some, reading, shorten

if TYPE_CHECKING:
    import numpy as np

LARGEST_TEXT, LARGEST_JSON = 1 << 30, 1 << 26  # bytes; a COLMAP model has the points in its text
LARGEST_HEADER = 10_000  # characters of an array's header
ARCHIVE = ".npz"
IMAGES = (24, 4, 64, 64)  # shape of an object's row: views, RGB and alpha, height, width
VOXELS = (32, 32, 32)
VERSIONS = {(1, 0): "read_array_header_1_0", (2, 0): "read_array_header_2_0"}
KEPT = 4  # rows that stay in memory, as each view of an object asks for its own


class Member(NamedTuple):
    """The array of an ``.npz`` file, by its header.

    Attributes:
        name: of the array within the file
        shape, dtype: of the whole of it, the first axis that of the objects
        start: where its numbers begin within the unpacked member, in bytes
    """

    name: str
    shape: tuple[int, ...]
    dtype: "np.dtype"
    start: int


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


def is_array(path: Path | str) -> bool:
    """Whether a path is that of many photographs: a ``.npy``, or an object of an ``.npz``."""
    return Path(path).suffix == ".npy" or split_row(path) is not None


def split_row(path: Path | str) -> tuple[Path, int] | None:
    """The ``.npz`` and the row that a path stands for; None if it is of another kind."""
    if f"{ARCHIVE}#" not in (text := str(path)):  # as nearly always
        return None
    found = re.fullmatch(r"(.+\.npz)#(\d{1,9})", text, re.ASCII | re.DOTALL)
    return (Path(found[1]), int(found[2])) if found else None


def count_objects(file: Path, row: tuple[int, ...]) -> int:
    """How many objects an ``.npz`` holds, from its header.

    Args:
        row: the shape that an object should have, ``IMAGES`` or ``VOXELS``

    Raises:
        InputError: it cannot be read, or its array has another shape or kind of numbers
    """
    member = _read_header(file)
    kinds = "u" if row == IMAGES else "biuf"
    of = "uint8" if row == IMAGES else "0 and 1"
    wrong_kind = member.dtype.kind not in kinds or (row == IMAGES and member.dtype.itemsize > 1)
    if member.shape[1:] != row or not member.shape[0] or wrong_kind:
        raise InputError(
            f"{file}: should hold [objects, {', '.join(map(str, row))}] of {of}, "
            f"not {list(member.shape)} of {member.dtype}"
        )
    return member.shape[0]


def read_row(path: Path, shape: tuple[int, ...]) -> "np.ndarray":
    """The numbers of one object, a path ``<file>.npz#3``: an array of ``shape``.

    Raises:
        InputError: as ``count_objects``, or it has no such row, or is truncated
    """
    file, number = split_row(path)
    count = count_objects(file, shape)
    if number >= count:
        raise InputError(f"{file}: has the objects 0 to {count - 1}, not {number}")
    with reading(file, "an .npz file"):
        return _read_row(file, number, os.stat(file).st_mtime_ns)


def read_voxels(path: Path) -> "np.ndarray":
    """Which voxels of an object of an ``.npz`` are full: [32, 32, 32] bool.

    Raises:
        InputError: as ``read_row``, or it holds other numbers than 0 and 1, or no voxel is full
    """
    row = read_row(path, VOXELS)
    full = row == 1
    if not (full | (row == 0)).all():
        raise InputError(f"{path}: should hold 0 and 1 alone, not {row[~full & (row != 0)][0]}")
    if not full.any():
        raise InputError(f"{path}: no voxel is full")
    return full


def _read_header(file: Path) -> Member:
    """What an ``.npz`` file holds."""
    if not file.is_file():
        raise InputError(f"{file}: is not there")
    with reading(file, "an .npz file"):
        status = os.stat(file)
        return _open_header(file, status.st_size, status.st_mtime_ns)


@lru_cache(maxsize=64)  # a table names one file for each of its objects
def _open_header(file: Path, size: int, changed: int) -> Member:
    import numpy as np  # slow to load for those who read text

    with zipfile.ZipFile(file) as archive:
        names = archive.namelist()
        if len(names) != 1:
            raise InputError(
                f"{file}: should hold one array, of all objects, not {len(names)}: "
                f"{shorten(name_some(names))}"
            )
        with archive.open(names[0]) as member:
            version = np.lib.format.read_magic(member)
            read = getattr(np.lib.format, VERSIONS[version])
            shape, by_columns, dtype = read(member, max_header_size=LARGEST_HEADER)
            if by_columns or dtype.hasobject or not shape:
                raise InputError(
                    f"{file}: should hold numbers row by row, as "
                    "np.savez_compressed(file, np.ascontiguousarray(array)) writes them"
                )
            return Member(names[0], shape, dtype, member.tell())


@lru_cache(maxsize=KEPT)
def _read_row(file: Path, number: int, changed: int) -> "np.ndarray":
    """Unpack a file up to the end of a row, in pieces, and keep the row."""
    import numpy as np

    found = _read_header(file)
    shape = found.shape[1:]
    size = found.dtype.itemsize * int(np.prod(shape))
    with zipfile.ZipFile(file) as archive, archive.open(found.name) as member:
        member.seek(found.start + number * size)
        content = member.read(size)
    if len(content) < size:
        raise ValueError(f"it ends within object {number}")
    return np.frombuffer(content, found.dtype).reshape(shape)
