"""Reads changed files in a process of its own, and tells which end otherwise than they may.

An input may give a result or an InputError whose message names the file and can be read: in five
seconds, within 8 GiB. Anything else is a failure: another error, a signal, a hang.
"""

import os
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fuzz.mutate import mutate
from fuzz.readers import Reader

from silmesh.errors import LONGEST, InputError

SECONDS, MEMORY = 5, 8 << 30  # of the processor and bytes that an input may take
PATIENCE = 60  # seconds after which a process that answers nothing is killed
RESULT, REFUSED = "result", "refused"


class TooSlowError(BaseException):
    """An input took longer than it may."""


@dataclass(frozen=True)
class Failure:
    """An input that ended otherwise."""

    reader: str
    seed: int
    number: int
    why: str

    def __str__(self) -> str:
        again = f"--reader '{self.reader}' --seed {self.seed} --first {self.number} --inputs 1"
        return f"{again}\n{self.why}"


def make_input(reader: Reader, seed: int, number: int) -> dict[str, bytes]:
    """The files of one input."""
    rng = np.random.default_rng([seed, zlib.crc32(reader.name.encode()), number])
    return mutate(reader.files, rng)


def fuzz(
    reader: Reader, seed: int, numbers: Sequence[int], until: float = float("inf")
) -> tuple[Counter, list[Failure]]:
    """Read these inputs: how many ended how, and those that may not.

    Args:
        until: time after which no other input is begun
    """
    counts, failures = Counter(), []
    left = list(numbers)
    while left and time.time() < until:
        last = None
        for number, ending in _ask_worker(reader, seed, left, until):
            last = number
            if ending is None:
                continue  # it is begun
            counts[ending.partition("\n")[0]] += 1
            if ending not in (RESULT, REFUSED):
                failures.append(Failure(reader.name, seed, number, ending))
        if last is None:
            break
        left = left[left.index(last) + 1 :]
    return counts, failures


def _ask_worker(
    reader: Reader, seed: int, numbers: Sequence[int], until: float
) -> Iterator[tuple[int, str | None]]:
    """Fork a process that reads the inputs in turn until one kills it.

    Yields:
        each number when it is begun, with None, and again with how it ended
    """
    receive, send = os.pipe()
    if not (child := os.fork()):
        os.close(receive)
        _work(reader, seed, numbers, send, until)
    os.close(send)
    number, ended = None, True
    with os.fdopen(receive, "rb", buffering=0) as pipe:
        for message in _messages(pipe, child):
            number, ending = int(message[0]), message[1]
            ended = bool(ending)
            yield number, ending or None
    _, status = os.waitpid(child, 0)
    if not ended:
        yield number, f"killed\nby signal {os.WTERMSIG(status)}, or after {PATIENCE} s"


def _messages(pipe, child: int) -> Iterator[tuple[str, str]]:
    """What a process says; it is killed if it says nothing for too long."""
    left = b""
    while True:
        if not select.select([pipe], [], [], PATIENCE)[0]:
            os.kill(child, signal.SIGKILL)
        if not (got := pipe.read(1 << 16)):
            return
        *whole, left = (left + got).split(b"\0")
        for message in whole:
            number, _, ending = message.decode(errors="replace").partition(" ")
            yield number, ending


def _work(reader: Reader, seed: int, numbers: Sequence[int], send: int, until: float) -> None:
    """Read inputs in this process, which then ends."""
    try:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1), os.dup2(nothing, 2)
        warnings.simplefilter("ignore")
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        signal.signal(signal.SIGPROF, _give_up)
        folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
        for number in numbers:
            if time.time() > until:
                break
            os.write(send, f"{number} \0".encode())
            ending = read_input(reader, make_input(reader, seed, number), folder)
            told = ending.replace("\0", "\\0")  # which ends a message
            os.write(send, f"{number} {told}\0".encode(errors="replace"))
        shutil.rmtree(folder, ignore_errors=True)
    finally:
        os._exit(0)


def _give_up(*_) -> None:
    raise TooSlowError


def read_input(reader: Reader, files: dict[str, bytes], folder: Path) -> str:
    """How it ends: a result, a refusal, or an error with its traceback."""
    shutil.rmtree(folder, ignore_errors=True)
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    try:
        with _alarm():
            reader.read(folder)
    except InputError as error:
        return (
            REFUSED
            if folder.name in str(error) and len(str(error)) < 2 * LONGEST
            else (f"message\n{error}")
        )
    except BaseException as error:
        return f"{type(error).__name__}\n{''.join(traceback.format_exception(error))[-3000:]}"
    return RESULT


@contextmanager
def _alarm() -> Iterator[None]:
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def say(text: str) -> None:
    """Print at once."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()
