"""Downloads that go on where they broke off, in this process or in a later one.

What has come lies in ``<file>.partial`` and, beside it, which version of the source that is. A
source that gives no version is begun anew: two versions must not be mixed.
"""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from silmesh.errors import InputError
from silmesh.progress import Share, untold

PIECE = 1 << 20  # bytes that are written at a time
PATIENCE = 60  # seconds without a byte
WAITS = (1, 3, 9, 27)  # seconds before each further try; anew after any byte that is new


class Answer(NamedTuple):
    """What a source gives.

    Attributes:
        start: the byte with which it begins: 0 if it does not go on where it was asked to
        total: bytes of the whole, if that is known
        version: changes with the content; "" if it is not known
        pieces: the bytes; raises ``BrokenOffError`` if they end early
    """

    start: int
    total: int | None
    version: str
    pieces: Iterator[bytes]


class BrokenOffError(Exception):
    """A source that may do better when it is asked again; the message has nothing secret."""


# Asks a source for its bytes from one on, of this version if it still has it.
Source = Callable[[int, str], Answer]


def download(name: str, source: Source, file: Path, progress: Share = untold) -> None:
    """Write what a source has to a file, which is whole or absent.

    Args:
        name: of the source, for messages
        progress: is told which share is done, if the source says how much there is

    Raises:
        InputError: it has none, or broke off again and again without anything new
    """
    part = file.with_name(f"{file.name}.partial")
    waits, most = list(WAITS), _size(part)
    while True:
        try:
            _go_on(source, part, progress)
            break
        except BrokenOffError as error:
            if (come := _size(part)) > most:
                waits, most = list(WAITS), come
            if not waits:
                raise InputError(
                    f"{name}: {error}; {come:,} bytes have come, and are kept for another run"
                ) from error
            time.sleep(waits.pop(0))
    os.replace(part, file)
    _version_of(part).unlink(missing_ok=True)


def _go_on(source: Source, part: Path, progress: Share) -> None:
    """Get what is lacking of a part."""
    known = _version_of(part)
    version = known.read_text(encoding="utf-8") if known.is_file() else ""
    answer = source(_size(part) if version else 0, version)
    if answer.start == 0:
        part.unlink(missing_ok=True)  # first: its bytes are of another version
        known.write_text(answer.version, encoding="utf-8")
    with _naming(part), part.open("r+b" if answer.start else "wb") as opened:
        opened.seek(answer.start)
        for piece in answer.pieces:
            opened.write(piece)
            if answer.total:
                progress(min(opened.tell() / answer.total, 1.0))
        come = opened.tell()
    if answer.total is not None and come != answer.total:
        raise BrokenOffError(f"broke off after {come:,} of {answer.total:,} bytes")


@contextmanager
def _naming(part: Path) -> Iterator[None]:
    """Say which file it is where the system does not, as of a full disk."""
    try:
        yield
    except OSError as error:
        error.filename = error.filename or str(part)
        raise


def _version_of(part: Path) -> Path:
    return part.with_name(f"{part.name}.version")


def _size(part: Path) -> int:
    return part.stat().st_size if part.is_file() else 0
