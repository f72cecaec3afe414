"""A killed run leaves nothing to unlock and nothing half-made; the next one makes the same."""

import os
import re
import signal
import time
from pathlib import Path

import pytest
from processes import processes, stop, wait_for

pytestmark = pytest.mark.slow

WAIT = """
    if os.environ.get("SILMESH_TEST_STOP") and {when}:
        Path(os.environ["SILMESH_TEST_STOP"]).write_text(str(os.getpid()))
        time.sleep(600)
"""


def wait_for_step(process, marker: Path) -> int:
    """The process of the step that has written the marker."""
    until = time.monotonic() + 120
    while not marker.exists() or not marker.read_text():
        assert process.poll() is None, process.stdout.read()
        assert time.monotonic() < until
        time.sleep(0.05)
    return int(marker.read_text())


def kill_when(process, marker: Path) -> None:
    """Kill a run and all that it started as soon as one of its steps has written the marker."""
    until = time.monotonic() + 120
    wait_for_step(process, marker)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    process.stdout.close()
    step = Path(f"/proc/{marker.read_text()}")
    while step.exists() and "Z" not in (step / "stat").read_text().split()[2]:
        assert time.monotonic() < until, "the step outlived its group"
        time.sleep(0.05)


def leftovers(project) -> list[Path]:
    return [path for path in (project / "results").rglob("*") if path.name.startswith(".part-")]


def add_stop(project, path: str, after: str, when: str = "True") -> None:
    """Make a step wait, where the environment says so, just after a line of its code."""
    indent = len(after) - len(after.lstrip())
    wait = WAIT.format(when=when).replace("\n    ", "\n" + " " * indent).rstrip() + "\n"
    project.edit(path, after, after + wait)
    file = project / path
    lines = file.read_text().split("\nimport ", 1)
    file.write_text("\nimport os\nimport time\nfrom pathlib import Path\nimport ".join(lines))


def test_a_kill_in_the_middle_of_a_fit(project, finished, tmp_path):
    marker = tmp_path / "marker"
    add_stop(project, "src/silmesh/fitting/softras.py", "        losses.loss.backward()\n")
    mesh = "results/cup/round/mesh.glb"
    kill_when(project.start(mesh, SILMESH_TEST_STOP=str(marker)), marker)
    assert not (project / "results/cup/round/mesh.ply").exists()
    project.run(mesh)
    assert leftovers(project) == []
    for name in ("mesh.ply", "mesh.obj", "mesh.glb", "cameras.json"):
        path = f"results/cup/round/{name}"
        assert (project / path).read_bytes() == (finished / path).read_bytes()
    assert project.outdated(mesh) == set()


def test_a_kill_between_the_files_of_a_texture(project, tmp_path):
    marker, folder = tmp_path / "marker", project / "results/cup/round"
    project.edit("config/config.yaml", "  boxed", "    texture: {size: 64}\n  boxed")
    targets = [f"results/cup/round/mesh.{kind}" for kind in ("obj", "png")]
    project.run(*targets)
    whole = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    assert {"mesh.obj", "mesh.mtl", "mesh.png", "mesh.glb", "texture.json"} <= set(whole)
    add_stop(project, "src/silmesh/geometry/obj_companions.py", "    _write(image, png)\n")
    kill_when(project.start(*targets, SILMESH_TEST_STOP=str(marker)), marker)
    assert (folder / "mesh.png").exists()
    assert not (folder / "mesh.obj").exists()
    project.run(*targets)
    assert leftovers(project) == []
    assert {name: (folder / name).read_bytes() for name in whole} == whole
    assert project.outdated(*targets) == set()


@pytest.mark.parametrize("target", ["views/32-pad", "cameras/32-pad-turntable"])
def test_a_kill_in_the_middle_of_writing(project, finished, tmp_path, target):
    marker = tmp_path / "marker"
    writing = f"folder.name == {Path(target).name!r}"
    add_stop(project, "src/silmesh/files.py", "        _list_made(part)\n", writing)
    path = f"results/cup/stages/{target}"
    project.run("results/cup/stages/views/32-pad")
    (project / "config/config.yaml").touch()
    forced = project.start("--force", path, SILMESH_TEST_STOP=str(marker))
    kill_when(forced, marker)
    part, *within = leftovers(project)
    assert re.fullmatch(rf"\.part-[0-9a-f]{{8}}-\d+-{re.escape(Path(target).name)}", part.name)
    assert all(part in other.parents for other in within)
    assert not (project / path).exists()
    project.run(path)
    assert leftovers(project) == []
    assert names(project / path) == names(finished / path)


def names(path: Path) -> list[str]:
    return sorted(p.name for p in path.iterdir()) if path.is_dir() else [path.read_text()]


def kill_alone(process) -> None:
    """Kill a run, and nothing that it started."""
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    process.stdout.close()


def rows_of(project) -> int:
    return len((project / "results/cup/round/loss.csv").read_text().splitlines()) - 1


def test_a_step_ends_with_its_run_and_the_next_run_has_its_own_settings(project, tmp_path):
    marker, mesh = tmp_path / "marker", "results/cup/round/mesh.ply"
    add_stop(project, "src/silmesh/fitting/softras.py", "        losses.loss.backward()\n")
    run = project.start(mesh, SILMESH_TEST_STOP=str(marker))
    wait_for_step(run, marker)
    kill_alone(run)
    project.edit("config/config.yaml", "3}\n  boxed", "5}\n  boxed")
    project.run(mesh)
    assert not processes(run.pid)
    assert rows_of(project) == 5
    assert leftovers(project) == []
    assert project.outdated(mesh) == set()


def test_a_run_is_refused_while_a_step_of_a_killed_one_lives(project, tmp_path):
    marker, mesh = tmp_path / "marker", "results/cup/round/mesh.ply"
    add_stop(project, "src/silmesh/fitting/softras.py", "        losses.loss.backward()\n")
    run = project.start(mesh, SILMESH_TEST_STOP=str(marker))
    wait_for_step(run, marker)
    others = [p.pid for p in processes(run.pid) if p.pid != run.pid]
    for pid in others:
        stop(pid)
    try:
        kill_alone(run)
        status, said = project.snakemake(mesh)
        assert status == 1
        assert "silmesh: a step of a run that was killed is still at work in /" in said
    finally:
        for pid in others:
            os.kill(pid, signal.SIGKILL)
    assert wait_for(lambda: not processes(run.pid))
    project.run(mesh)
    assert rows_of(project) == 3
