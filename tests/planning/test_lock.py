"""Locks and lifelines between real processes."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from processes import stop

from silmesh.planning.lock import LIFELINE, hold, make_lifeline, name_lifeline

HOLD = """
import sys
from silmesh.planning.lock import hold
print(hold(sys.argv[1]), flush=True)
input()
"""
STEP = """
import sys, time
from silmesh.planning.lock import join_run
join_run()
print("at work", flush=True)
time.sleep(600)
"""
RUN = """
import subprocess, sys
from silmesh.planning import lock
lock.PATIENCE = 0.5
try:
    lock.begin_run()
except lock.BusyError as error:
    sys.exit(str(error))
print("begun", flush=True)
if sys.argv[1:]:
    subprocess.run([sys.executable, "-c", sys.argv[1]])
"""


def python(code: str, *words: str, **settings) -> subprocess.Popen:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([sys.executable, "-c", code, *words], text=True, **pipes | settings)


def end(process: subprocess.Popen) -> None:
    process.kill()
    process.communicate()


def test_a_lock_is_another_processes_until_that_ends(tmp_path):
    path = tmp_path / "lock"
    other = python(HOLD, str(path))
    assert other.stdout.readline() == "True\n"
    assert not hold(path)
    end(other)
    assert hold(path)
    assert not hold(path)  # it is taken once
    again = python(HOLD, str(path))
    assert again.stdout.readline() == "False\n"
    end(again)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / ".snakemake").mkdir()
    return tmp_path


def test_two_runs_in_a_folder(folder):
    first = python(RUN, STEP, cwd=folder)
    assert first.stdout.readline() == "begun\n"
    _, told = python(RUN, cwd=folder).communicate()
    assert told == f"another run is at work in {folder}; wait for its end\n"
    end(first)


def test_a_step_ends_with_its_run(folder):
    run = python(RUN, STEP, cwd=folder)
    assert run.stdout.readline() == "begun\n"
    assert run.stdout.readline() == "at work\n"
    run.kill()
    assert run.stdout.read() == ""  # the step has this stream too: it has ended
    end(run)
    assert python(RUN, cwd=folder).communicate()[0] == "begun\n"


@pytest.mark.skipif(sys.platform != "linux", reason="looks at processes as Linux tells of them")
def test_a_step_that_cannot_end_holds_up_the_next_run(folder):
    run = python(RUN, STEP.replace('"at work"', "__import__('os').getpid()"), cwd=folder)
    assert run.stdout.readline() == "begun\n"
    step = int(run.stdout.readline())
    stop(step)
    run.kill()
    run.wait()
    try:
        _, told = python(RUN, cwd=folder).communicate()
    finally:
        os.kill(step, signal.SIGKILL)
    assert told.startswith("a step of a run that was killed is still at work in ")
    end(run)
    assert python(RUN, cwd=folder).communicate()[0] == "begun\n"


def test_a_step_that_begins_after_its_run_has_ended_does_nothing(folder):
    ours, theirs = make_lifeline()
    os.close(ours)
    environment = os.environ | {LIFELINE: name_lifeline(theirs)}
    late = python(STEP, cwd=folder, stdin=theirs, env=environment)
    assert late.communicate()[0] == ""
    assert late.returncode == -signal.SIGKILL
    os.close(theirs)


def test_a_step_on_another_machine_holds_up_the_next_run(folder):
    elsewhere = os.environ | {LIFELINE: "1-2"}  # of its run, whose pipe no other machine has
    step = python(STEP, cwd=folder, stdin=subprocess.DEVNULL, env=elsewhere)
    assert step.stdout.readline() == "at work\n"
    _, told = python(RUN, cwd=folder).communicate()
    assert told.startswith("a step of a run that was killed is still at work in ")
    end(step)
    assert python(RUN, cwd=folder).communicate()[0] == "begun\n"


@pytest.mark.parametrize("environment", [{}, {LIFELINE: "1-2"}])
def test_a_step_that_no_run_started_minds_no_input(folder, environment):
    alone = python(STEP, cwd=folder, env=os.environ | environment, stdin=subprocess.DEVNULL)
    assert alone.stdout.readline() == "at work\n"
    end(alone)
