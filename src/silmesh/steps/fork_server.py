"""A process that has loaded the slow libraries and runs every step in a fork of itself.

Torch and what comes with it take a step two seconds to load, as long as many a step's work. So the
command, or else the Snakefile, starts one process beside the run, which loads them, and the steps'
own code, once and forks for each step. The fork begins at once, and has the arguments, folder,
environment and streams of the process that asked; that one waits, and ends as the fork ends. Where
nothing answers, as on another machine or in a container, the step runs where it was asked for. Its
results are the same to the byte.

The process ends with the one that started it; a fork with the one that asked for it, with the
process that it is a fork of, and with the run whose step it is. Anyone on the machine may call a
name or answer to it, so each end asks the kernel who is at the other.
"""

import atexit
import gc
import importlib
import json
import os
import runpy
import secrets
import select
import signal
import socket
import struct
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from silmesh.planning.lock import join_run

LIBRARIES = (  # are loaded before the first fork
    "pydantic",
    "torch",
    "numba",
    "scipy.optimize",
    "scipy.ndimage",
    "scipy.sparse.linalg",
    "trimesh",
)
# Are loaded one by one after that, whenever no step is asked for: what the first steps need first.
LATER = (
    *("silmesh.steps.views", "silmesh.steps.silhouettes", "silmesh.steps.calibrate"),
    *("silmesh.steps.scene", "skimage.measure", "silmesh.steps.judge", "silmesh.steps.initial"),
    *("silmesh.steps.fit", "silmesh.steps.colour", "silmesh.steps.evaluate", "scipy.stats"),
    *("matplotlib.figure", "silmesh.steps.picture", "pandas", "silmesh.steps.figure"),
    *("silmesh.steps.gallery", "silmesh.steps.rings"),
)
NAME = "SILMESH_FORK_SERVER"  # the environment variable that holds the name of its socket
# OpenBLAS reads this once, as it is loaded; the last bits of results depend on it.
ALONE = {"OPENBLAS_NUM_THREADS": "1"}
# A file in the folder of a run, a `six.py` or `json.py`, is not taken for the library of its name.
SAFE = {"PYTHONSAFEPATH": "1"}
LOOK = 500  # milliseconds between two checks that its parent lives
STREAMS = (0, 1, 2)
PR_SET_PDEATHSIG = 1  # of prctl(2)


def start() -> subprocess.Popen | None:
    """Start one, for all that is started from here on, unless one serves this process already.

    Only on Linux: elsewhere libraries of the system do not work in a fork. The name lies in no
    folder, so a kill leaves nothing.
    """
    if sys.platform != "linux" or NAME in os.environ:
        return None
    os.environ |= _choose_name()
    return _launch(os.environ)


@contextmanager
def serving() -> Iterator[Mapping[str, str]]:
    """One while something else is at work: the environment by which that finds it."""
    if sys.platform != "linux":
        yield {}
        return
    named = _choose_name()
    process = _launch({**os.environ, **named}, apart=True)  # no Ctrl-C is meant for it
    try:
        yield named
    finally:
        process.kill()
        process.wait()


def _choose_name() -> dict[str, str]:
    return {NAME: f"silmesh-{secrets.token_hex(8)}", **ALONE, **SAFE}


def _launch(environment: Mapping[str, str], apart: bool = False) -> subprocess.Popen:
    """Start one with this environment, and if ``apart`` in a session of its own."""
    words = [sys.executable, "-m", "silmesh.steps.fork_server"]
    nowhere = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    return subprocess.Popen(words, env=environment, start_new_session=apart, **nowhere)


def serve_job(several: bool) -> None:
    """Serve what a scheduler's job runs, on whichever machine that is.

    It never asks the process beside the run: that is none of the job, and may be out of reach.

    Args:
        several: whether the job has several steps, as that of a group has; one alone would have to
            wait for the libraries as well
    """
    os.environ.pop(NAME, None)
    if several:
        start()


def run_step(step: str, arguments: Sequence[str]) -> int:
    """Run a step in a fork of the process that waits, else in this one: its exit status.

    The status of a step that a signal ended is 128 more than the signal, as a shell has it.
    """
    join_run()
    os.environ |= ALONE
    with socket.socket(socket.AF_UNIX) as line:
        if not _call(line):
            _run_here(step, arguments)
            return 0
        status = _ask(line, step, arguments)
    return 128 - status if status < 0 else status


def main() -> None:
    """Load, wait, and be the step in each fork."""
    name, parent = os.environ.pop(NAME), os.getppid()
    done: list[str] = []
    atexit.register(_leave, done)  # the first to be registered is the last to be called
    for library in LIBRARIES:
        importlib.import_module(library)
    gc.freeze()  # what the forks share is not looked through in them, so not copied
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("\0" + name)
        listener.listen()
        line = _Forks(listener).serve(parent)
    if line:
        step, arguments = _take_over(line)
        join_run()
        _run_here(step, arguments)
        done.append(step)


