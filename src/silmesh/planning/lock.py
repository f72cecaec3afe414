"""A run has its folder to itself, and what it starts ends with it, however it ends.

A run holds the lock ``LOCK`` until it ends, and each of its steps holds ``STEPS`` together with the
others, so that the next run begins when the last step of a killed one has ended. The kernel keeps
them with the open files: a killed process leaves none behind. The command `silmesh` holds
``COMMAND`` while it prepares runs in a folder.

The standard input of what a run starts is a pipe that only the run could write to. It never does;
that the pipe closes tells a step, or the workflow of a command, that who started it has ended.
"""

import fcntl
import os
import select
import signal
import time
from contextlib import suppress
from pathlib import Path
from threading import Thread

LOCK = Path(".snakemake/silmesh.lock")
COMMAND = Path(".snakemake/silmesh.command")
STEPS = Path(".snakemake/silmesh.steps")
LIFELINE = "SILMESH_LIFELINE"  # the variable that says which pipe it is, as no other input is
PATIENCE = 20.0  # seconds that the steps of a killed run have to end
LOOK = 0.05  # seconds between two looks at whether a lock is free
STDIN = 0

_held: list[int] = []  # open until this process ends


class BusyError(Exception):
    """Another run, or what is left of one, is at work in this folder; the message says so."""


def hold(path: Path | str) -> bool:
    """Lock a file until this process ends, however it ends; false if another process has it.

    Child processes do not inherit it. Where the file system knows no locks, nothing is refused.
    """
    if (file := _lock(path, fcntl.LOCK_EX | fcntl.LOCK_NB)) is None:
        return False
    _held.append(file)
    return True


def begin_run() -> None:
    """Take this folder for a run, and tie to it all that is started from here on.

    Raises:
        BusyError: another run is at work here, or a step of one that was killed
        OSError: the lock cannot be written
    """
    if not hold(LOCK):
        raise BusyError(f"another run is at work in {Path.cwd()}; wait for its end")
    if not _becomes_free(STEPS):
        raise BusyError(
            f"a step of a run that was killed is still at work in {Path.cwd()}; wait for its end"
        )
    ours, theirs = make_lifeline()
    os.dup2(theirs, STDIN)
    os.close(theirs)
    _held.append(ours)
    os.environ[LIFELINE] = name_lifeline(STDIN)


def join_run() -> None:
    """Be a step of the run that started this process: end with it, and hold up the next till then.

    A step on another machine of a cluster only does the latter, where the file system's locks reach
    that far. Does nothing in a process that no run has started.
    """
    if LIFELINE not in os.environ:
        return
    with suppress(OSError):  # where the folder can only be read, the step ends by its own message
        _held.append(_lock(STEPS, fcntl.LOCK_SH))
    end_with_parent()


def end_with_parent() -> None:
    """End this process when the one that holds the other end of its standard input has ended."""
    if os.environ.get(LIFELINE) != name_lifeline(STDIN):
        return
    file = os.dup(STDIN)  # a run's steps get another one
    if select.select([file], [], [], 0)[0]:
        _end()
    Thread(target=_watch, args=(file,), daemon=True).start()


def make_lifeline() -> tuple[int, int]:
    """The two ends of a pipe: the one to keep, and the standard input of what is started."""
    theirs, ours = os.pipe()
    return ours, theirs


def name_lifeline(file: int) -> str:
    """What the kernel calls an open file, for ``LIFELINE``; "" if it is closed."""
    try:
        status = os.fstat(file)
    except OSError:
        return ""
    return f"{status.st_dev}-{status.st_ino}"


def _lock(path: Path | str, how: int) -> int | None:
    """Lock a file: it, open; None if another process has it."""
    file = os.open(path, os.O_CREAT | os.O_RDWR, 0o666)
    try:
        fcntl.flock(file, how)
    except BlockingIOError:
        os.close(file)
        return None
    except OSError:
        pass
    return file


def _becomes_free(path: Path) -> bool:
    """Whether nobody holds a lock, or nobody any more after some patience."""
    end = time.monotonic() + PATIENCE
    while (file := _lock(path, fcntl.LOCK_EX | fcntl.LOCK_NB)) is None:
        if time.monotonic() > end:
            return False
        time.sleep(LOOK)
    os.close(file)
    return True


def _watch(file: int) -> None:
    with suppress(OSError):
        os.read(file, 1)
    _end()


def _end() -> None:
    os.kill(os.getpid(), signal.SIGKILL)
