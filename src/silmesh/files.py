"""Outputs that are whole or absent: written beside their place, then renamed into it.

A file takes the place of a file, never of a folder. A folder takes the place of an empty one, or of
one that was made here and holds nothing else: it bears a list of what was put into it. So no path
that a person names loses what the person put there.
"""

import errno
import os
import platform
import re
import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from silmesh.errors import InputError

MADE = ".silmesh"  # in a folder that was made here: the names of all that was put into it
ALLOWED = {MADE, ".snakemake_timestamp"}  # may be in such a folder beside what MADE lists
PART = ".part-"  # begins the names of what is being written
NOT_OURS = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES}  # what a disk refuses
TRIED = 1 << 16  # bytes written to try a place: a full disk has room for an empty file


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Give a path beside ``path`` to write a file at; rename it when done.

    The name keeps its suffix, so that writers which choose a format by it still do. If the block
    raises, what was written is removed and what stood at ``path`` stays as it was. A kill leaves
    at most a hidden ``.part-`` file of this process's own, which the next call for the same path
    removes.

    >>> with replacing("mesh.ply") as part:
    ...     mesh.export(part)

    Raises:
        InputError: a folder is there, or what is no ordinary file, or no folder can be for it
    """
    path = Path(path)
    _refuse_as_file(path)
    with _beside(path) as part:
        yield part
        os.replace(part, path)


@contextmanager
def making(folder: Path | str) -> Iterator[Path]:
    """Give a new folder beside ``folder`` to fill; rename it when done, as ``replacing`` does.

    Raises:
        InputError: what is there is a file, a link, or a folder that holds what was not made here
    """
    folder = Path(folder)
    _refuse_as_folder(folder)
    with _beside(folder) as part:
        part.mkdir()
        yield part
        _list_made(part)
        if folder.is_dir():
            part.chmod(folder.stat().st_mode)
            _remove_made(folder)
        os.replace(part, folder)


def try_file(path: Path) -> None:
    """Try whether a file can be written, before the work for it; nothing is left of that.

    Raises:
        InputError: it cannot; the message names the place and why
    """
    _refuse_as_file(path)
    if os.path.exists(path) and not os.access(path, os.W_OK):
        raise InputError(f"{path}: is protected from being written")
    _try(path)


def try_folder(folder: Path) -> None:
    """Try whether a folder can be made, or made anew, before the work for it, as ``try_file``."""
    _refuse_as_folder(folder)
    _try(folder)


def try_inside(folder: Path) -> None:
    """Try whether files can be written into a folder, of whomever or to be made."""
    if os.path.lexists(folder) and not os.path.isdir(folder):
        raise InputError(f"{folder}: is a file; should be a folder")
    _try(folder / "tried", folder)


def remove(path: Path) -> None:
    """Remove a file, if it is there."""
    path.unlink(missing_ok=True)


@contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """A path beside another; nothing is left there after the block."""
    with _naming(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        part = _name_part(path)
    _discard(part)
    try:
        yield part
    except OSError as error:
        error.filename = error.filename or str(path)  # a full disk does not say of which file
        raise
    finally:
        _discard(part)


def _name_part(path: Path) -> Path:
    """A path beside another for this process alone; removes those of processes that have ended."""
    machine = f"{zlib.crc32(platform.node().encode()):08x}"  # others' processes are not seen here
    name = rf"{re.escape(PART)}{machine}-(\d+)-{re.escape(path.name)}"
    parts = [other for other in os.listdir(path.parent) if other.startswith(PART)]  # of many files
    for other in parts:
        if (left := re.fullmatch(name, other)) and not _is_alive(int(left[1])):
            _discard(path.with_name(other))
    return path.with_name(f"{PART}{machine}-{os.getpid()}-{path.name}")


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # another user's
        return True
    return not _is_zombie(pid)


def _is_zombie(pid: int) -> bool:
    """Whether a process has ended and nobody has waited for it yet, as Linux tells."""
    with suppress(OSError):
        state = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()[0]
        return state == b"Z"
    return False


def _discard(part: Path) -> None:
    """Remove a part, which nobody but this module names, with all in it."""
    if part.is_dir() and not part.is_symlink():
        shutil.rmtree(part)
    else:
        part.unlink(missing_ok=True)


def _refuse_as_file(path: Path) -> None:
    if os.path.isdir(path):
        raise InputError(f"{path}: is a folder; should be the file to write")
    if os.path.exists(path) and not os.path.isfile(path):
        raise InputError(f"{path}: is no ordinary file, and should not be replaced by one")
    _refuse_nameless(path)


def _refuse_as_folder(folder: Path) -> None:
    if os.path.islink(folder):
        raise InputError(f"{folder}: is a link; should be a folder to make, or an empty one")
    if os.path.lexists(folder) and not os.path.isdir(folder):
        raise InputError(f"{folder}: is a file; should be a folder to make")
    if os.path.ismount(folder):
        raise InputError(f"{folder}: is where a disk is mounted; should be a folder within it")
    if os.path.isdir(folder) and (other := _find_other(folder)):
        raise InputError(
            f"{folder}: holds {other}, which was not made with it; should be a folder to make, or "
            "an empty one"
        )
    _refuse_nameless(folder)


def _refuse_nameless(path: Path) -> None:
    """Refuse ``.`` and ``..``, beside which nothing can be written for it."""
    if path.name in ("", ".."):
        raise InputError(f"{path}: should end in a name, not in '{path.name or '.'}'")


def _find_other(folder: Path) -> str | None:
    """Something in a folder that was not put there when it was made, if there is any."""
    try:
        made = (folder / MADE).read_bytes().split(b"\0")
    except OSError:
        made = []
    known = {*map(os.fsdecode, made), *ALLOWED}
    return next((name for name in _names_in(folder) if name not in known), None)


def _list_made(folder: Path) -> None:
    """Write into a folder the names of all that is in it."""
    names = [name for name in _names_in(folder) if name != MADE]
    (folder / MADE).write_bytes(b"\0".join(map(os.fsencode, names)))


def _names_in(folder: Path) -> list[str]:
    """All files, links and folders in a folder, from it; what is in a folder after that."""
    return sorted(path.relative_to(folder).as_posix() for path in _walk(folder))


def _walk(folder: Path) -> Iterator[Path]:
    for entry in folder.iterdir():
        yield entry
        if entry.is_dir() and not entry.is_symlink():
            yield from _walk(entry)


def _remove_made(folder: Path) -> None:
    """Remove a folder that holds only what was made with it."""
    names = _names_in(folder)
    _refuse_as_folder(folder)  # what came since is none of the names, and keeps the folder
    for name in reversed(names):
        path = folder / name
        path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()
    folder.rmdir()


def _try(path: Path, named: Path | None = None) -> None:
    """Write a file beside a path, and remove it and what folders it needed."""
    with _naming(named or path):
        lacking = [parent for parent in path.parents if not os.path.lexists(parent)]
        made: list[Path] = []
        try:
            for parent in reversed(lacking):
                parent.mkdir()
                made.append(parent)
            with _beside(path) as part:
                part.write_bytes(bytes(TRIED))
        finally:
            for parent in reversed(made):
                with suppress(OSError):  # another process may have put something there
                    parent.rmdir()


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Say which place the system refuses, and why."""
    try:
        yield
    except OSError as error:
        at, why = Path(error.filename or path), error.strerror
        if error.errno in (errno.EEXIST, errno.ENOTDIR):
            files = (p for p in path.parents if os.path.lexists(p) and not os.path.isdir(p))
            if file := next(files, None):
                at, why = file, "is not a folder"
        where = f"{at}: " if at in path.parents else ""
        raise InputError(f"{path}: cannot be written: {where}{why}") from error
