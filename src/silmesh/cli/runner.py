"""Runs the workflow in a folder, follows it, and says in one message why it failed if it did.

Snakemake runs as a process of its own, in a group of its own, so that all that it started ends with
it; and it ends with this process, if that is killed. Of its text only what moves the bar is read;
that it succeeded, its exit status says.
"""

import os
import queue
import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from threading import Thread

from silmesh.cli.bar import Bar, shorten
from silmesh.cli.workspace import CONFIG, find_snakefile
from silmesh.errors import InputError
from silmesh.files import try_inside
from silmesh.lock import LIFELINE, make_lifeline, name_lifeline
from silmesh.progress import EVERY
from silmesh.silhouettes.weights import CACHE, cache_folder, user_cache

TICK = 0.5  # seconds between two looks at the clock
PATIENCE = 10.0  # seconds that a stopped run has to end by itself

STATISTICS = re.compile(r"(\w+) +(\d+)")
STEP = re.compile(r".*python -m silmesh\.steps (\w+) ")
BEGUN = re.compile(r"Job (\d+): (.*)")
DONE = re.compile(r"Finished jobid: (\d+) \(Rule: (\w+)\)")
PART = re.compile(r"(\w+)\b[^:]*: (\d+)/(\d+)")
FAILED = re.compile(r"Error in rule (\w+)")
LOG = re.compile(r" +log: (\S+)")
OURS = "silmesh: "
SPOKEN = "utf-8:backslashreplace"  # what all processes of a run write, in any locale


class RunError(Exception):
    """The workflow ended without its results; the message says why.

    Attributes:
        step: the rule that failed; "" if none was reached
    """

    def __init__(self, message: str, step: str = ""):
        super().__init__(message)
        self.step = step


