"""A line now and then on standard output that says how far a long step is."""

import sys
import time


class Progress:
    """Progress of a step of a known length: a line every few seconds, and one at the end.

    Args:
        what: names the step, for example ``fit apricot/auto``
        total: how many parts it has
        every: seconds between lines
    """

    def __init__(self, what: str, total: int, every: float = 5.0):
        self._what, self._total, self._every = what, total, every
        self._start = self._last = time.monotonic()

    def __call__(self, done: int, detail: str = "") -> None:
        """Say that ``done`` parts are done, if it is time to."""
        now = time.monotonic()
        if now - self._last < self._every and done < self._total:
            return
        self._last = now
        passed = now - self._start
        left = passed / max(done, 1) * (self._total - done)
        end = f"{left:.0f} s left" if done < self._total else f"done in {passed:.1f} s"
        parts = [f"{self._what}: {done}/{self._total}", detail, end]
        sys.stdout.write(", ".join(part for part in parts if part) + "\n")
        sys.stdout.flush()
