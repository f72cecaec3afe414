"""Outputs that are whole or absent: written beside their place, then renamed into it."""

import os
import platform
import re
import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Give a path beside ``path`` to write a file or make a folder at; rename it when done.

    The name keeps its suffix, so that writers which choose a format by it still do. If the block
    raises, what was written is removed and what stood at ``path`` stays as it was. A kill leaves
    at most a hidden ``.part-`` file of this process's own, which the next call for the same path
    removes.

    >>> with replacing("mesh.ply") as part:
    ...     mesh.export(part)
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = _name_part(path)
    remove(part)
    try:
        yield part
        if path.is_dir() or part.is_dir():
            remove(path)
        os.replace(part, path)
    except OSError as error:
        error.filename = error.filename or str(path)  # a full disk does not say of which file
        raise
    finally:
        remove(part)


def remove(path: Path) -> None:
    """Remove a file or a folder with all in it, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _name_part(path: Path) -> Path:
    """A path beside another for this process alone; removes those of processes that have ended."""
    machine = f"{zlib.crc32(platform.node().encode()):08x}"  # others' processes are not seen here
    name = re.compile(rf"\.part-(?:{machine}-(\d+)-)?{re.escape(path.name)}")
    for other in path.parent.iterdir():
        if (left := name.fullmatch(other.name)) and not (left[1] and _is_alive(int(left[1]))):
            remove(other)
    return path.with_name(f".part-{machine}-{os.getpid()}-{path.name}")


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # another user's
        return True
    return True
