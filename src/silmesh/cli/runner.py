"""Runs the workflow in a folder, follows it, and says in one message why it failed if it did.

Snakemake runs as a process of its own, in a group of its own, so that all that it started ends with
it; and it ends with this process, if that is killed. Its logger plugin writes its events to a pipe
of their own; of the text only the steps' own lines are read. That it succeeded, its exit status
says.
"""

import json
import os
import queue
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import Any, TextIO

from silmesh.cli.bar import Bar, shorten
from silmesh.cli.workspace import CONFIG, find_snakefile
from silmesh.errors import InputError
from silmesh.files import try_inside
from silmesh.planning.lock import LIFELINE, make_lifeline, name_lifeline
from silmesh.progress import EVERY
from silmesh.remote.cache import CACHE, cache_folder, user_cache

TICK = 0.5  # seconds between two looks at the clock
PATIENCE = 10.0  # seconds that a stopped run has to end by itself

PART = re.compile(r"(\w+)\b[^:]*: (\d+)/(\d+)")  # as silmesh.progress writes it
OURS = "silmesh: "
PLUGIN = "silmesh"  # the package snakemake_logger_plugin_silmesh
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
        served: what is added to the environment of what is started
    """

    def __init__(
        self,
        folder: Path,
        cores: int,
        verbose: bool = False,
        served: Mapping[str, str] | None = None,
    ):
        self._folder, self._cores, self._verbose = folder, cores, verbose
        self._served = served or {}

    def run(self, targets: Sequence[str], bar: Bar) -> None:
        """Make the targets, unless they are there and nothing that they depend on changed.

        Raises:
            RunError: a step failed
            KeyboardInterrupt: it was stopped; all of its processes have ended
        """
        process, lifeline, events = self._start(targets)
        reader = _Reader(bar)
        try:
            for said in _follow(process.stdout, events):
                if said is None:
                    bar.draw()
                elif isinstance(said, dict):
                    reader.take(said)
                else:
                    if self._verbose:
                        bar.say(said)
                    reader.read(said)
            status = process.wait()
        except BaseException:
            _stop(process)
            raise
        finally:
            os.close(lifeline)
        if status:
            raise RunError(self._explain(reader, status), reader.failed)

    def _start(self, targets: Sequence[str]) -> tuple[subprocess.Popen, int, TextIO]:
        """Snakemake, the file by which it knows that this process lives, and its events."""
        ours, theirs = make_lifeline()
        events, sink = os.pipe()
        process = subprocess.Popen(
            self._command(targets, sink),
            cwd=self._folder,
            env=_environment(self._folder) | self._served | {LIFELINE: name_lifeline(theirs)},
            encoding="utf-8",
            errors="replace",
            stdin=theirs,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            pass_fds=(sink,),
        )
        os.close(theirs)
        os.close(sink)
        return process, ours, open(events, encoding="utf-8")

    def _command(self, targets: Sequence[str], events: int) -> list[str]:
        snakefile = find_snakefile()
        profile = snakefile.parent / "workflow" / "profiles" / "default"
        given = ["--snakefile", snakefile, "--workflow-profile", profile, "--profile", "none"]
        given += ["--configfile", CONFIG, "--cores", self._cores, "--printshellcmds"]
        given += ["--logger", PLUGIN, f"--logger-{PLUGIN}-file", events]
        return [sys.executable, "-m", "snakemake", *map(str, given), "--", *targets]

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
    """What a run says: how far it is, and what went wrong."""

    def __init__(self, bar: Bar):
        self._bar = bar
        self.failed, self.log = "", ""
        self.said: list[str] = []

    def take(self, event: dict[str, Any]) -> None:
        """Take an event of Snakemake's."""
        match event["event"]:
            case "run_info":
                self._bar.plan({k: v for k, v in event["stats"].items() if k != "total"})
            case "job_info":
                rule = event["rule_name"]
                self._bar.begin(event["jobid"], rule, shorten(event["rule_msg"] or rule))
            case "job_finished":
                self._bar.finish(event["job_id"])
            case "job_error" if not self.failed:
                self.failed, self.log = event["rule_name"], next(iter(event["log"]), "")

    def read(self, line: str) -> None:
        """Take a line of text."""
        if part := PART.match(line):
            self._bar.go_on(part[1], int(part[2]) / max(1, int(part[3])))
        elif line.startswith(OURS):
            self.said.append(line)


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


def _follow(text: TextIO, events: TextIO) -> Iterator[str | dict[str, Any] | None]:
    """Lines of text and events as they come, and None now and then while there are none.

    It ends when both have ended.
    """
    waiting: queue.SimpleQueue[str | dict[str, Any] | None] = queue.SimpleQueue()

    def read(stream: TextIO, parse: Callable[[str], Any]) -> None:
        with stream, suppress(ValueError):  # the last event of a killed run is cut short
            for line in stream:
                waiting.put(parse(line.rstrip("\n")))
        waiting.put(None)

    for stream, parse in ((text, str), (events, json.loads)):
        Thread(target=read, args=(stream, parse), daemon=True).start()
    at_work = 2
    while at_work:
        try:
            said = waiting.get(timeout=TICK)
        except queue.Empty:
            yield None
            continue
        if said is None:
            at_work -= 1
        else:
            yield said


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
