"""A command that is told to stop, from its first moment on; one that is killed leaves nothing."""

import os
import signal
import subprocess
import sys
import time
from glob import glob
from pathlib import Path

import pytest
from PIL import Image
from processes import PATIENCE, processes, wait_for

from silmesh.planning.provenance import SOURCE

LOADING = """
import os, signal, sys

class Stop:
    def find_spec(self, name, *_):
        if name == sys.argv[1]:
            os.kill(os.getpid(), getattr(signal, sys.argv[2]))

sys.meta_path.insert(0, Stop())
from silmesh.cli.main import main
main(sys.argv[3:])
"""
STOPPED = "silmesh: stopped; the same command goes on from here\n"
LIBRARIES = ["click", "silmesh.errors", "silmesh.cli.make", "silmesh.cli.runner", "yaml", "numpy"]


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    for i in range(4):
        path = tmp_path / f"photos/{i}.png"
        path.parent.mkdir(exist_ok=True)
        picture = Image.new("RGB", (64, 64), (20, 20, 20))
        picture.paste((200, 120, 40), (20, 16 + i, 44, 48 - i))
        picture.save(path)
    return path.parent


@pytest.mark.parametrize("kind", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("library", LIBRARIES)
def test_stopped_while_a_library_is_loaded(photos, tmp_path, library, kind):
    words = [sys.executable, "-c", LOADING, library, kind, str(photos), "-o", "mesh.glb"]
    settings = {"PYTHONPATH": str(SOURCE), "SILMESH_CACHE": str(tmp_path / "cache")}
    done = subprocess.run(
        words, cwd=tmp_path, env=os.environ | settings, capture_output=True, text=True
    )
    assert done.returncode == 130
    assert done.stderr.endswith(STOPPED)
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "mesh.glb").exists()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="finds processes as Linux tells of them")
def test_a_killed_command_takes_all_with_it(photos, tmp_path):
    settings = {"PYTHONPATH": str(SOURCE), "SILMESH_CACHE": str(tmp_path / "cache")}
    code = "from silmesh.cli.main import main; main()"
    words = [sys.executable, "-c", code, str(photos), "--cameras", "turntable"]
    words += ["--turntable", "2.7,0,90", "--size", "64", "--silhouettes", "threshold"]
    command = subprocess.Popen(words, cwd=tmp_path, env=os.environ | settings)
    log = str(tmp_path / "cache/objects/*/logs/views/*.log")
    assert wait_for(lambda: glob(log))  # a step
    children = Path(f"/proc/{command.pid}/task/{command.pid}/children").read_text().split()
    begun = list(map(int, children))  # Snakemake, and what the steps are forks of
    assert any(len(processes(pid)) > 1 for pid in begun)
    second = subprocess.run(words, cwd=tmp_path, env=os.environ | settings, capture_output=True)
    assert second.returncode == 2
    assert b"another silmesh is at work in " in second.stderr
    command.send_signal(signal.SIGKILL)
    command.wait()
    killed = time.monotonic()
    assert wait_for(lambda: not any(map(processes, begun)))
    assert time.monotonic() - killed < PATIENCE / 2
