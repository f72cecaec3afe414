"""Jobs go to a real SLURM, parts of which are killed; the results are those of a run without it."""

import hashlib
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from small_slurm import GPU, Slurm, find_hindrance, small_slurm

CHANGING = (  # are of Snakemake, or hold seconds that are not easily taken out
    *(".snakemake_timestamp", "report.html", "plan.json"),
    *("summary.csv", "comparison.csv"),
)
SECONDS = re.compile(rb'"(\w*seconds)": [\d.e-]+|,[\d.e-]+$', re.M)
MESH = "results/cup/round/mesh.glb"
OPTIONS = (
    *("--workflow-profile", "profiles/slurm", "--slurm-no-account"),
    *("--slurm-status-command", "squeue"),
)
# The plugin looks at its jobs after 2 s, 12 s more, 22 s more...; here always after two seconds.
SNAKEMAKE = """\
from snakemake_executor_plugin_slurm import Executor
Executor.next_seconds_between_status_checks = property(lambda self: 2, lambda self, seconds: None)
from snakemake.cli import main
main()
"""
PATIENCE = 400.0  # seconds for what takes one to three minutes on an idle machine
WAIT = """\
        if (stop := os.environ.get("SILMESH_TEST_STOP")) and not os.path.exists(stop):
            open(stop, "w").write(str(os.getpid()))
            time.sleep(600)
"""


def hindrance() -> str:
    if not find_spec("snakemake_executor_plugin_slurm"):
        return "snakemake-executor-plugin-slurm is not installed (the extra `cluster`)"
    return find_hindrance()


pytestmark = [pytest.mark.slow, pytest.mark.slurm]


@pytest.fixture(autouse=True, scope="module")
def wanted(request):
    if "slurm" not in request.config.getoption("markexpr"):
        pytest.skip("bin/test -m slurm runs them")
    if why := hindrance():
        pytest.skip(why)


@pytest.fixture
def project(project):
    """A copy of the finished project, of which a run is to be made again."""
    shutil.rmtree(project / "results/cup/round")
    return project


@pytest.fixture
def slurm(tmp_path) -> Iterator[Slurm]:
    """One for each test: what one loses, the next should not have to find again."""
    with small_slurm(tmp_path / "small") as slurm:
        yield slurm


def start(slurm: Slurm, project, *arguments: str, **environment: str) -> subprocess.Popen:
    """Start a run whose jobs go to SLURM."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith("SNAKEMAKE")}
    return subprocess.Popen(
        slurm.within([sys.executable, "-c", SNAKEMAKE, *OPTIONS, *arguments], project.folder),
        env=kept | {"PYTHONPATH": str(project / "src")} | environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )


def run(slurm: Slurm, project, *arguments: str, **environment: str) -> tuple[int, str]:
    """Run it to its end: exit status, and what it said."""
    process = start(slurm, project, *arguments, **environment)
    try:
        said, _ = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    return process.returncode, said


def state(project) -> dict[str, str]:
    """A digest of every result, but for the seconds that it took."""
    files = [f for f in (project / "results").rglob("*") if f.is_file() and f.name not in CHANGING]
    return {
        str(f.relative_to(project.folder)): hashlib.sha256(_without_seconds(f)).hexdigest()
        for f in files
    }


def _without_seconds(file: Path) -> bytes:
    text = file.read_bytes()
    return SECONDS.sub(b"", text) if file.suffix in (".csv", ".json") else text


def wait_in_fit(project) -> None:
    """Make the first fit wait where the environment says so, and no later one."""
    line = "        losses.loss.backward()\n"
    path = "src/silmesh/fitting/softras.py"
    project.edit(path, line, line + WAIT)
    text = (project / path).read_text()
    (project / path).write_text(text.replace("\nimport ", "\nimport os\nimport time\nimport ", 1))


def test_the_bytes_of_a_run_without_it(slurm, fresh, finished):
    status, said = run(slurm, fresh)
    assert status == 0, said
    assert state(fresh) == state(finished)
    assert fresh.outdated() == set()
    jobs = slurm.ask("scontrol", "show", "jobs", "-o").splitlines()
    assert len(jobs) < 10, "short jobs go together"
    fits = [job for job in jobs if "rule_run" in job]
    assert len(fits) == 2
    assert all(f"NodeList={GPU} " in job for job in fits), "a fit goes where there is a GPU"


@pytest.mark.parametrize("lost", ["job", "node", "controller"])
def test_what_is_lost_is_made_again(slurm, project, finished, tmp_path, lost):
    wait_in_fit(project)
    marker = tmp_path / "marker"
    process = start(
        slurm, project, MESH, "results/cup/round/mesh.ply", SILMESH_TEST_STOP=str(marker)
    )
    try:
        slurm.wait_for(lambda: marker.exists() and marker.read_text(), "begun a fit", PATIENCE)
        if lost == "job":
            slurm.ask("kill", "-9", marker.read_text())
        elif lost == "node":
            slurm.lose_node(GPU)
            slurm.wait_for(lambda: slurm.states()[GPU].startswith("down"), f"lost {GPU}")
            slurm.start_node(GPU)
        else:
            (running,) = slurm.ask("squeue", "-h", "--states=running", "-o", "%A").split()
            slurm.save(running)
            slurm.kill("slurmctld")
            slurm.ask("kill", "-9", marker.read_text())
        said, _ = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert process.returncode == 0, said
    for name in ("mesh.ply", "mesh.glb", "cameras.json"):
        path = f"results/cup/round/{name}"
        assert (project / path).read_bytes() == (finished / path).read_bytes()
    assert project.outdated(MESH) == set()


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--default-resources", "slurm_partition=nosuch"], "invalid partition specified: nosuch"),
        (["--default-resources", "slurm_partition=closed"], "partition closed is down"),
        (["--default-resources", "slurm_partition=lab"], "takes no jobs without an account, only"),
        (["--set-resources", "fit:mem_mb=64000"], "Requested node configuration is not available"),
        (["--set-resources", "fit:runtime=100000"], "partition work has a limit of 01:00:00"),
    ],
)
def test_a_queue_that_refuses_is_told_of_before_any_job(slurm, fresh, options, why):
    status, said = run(slurm, fresh, *options)
    assert status == 1
    assert "silmesh: SLURM takes no job of " in said
    assert why in said
    assert not (fresh / ".snakemake/slurm_logs").exists()
    assert not (fresh / "results/cup").exists()


def test_a_full_disk_on_a_node(slurm, project):
    place = project / "results/cup/round"
    place.mkdir()
    slurm.ask("mount", "-t", "tmpfs", "-o", "size=4k", "small", str(place))
    slurm.ask("touch", str(place / "kept"))  # Snakemake would remove an empty folder
    status, said = run(slurm, project, MESH, "--retries", "0")
    slurm.ask("umount", str(place))
    assert status == 1
    assert re.search(r"^ *silmesh: .*results/cup/round/.*No space left on device$", said, re.M), (
        said
    )
    status, said = run(slurm, project, MESH)
    assert status == 0, said