class Runner:
    """A run of the workflow in a folder.

    Args:
        folder: with the table and the configuration
        cores: how many it may use
        verbose: whether all that Snakemake says is shown
    """

    def __init__(self, folder: Path, cores: int, verbose: bool = False):
        self._folder, self._cores, self._verbose = folder, cores, verbose

    def run(self, targets: Sequence[str], bar: Bar) -> None:
        """Make the targets, unless they are there and nothing that they depend on changed.

        Raises:
            RunError: a step failed
            KeyboardInterrupt: it was stopped; all of its processes have ended
        """
        process, lifeline = self._start(targets)
        reader = _Reader(bar)
        try:
            for line in _lines(process):
                if line is None:
                    bar.draw()
                    continue
                if self._verbose:
                    bar.say(line)
                reader.read(line)
            status = process.wait()
        except BaseException:
            _stop(process)
            raise
        finally:
            os.close(lifeline)
        if status:
            raise RunError(self._explain(reader, status), reader.failed)

    def _start(self, targets: Sequence[str]) -> tuple[subprocess.Popen, int]:
        """Snakemake, and the file by which it knows that this process lives."""
        ours, theirs = make_lifeline()
        process = subprocess.Popen(
            self._command(targets),
            cwd=self._folder,
            env=_environment(self._folder) | {LIFELINE: name_lifeline(theirs)},
            encoding="utf-8",
            errors="replace",
            stdin=theirs,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        os.close(theirs)
        return process, ours

    def _command(self, targets: Sequence[str]) -> list[str]:
        snakefile = find_snakefile()
        profile = snakefile.parent / "workflow" / "profiles" / "default"
        given = ["--snakefile", snakefile, "--workflow-profile", profile, "--profile", "none"]
        given += ["--configfile", CONFIG, "--cores", self._cores, "--nocolor"]
        words = [sys.executable, "-m", "snakemake", *map(str, given), "--printshellcmds"]
        return [*words, "--", *targets]

    def _explain(self, reader: "_Reader", status: int = 1) -> str:
        """Why a run failed: a step's own message, else where to look."""
        if status < 0:
            return f"the workflow was ended by signal {-status}; the same command goes on from here"
        if reader.log and (message := _last_message(self._folder / reader.log)):
            return message
        if reader.said:
            return reader.said[-1].removeprefix(OURS)
        if reader.log:
            return (
                f"the step {reader.failed!r} ended unexpectedly; {self._folder / reader.log} says "
                "how, and begins with the command that does it again"
            )
        return "Snakemake could not begin; --verbose shows what it says"


class _Reader:
    """What a run's lines say: how far it is, and what went wrong."""

    def __init__(self, bar: Bar):
        self._bar = bar
        self._jobs: dict[str, int] | None = None  # while its statistics are being read
        self._begun = ""  # the last job
        self.failed, self.log = "", ""
        self.said: list[str] = []

    def read(self, line: str) -> None:
        """Take a line."""
        if line.startswith("Job stats:"):
            self._jobs = {}
        elif self._jobs is not None:
            self._count(line)
        elif begun := BEGUN.fullmatch(line):
            self._begun = begun[1]
            self._bar.begin(begun[1], shorten(begun[2]))
        elif step := STEP.match(line):
            self._bar.name(self._begun, step[1])
        elif done := DONE.match(line):
            self._bar.finish(done[1], done[2])
        elif part := PART.match(line):
            self._bar.go_on(part[1], int(part[2]) / max(1, int(part[3])))
        elif failed := FAILED.match(line):
            self.failed = failed[1]
        elif self.failed and not self.log and (log := LOG.match(line)):
            self.log = log[1]
        elif line.startswith(OURS):
            self.said.append(line)

    def _count(self, line: str) -> None:
        counted = STATISTICS.fullmatch(line.rstrip())
        if counted and counted[1] != "total":
            self._jobs[counted[1]] = int(counted[2])
        elif counted:
            self._bar.plan(self._jobs)
            self._jobs = None


def _environment(folder: Path) -> dict[str, str]:
    """This process's environment, with no defaults for Snakemake but with lines of progress.

    Where no home can be written, as in a container, Snakemake's cache is in the run's own folder.
    """
    kept = {k: v for k, v in os.environ.items() if not k.startswith("SNAKEMAKE")}
    if kept.get(CACHE):  # it works in another folder
        kept[CACHE] = str(cache_folder().absolute())
    if "PYTHONPATH" in kept:
        parts = kept["PYTHONPATH"].split(os.pathsep)
        kept["PYTHONPATH"] = os.pathsep.join(os.path.abspath(part) for part in parts if part)
    try:
        try_inside(user_cache() / "snakemake")
    except (InputError, RuntimeError):
        kept["XDG_CACHE_HOME"] = str(folder.absolute() / ".snakemake" / "cache")
    return kept | {EVERY: "1", "PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": SPOKEN}


def _lines(process: subprocess.Popen) -> Iterator[str | None]:
    """The lines that a process writes, and None now and then while it writes none."""
    waiting: queue.SimpleQueue[str | None] = queue.SimpleQueue()

    def read() -> None:
        for line in process.stdout:
            waiting.put(line.rstrip("\n"))
        waiting.put(None)

    Thread(target=read, daemon=True).start()
    while True:
        try:
            line = waiting.get(timeout=TICK)
        except queue.Empty:
            yield None
            continue
        if line is None:
            return
        yield line


def _stop(process: subprocess.Popen) -> None:
    """End a process and all that it started."""
    for kind, patience in ((signal.SIGTERM, PATIENCE), (signal.SIGKILL, None)):
        try:
            os.killpg(process.pid, kind)
            process.wait(patience)
        except subprocess.TimeoutExpired:
            continue
        except ProcessLookupError:
            process.wait()
        return


def _last_message(log: Path) -> str:
    """The message that a step's log ends with: from its last line that is ours."""
    text = "\n" + log.read_text(errors="replace", encoding="utf-8") if log.is_file() else ""
    return text.rpartition(f"\n{OURS}")[2].strip() if f"\n{OURS}" in text else ""
