"""Runs killed at random, whatever of them is killed and how, end in the bytes of one left alone.

``SILMESH_KILLS=200 python -m pytest tests/workflow/test_kills.py -s`` kills 200 times, and says
what it killed.
"""

import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter

import pytest
from processes import Process, processes, wait_for

from silmesh.files import MADE

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="finds processes as Linux tells of them"),
]

KILLS = int(os.environ.get("SILMESH_KILLS", "4"))
SEED = int(os.environ.get("SILMESH_SEED", "14"))
ROUND = 5  # kills between two runs that are left alone
MESH = "results/cup/round/mesh.ply"
RULES = ("views", "silhouettes", "cameras", "scene", "initial", "fit")
ITERATIONS = (3, 60)  # a killed run has the one or the other
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
VICTIMS = ("run", "worker", "fork", "forking process", "group")
CHANGING = ("loss.csv", ".snakemake_timestamp")  # holds seconds; is of Snakemake's


def state(project) -> dict[str, str]:
    """A digest of every file of a mesh and of the stages that it stands on."""
    files = [f for f in (project / "results").rglob("*") if f.is_file() and f.name not in CHANGING]
    return {
        str(f.relative_to(project.folder)): hashlib.sha256(f.read_bytes()).hexdigest()
        for f in files
    }


def stages(expected: dict[str, str]) -> list[str]:
    """The outputs of all stages: Snakemake makes one that is lost only where something needs it."""
    folders = [name.removesuffix(f"/{MADE}") for name in expected if name.endswith(f"/{MADE}")]
    return [*folders, *(name for name in expected if name.endswith("/first.ply"))]


def find(victim: str, run: subprocess.Popen) -> list[Process]:
    """The processes of a run that are of this kind."""
    there = processes(run.pid)
    servers = [
        p.pid for p in there if "silmesh.steps.fork_server" in p.words and p.parent == run.pid
    ]
    return {
        "run": [p for p in there if p.pid == run.pid],
        "group": [p for p in there if p.pid == run.pid],
        "worker": [p for p in there if " silmesh.steps " in p.words and "bash" not in p.words],
        "fork": [p for p in there if p.parent in servers],
        "forking process": [p for p in there if p.pid in servers],
    }[victim]


def kill_once(project, dice: random.Random, seconds: float) -> str | None:
    """Start a run and kill something of it: what and how; None if it ended before."""
    iterations, rule = dice.choice(ITERATIONS), dice.choice(RULES)
    victim, kind = dice.choice(VICTIMS), dice.choice(SIGNALS)
    set_iterations(project, iterations)
    run = project.start(MESH, "--forcerun", rule, cores=1)
    time.sleep(dice.uniform(0, seconds))
    wait_for(lambda: find(victim, run) or run.poll() is not None)
    targets = find(victim, run)
    if targets and run.poll() is None:
        try:
            (os.killpg if victim == "group" else os.kill)(dice.choice(targets).pid, kind)
        except ProcessLookupError:
            targets = []
    if targets and victim == "run" and kind == signal.SIGKILL:  # its steps may live on
        run.wait()
        run.stdout.close()
        return "SIGKILL to the run"
    said, _ = run.communicate(timeout=600)
    assert "still at work" not in said, said
    assert "another run is at work" not in said, said
    return f"{kind.name} to the {victim}" if targets else None


def set_iterations(project, iterations: int) -> None:
    config = project / "config/config.yaml"
    words = [f"iterations: {n}" for n in ITERATIONS]
    text = config.read_text()
    for word in words:
        text = text.replace(word + "}", "iterations: N}")
    config.write_text(text.replace("iterations: N}", f"iterations: {iterations}}}"))


def test_killed_runs_end_in_the_same_bytes(fresh):
    dice, killed = random.Random(SEED), Counter()
    begun = time.monotonic()
    fresh.run(MESH, cores=1)
    seconds, expected = time.monotonic() - begun, state(fresh)
    assert any(name == MESH for name in expected)
    while killed.total() < KILLS:
        upto = min(KILLS, killed.total() + ROUND)
        while killed.total() < upto:
            if how := kill_once(fresh, dice, seconds):
                killed[how] += 1
                print(killed.total(), how, flush=True)
            else:
                seconds *= 0.7  # it had ended: later stages alone take less
        set_iterations(fresh, ITERATIONS[0])
        fresh.run(MESH, *stages(expected), cores=1)
        assert state(fresh) == expected, killed
        assert fresh.outdated(MESH, cores=1) == set()
        print("the same after", killed.total(), "kills:", dict(killed), flush=True)
        if dice.random() < 0.3:
            shutil.rmtree(fresh / "results")