class _Forks:
    """A fork for whoever asks; it tells each the status, and ends a fork that nobody waits for."""

    def __init__(self, listener: socket.socket):
        self._listener = listener
        self._events = select.poll()
        self._acts: dict[int, Callable[[], None]] = {}
        self._lines: dict[int, socket.socket] = {}  # of each fork, by its process
        self._line: socket.socket | None = None  # in a fork, its own
        self._watch(listener.fileno(), select.POLLIN, self._answer)

    def serve(self, parent: int) -> socket.socket | None:
        """Until the parent and all forks have ended; in a fork, its line to who asked for it."""
        loads = (partial(importlib.import_module, module) for module in LATER)
        waiting = deque([*loads, _call_numba, gc.freeze])
        while os.getppid() == parent or self._lines:
            events = self._events.poll(0 if waiting else LOOK)
            for file, _ in events[:1]:  # one alone: it may undo the next
                self._acts[file]()
            if not events and waiting:
                waiting.popleft()()
            if self._line:
                return self._line
        return None

    def _answer(self) -> None:
        line, _ = self._listener.accept()
        waits = os.getpid()
        if _user_of(line) != os.getuid():
            line.close()
        elif pid := os.fork():
            self._lines[pid] = line
            ended = os.pidfd_open(pid)
            self._watch(ended, select.POLLIN, lambda: self._tell(pid, ended))
            self._watch(line.fileno(), select.POLLRDHUP, lambda: self._give_up(pid))
        else:
            _end_with(waits)
            self._line = line
            for other in self._lines.values():
                other.close()

    def _give_up(self, pid: int) -> None:
        self._forget(self._lines[pid].fileno())
        os.kill(pid, signal.SIGKILL)

    def _tell(self, pid: int, ended: int) -> None:
        status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        self._forget(ended)
        os.close(ended)
        with self._lines.pop(pid) as line, suppress(ConnectionError, BlockingIOError):
            self._forget(line.fileno())
            line.sendall(str(status).encode())
            line.setblocking(False)
            while line.recv(1 << 16):  # what a fork was killed before it read spoils the answer
                pass

    def _watch(self, file: int, event: int, act: Callable[[], None]) -> None:
        self._events.register(file, event)
        self._acts[file] = act

    def _forget(self, file: int) -> None:
        if self._acts.pop(file, None):
            self._events.unregister(file)


def _call_numba() -> None:
    """Make numba look through its registries, which takes its first call 0.3 s in each fork."""
    importlib.import_module("numba").njit(lambda x: x)(0)


def _leave(done: Sequence[str]) -> None:
    """End a fork whose step ended well, and leave its memory to the kernel.

    Python would take apart, object by object, what the fork shares with the process that waits: the
    kernel copies each page that this writes to, which takes as long as many a step's work.
    """
    if done:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def _ask(line: socket.socket, step: str, arguments: Sequence[str]) -> int:
    """Have a step run at the other end: how it ended; 1, and a word, if nobody is left to say."""
    request = step, list(arguments), str(Path.cwd()), dict(os.environ)
    with suppress(ConnectionError):
        socket.send_fds(line, [b"\n"], STREAMS)
        line.sendall(json.dumps(request).encode() + b"\n")
        with line.makefile("rb") as answer:
            if status := answer.read():
                return int(status)
    sys.stderr.write(f"silmesh: the step {step!r} was killed, with the process that ran it\n")
    return 1


def _call(line: socket.socket) -> bool:
    """Connect to the process that waits; false if none does, or if another user's answers."""
    try:
        line.connect("\0" + os.environ[NAME])
    except (KeyError, ConnectionRefusedError):
        return False
    return _user_of(line) == os.getuid()


def _end_with(parent: int) -> None:
    """End this process with its parent."""
    import ctypes  # who asks for a step has no use for it

    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGKILL)


def _user_of(line: socket.socket) -> int:
    """Who is at the other end, as the kernel says: anyone on the machine may call a name."""
    _, user, _ = struct.unpack("3i", line.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    return user


def _take_over(line: socket.socket) -> tuple[str, list[str]]:
    """Become the process that asked, as far as a step can tell: its step and arguments."""
    _, files, *_ = socket.recv_fds(line, 1, len(STREAMS))
    with line.makefile("rb") as request:
        step, arguments, folder, environment = json.loads(request.readline())
    for stream, file in zip(STREAMS, files, strict=True):
        os.dup2(file, stream)
        os.close(file)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    if threads := environment.get("OMP_NUM_THREADS"):  # read by a torch that is being loaded
        importlib.import_module("torch").set_num_threads(int(threads))
    return step, arguments


def _run_here(step: str, arguments: Sequence[str]) -> None:
    sys.argv[1:], module = arguments, f"silmesh.steps.{step}"
    sys.modules.pop(module, None)  # runpy warns of one that is loaded
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
