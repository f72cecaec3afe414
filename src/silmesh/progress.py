"""A line now and then on standard output that says how far a long step is."""

import os
import sys
import time
from collections.abc import Callable

Share = Callable[[float], None]  # is told which share of a step is done, from 0 to 1
EVERY = "SILMESH_PROGRESS"  # names the seconds between lines, which are then always written
HUNDRED = 100


class Progress:
    """Progress of a step of a known length: a line every few seconds, and one at the end.

    It is quiet where standard output is no terminal, unless ``$SILMESH_PROGRESS`` is set.

    Args:
        what: the step and what it works on, for example ``fit apricot/auto``
        total: how many parts it has
        every: seconds between lines
    """

    def __init__(self, what: str, total: int, every: float = 5.0):
        given = os.environ.get(EVERY)
        self._what, self._total, self._every = what, total, float(given or every)
        self._start = self._last = time.monotonic()
        self._quiet = not (given or sys.stdout.isatty())

    def __call__(self, done: int, detail: str = "") -> None:
        """Say that ``done`` parts are done, if it is time to."""
        now = time.monotonic()
        if self._quiet or (now - self._last < self._every and done < self._total):
            return
        self._last = now
        passed = now - self._start
        left = passed / max(done, 1) * (self._total - done)
        end = f"{left:.0f} s left" if done < self._total else f"done in {passed:.1f} s"
        parts = [f"{self._what}: {done}/{self._total}", detail, end]
        sys.stdout.write(", ".join(part for part in parts if part) + "\n")
        sys.stdout.flush()


def share_of(what: str) -> Share:
    """Progress, in hundredths, of a step that knows only which share of it is done."""
    progress = Progress(what, HUNDRED)
    return lambda share: progress(int(HUNDRED * share))


def untold(share: float) -> None:
    """Progress that nobody asks for."""


def within(progress: Share, start: float, end: float) -> Share:
    """Progress of a part of a step, which begins and ends at these shares of the whole."""
    return lambda share: progress(start + share * (end - start))
