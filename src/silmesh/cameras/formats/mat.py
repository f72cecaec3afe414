"""A ``.mat`` file with a cell array P of 3x4 projection matrices, as Oxford's dinosaur has it.

The matrices belong to the photographs in their order. Pixel centres are taken to lie at integers.

A file is a header of 128 bytes and elements (MathWorks, "MAT-File Format", level 5). SciPy's reader
can end the process over a damaged one, so the few kinds that P is made of are read here:

    element   u4 kind, u4 size, then so many bytes, up to a multiple of 8; or both as u2 in one u4,
              then at most 4 bytes
    matrix    an element of elements: flags, dimensions, name, and numbers, or matrices for a cell
"""

import math
import struct
import zlib
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from silmesh.cameras.formats.parsing import gather, numbers, to_half
from silmesh.cameras.formats.projection import cameras_of
from silmesh.errors import InputError, cut, reading, shorten
from silmesh.geometry.camera import Cameras

HEADER, TAG = 128, 8  # bytes
HDF5 = b"\x89HDF\r\n\x1a\n"  # begins what version 7.3 holds, at a multiple of 512
MATRIX, COMPRESSED = 14, 15  # kinds of elements
STORED = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
CELL, NUMERIC = 1, range(6, 16)  # classes of matrices; NUMERIC is from double to uint64
CLASSES = ("nothing", "cell", "struct", "object", "char", "sparse", "double", "single")
COMPLEX = 0x800  # among the flags
FIRST = 1 << 12  # bytes of a compressed matrix that hold its name
LARGEST = 1 << 22  # bytes of P, some 27,000 matrices
LARGEST_FILE = 1 << 30


class _Matrix(NamedTuple):
    """A matrix as it lies in the file: its class and flags, its dimensions, its name, the rest."""

    flags: int
    shape: tuple[int, ...]
    name: str
    rest: bytes

    @property
    def kind(self) -> int:
        return self.flags & 0xFF

    def __str__(self) -> str:
        kind = CLASSES[self.kind] if self.kind < len(CLASSES) else "integer"
        return f"{shorten(list(self.shape))} of {kind}{' complex' * bool(self.flags & COMPLEX)}"


def read(path: Path) -> Cameras:
    """Cameras in the order of the cells."""
    matrices = _read_matrices(path)
    if not matrices:
        raise InputError(f"{path}: P is empty; should hold a 3x4 matrix for each photograph")
    names = [f"P{{{i + 1}}}" for i in range(len(matrices))]
    matrices = [
        to_half(numbers(matrix, (3, 4), f"{path}: {name}"))
        for matrix, name in zip(matrices, names, strict=True)
    ]
    return gather(cameras_of(matrices, names, path))


def _read_matrices(path: Path) -> list[np.ndarray]:
    """What P holds, from a file that is damaged or whole."""
    with reading(path, "a .mat file up to version 7"):
        if (size := path.stat().st_size) > LARGEST_FILE:
            raise ValueError(f"has {size:,} bytes")
        data = path.read_bytes()
        if HDF5 in (data[:8], data[512:520]):
            raise InputError(
                f"{path}: is a .mat file of version 7.3, which cannot be read; save it again in "
                "MATLAB with save(file, 'P', '-v7')"
            )
        order = {b"IM": "<", b"MI": ">"}.get(data[HEADER - 2 : HEADER])
        if order is None:
            raise ValueError("it does not begin as one of version 5 to 7 does")
        found = _find(path, data, order)
        return list(_numbers_of(path, found, order))


def _find(path: Path, data: bytes, order: str) -> _Matrix:
    """The matrix named P; no other is looked into, nor unpacked beyond its name."""
    others = []
    for kind, content, _ in _elements(data, order, HEADER):
        if kind == COMPRESSED:
            head = zlib.decompressobj().decompress(content, FIRST)[TAG:]
        elif kind == MATRIX:
            head = content
        else:
            continue
        if (name := _begin(head, order).name) == "P":
            return _begin(content if kind == MATRIX else _unpack(content, order), order)
        others.append(cut(name, 40))
    raise InputError(
        f"{path}: should hold a cell array P of 3x4 matrices, holds "
        f"{', '.join(others[:8]) or 'nothing'}"
    )


def _unpack(packed: bytes, order: str) -> bytes:
    """The content of the one matrix in a compressed element."""
    content = zlib.decompressobj().decompress(packed, LARGEST)
    return next(_elements(content, order))[1]


def _elements(data: bytes, order: str, at: int = 0) -> Iterator[tuple[int, bytes, int]]:
    """The kind and the content of each element in turn, and where the next one begins.

    Raises:
        ValueError: an element reaches beyond the end
    """
    while at < len(data):
        (word,) = struct.unpack_from(f"{order}I", data, at)
        if word >> 16:  # a small one
            kind, size, start, end = word & 0xFFFF, word >> 16, at + TAG // 2, at + TAG
        else:
            kind, size = struct.unpack_from(f"{order}2I", data, at)
            start = at + TAG
            end = start + (size if kind == COMPRESSED else -(-size // 8) * 8)
        if start + size > min(end, len(data)):
            raise ValueError(f"it is truncated or damaged at byte {at:,} of {len(data):,}")
        yield kind, data[start : start + size], end
        at = end


def _begin(content: bytes, order: str) -> _Matrix:
    """What a matrix's content begins with."""
    (_, flags, _), (_, shape, _), (_, name, end) = islice(_elements(content, order), 3)
    (flags,) = struct.unpack_from(f"{order}I", flags)
    shape = tuple(np.frombuffer(shape, f"{order}i4").tolist())
    return _Matrix(flags, shape, name.decode("latin-1"), content[end:])


def _numbers_of(path: Path, found: _Matrix, order: str) -> Iterator[np.ndarray]:
    """The matrices of a cell array, or of an array of 3 x 4 x views."""
    if found.kind == CELL:
        cells = list(_elements(found.rest, order))
        if len(cells) != math.prod(found.shape):
            raise ValueError(f"P should have {found.shape} cells, has {len(cells)}")
        for _, content, _ in cells:
            yield _to_array(path, _begin(content, order), order)
    elif len(found.shape) == 3 and found.shape[:2] == (3, 4):
        yield from np.moveaxis(_to_array(path, found, order), 2, 0)
    else:
        raise InputError(f"{path}: P should be a cell array of 3x4 matrices, not {found}")


def _to_array(path: Path, found: _Matrix, order: str) -> np.ndarray:
    """The numbers of a matrix, which may be stored as smaller ones than they are."""
    if found.kind not in NUMERIC or found.flags & COMPLEX:
        raise InputError(f"{path}: P should be a cell array of 3x4 matrices, holds one {found}")
    kind, data, _ = next(_elements(found.rest, order))
    values = np.frombuffer(data, f"{order}{STORED[kind]}").astype(np.float64)
    if min(found.shape) < 0 or math.prod(found.shape) != len(values):
        raise ValueError(f"a matrix should be {found}, has {len(values)} numbers")
    return values.reshape(found.shape, order="F")
