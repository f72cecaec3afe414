"""A command that is told to stop says so in one line, from its first moment on.

It imports next to nothing: what it guards against begins while the command's libraries are loaded.
"""

import os
import signal
import sys

STOPPED = 130  # exit status, as a shell has it for Ctrl-C
MESSAGE = "silmesh: stopped; the same command goes on from here"
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class StoppingAtOnce:
    """A block in which a signal to stop ends the process: there is nothing to clean up.

    Libraries that are being loaded turn a KeyboardInterrupt into errors of theirs, or swallow it.
    """

    def __enter__(self) -> None:
        self._before = on_signals(_end)

    def __exit__(self, *_: object) -> None:
        for kind, handler in self._before.items():
            signal.signal(kind, handler)


def interrupt(*_: object) -> None:
    """Raise KeyboardInterrupt, where there is something to clean up."""
    raise KeyboardInterrupt


def on_signals(act: object) -> dict:
    """Call this on signals to stop, but for those that are ignored, as nohup has it.

    Returns:
        what was called before, by the signal
    """
    before = {kind: signal.getsignal(kind) for kind in SIGNALS}
    kept = {kind: handler for kind, handler in before.items() if handler != signal.SIG_IGN}
    for kind in kept:
        signal.signal(kind, act)
    return kept


def _end(*_: object) -> None:
    sys.stderr.write(f"{MESSAGE}\n")
    sys.stderr.flush()
    os._exit(STOPPED)
