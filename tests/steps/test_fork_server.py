"""Steps in a fork of a process that waits: the same as anywhere else, and none is left behind."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from silmesh.steps import fork_server

PATIENCE = 60.0  # seconds for what takes well under one
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="forks are trusted on Linux only")


def wait_for(reached) -> bool:
    """Whether it came true in time."""
    end = time.monotonic() + PATIENCE
    while not (now := reached()) and time.monotonic() < end:
        time.sleep(0.05)
    return bool(now)


def names() -> set[str]:
    """The names that answer on this machine."""
    lines = Path("/proc/net/unix").read_text().splitlines()
    return {line.split()[-1].lstrip("@") for line in lines}


def children(pid: int) -> list[int]:
    return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@pytest.fixture(scope="module")
def waiting() -> Iterator[subprocess.Popen]:
    """A process that has loaded all, for whatever this test starts."""
    before = dict(os.environ)
    process = fork_server.start()
    assert wait_for(lambda: os.environ[fork_server.NAME] in names())
    yield process
    process.kill()
    process.wait()
    os.environ.clear()
    os.environ.update(before)


def step(*words: str, **settings) -> subprocess.Popen:
    """A step as a rule starts it."""
    command = [sys.executable, "-m", "silmesh.steps", *words]
    streams = {"text": True, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, **streams | settings)


def outcome(*words: str, **settings) -> tuple[int, str, str]:
    process = step(*words, **settings)
    said, told = process.communicate()
    return process.returncode, said, told


def alone() -> dict[str, str]:
    """The environment of a step that nothing waits for."""
    return {name: value for name, value in os.environ.items() if name != fork_server.NAME}


def photograph(folder: Path, views: int, **settings) -> subprocess.Popen:
    """The step that makes an object up, in a folder, which it is told by relative names."""
    folder.mkdir()
    places = ["--images", "images", "--masks", "masks", "--truth", "truth.ply"]
    return step("synthetic", "apricot", "--views", str(views), *places, cwd=folder, **settings)


@pytest.mark.slow
def test_a_fork_makes_the_same_bytes(waiting, tmp_path):
    made = {}
    for name, environment in (("fork", None), ("alone", alone())):
        assert photograph(tmp_path / name, 2, env=environment).wait() == 0
        files = sorted(f for f in (tmp_path / name).rglob("*") if f.is_file())
        made[name] = {f.relative_to(tmp_path / name): f.read_bytes() for f in files}
    assert len(made["fork"]) == 7  # two photographs, two masks, a list in each folder, the truth
    assert made["fork"] == made["alone"]


@pytest.mark.parametrize(
    ("words", "status"),
    [
        (("views", "--help"), 0),
        (("scene", "--nonsense"), 2),
        (("evaluate", "--mesh", "none.ply", "--cameras", "none.json"), 2),
        (("calibrate", "--views", "no-such-views"), 2),
    ],
)
def test_a_fork_says_the_same(waiting, words, status):
    fork, other = outcome(*words), outcome(*words, env=alone())
    assert fork == other
    assert fork[0] == status
    assert any(fork[1:])


def test_a_fork_has_the_environment_of_who_asked(waiting, tmp_path):
    """A step's help names its default of threads, which is torch's, which is this variable's."""
    for threads in ("1", "2"):
        environment = os.environ | {"OMP_NUM_THREADS": threads, "COLUMNS": "200"}
        said = outcome("rings", "--help", env=environment, cwd=tmp_path)
        assert f"--threads THREADS to use (default: {threads})" in " ".join(said[1].split())
        assert f"cd {tmp_path} &&" in said[2]


def test_a_fork_ends_with_who_asked(waiting, tmp_path):
    process = photograph(tmp_path / "long", 500)
    assert wait_for(lambda: children(waiting.pid))
    process.kill()
    assert wait_for(lambda: not children(waiting.pid))
    assert list((tmp_path / "long").glob("[!.]*")) == []


