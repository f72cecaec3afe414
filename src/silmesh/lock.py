"""A lock on a folder that a killed process does not leave behind."""

import fcntl
import os
from pathlib import Path

_held: list[int] = []  # open until this process ends


def hold(path: Path | str) -> bool:
    """Lock a file until this process ends, however it ends; false if another process has it.

    The kernel keeps the lock with the open file, which child processes do not inherit. Where the
    file system knows no locks, nothing is refused.
    """
    file = os.open(path, os.O_CREAT | os.O_RDWR)
    _held.append(file)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True
