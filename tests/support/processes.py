"""The processes of this machine, as Linux tells of them, for tests that kill some."""

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

PATIENCE = 120.0  # seconds for what takes well under one where nothing else is at work


@dataclass(frozen=True)
class Process:
    """A process that has not ended."""

    pid: int
    parent: int
    session: int
    words: str


def processes(session: int) -> list[Process]:
    """Those of a session, the eldest first."""
    found = filter(None, map(_read, Path("/proc").glob("[0-9]*")))
    return sorted((p for p in found if p.session == session), key=lambda p: p.pid)


def wait_for(reached: Callable[[], object]) -> bool:
    """Whether it came true in time."""
    end = time.monotonic() + PATIENCE
    while not (now := reached()) and time.monotonic() < end:
        time.sleep(0.02)
    return bool(now)


def stop(pid: int) -> None:
    """Stop a process, as one that waits for a disk: it cannot end by itself."""
    os.kill(pid, signal.SIGSTOP)
    status = Path(f"/proc/{pid}/stat")
    assert wait_for(lambda: status.read_text().rpartition(")")[2].split()[0] == "T")


def _read(folder: Path) -> Process | None:
    try:
        status = (folder / "stat").read_text().rpartition(")")[2].split()
        words = (folder / "cmdline").read_text(errors="replace").replace("\0", " ")
    except (FileNotFoundError, ProcessLookupError):
        return None
    if status[0] in "ZX":
        return None
    return Process(int(folder.name), int(status[1]), int(status[3]), words)