def test_a_killed_fork_fails_as_a_shell_says_it(waiting, tmp_path):
    process = photograph(tmp_path / "long", 500)
    assert wait_for(lambda: children(waiting.pid))
    os.kill(children(waiting.pid)[0], signal.SIGKILL)
    assert process.wait() == 128 + signal.SIGKILL


def test_steps_run_beside_each_other(waiting):
    together = [step("views", "--help") for _ in range(8)]
    assert [process.communicate()[0][:5] for process in together] == ["usage"] * 8
    assert {process.returncode for process in together} == {0}


def test_it_ends_with_the_process_that_started_it():
    code = (
        "import os, sys; from silmesh.steps import fork_server; fork_server.start()\n"
        "print(os.environ[fork_server.NAME], flush=True); sys.stdin.read()"
    )
    command, pipe = [sys.executable, "-c", code], subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=alone()) as parent:
        name = parent.stdout.readline().strip()
        assert wait_for(lambda: name in names())
        parent.kill()
    assert wait_for(lambda: name not in names())


def test_one_that_serves_a_command_is_found_and_ends_with_it():
    before, starting = (
        dict(os.environ),
        "from silmesh.steps import fork_server as f; print(f.start())",
    )
    with fork_server.serving() as served:
        name = served[fork_server.NAME]
        assert wait_for(lambda: name in names())
        assert outcome("views", "--help", env=alone() | served)[0] == 0
        command = [sys.executable, "-c", starting]
        assert subprocess.check_output(command, text=True, env=alone() | served) == "None\n"
        assert os.environ == before
    assert wait_for(lambda: name not in names())


@pytest.mark.parametrize("library", ["six", "json"])
def test_a_file_named_like_a_library_is_not_taken_for_it(tmp_path, monkeypatch, library):
    (tmp_path / f"{library}.py").write_text("raise ImportError\n")
    monkeypatch.chdir(tmp_path)
    with fork_server.serving() as named:
        assert wait_for(lambda: named[fork_server.NAME] in names())
        status, _, told = outcome("picture", "--help", env=os.environ | named, cwd=tmp_path)
        assert status == 0, told


def test_a_name_that_nobody_answers_to_is_no_hindrance():
    said = outcome("views", "--help", env=os.environ | {fork_server.NAME: "silmesh-gone"})
    assert said[0] == 0
    assert said[1].startswith("usage")


ANSWER = """
import os, socket, sys
os.setuid(65534)
with socket.socket(socket.AF_UNIX) as listener:
    listener.bind("\\0" + sys.argv[1])
    listener.listen()
    print("listens", flush=True)
    line, _ = listener.accept()
    print(line.recv(1 << 20), flush=True)
    line.sendall(b"0")
"""


@pytest.mark.skipif(os.getuid() != 0, reason="only root can be another user")
def test_another_user_who_answers_is_told_nothing():
    name, pipe = f"silmesh-impostor-{os.getpid()}", subprocess.PIPE
    command = [sys.executable, "-c", ANSWER, name]
    with subprocess.Popen(command, stdout=pipe, text=True) as other:
        assert other.stdout.readline() == "listens\n"
        said = outcome("views", "--help", env=os.environ | {fork_server.NAME: name})
        assert other.stdout.read() == "b''\n"
    assert said[0] == 0
    assert said[1].startswith("usage")


def test_a_fork_ends_with_the_process_that_it_is_a_fork_of(tmp_path):
    before = dict(os.environ)
    os.environ.pop(fork_server.NAME, None)  # of the one that waits for the other tests
    process = fork_server.start()
    assert wait_for(lambda: os.environ[fork_server.NAME] in names())
    asker = photograph(tmp_path / "long", 500)
    os.environ.clear()
    os.environ.update(before)
    assert wait_for(lambda: children(process.pid))
    (fork,) = children(process.pid)
    process.kill()
    process.wait()
    assert asker.wait() == 1
    assert wait_for(lambda: not Path(f"/proc/{fork}").exists())


def test_another_step_is_refused():
    status, _, told = outcome("nonsense")
    assert status == 1
    assert told.startswith("silmesh: name a step: ")
    assert " calibrate, " in told
