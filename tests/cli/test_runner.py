"""Real runs of a small workflow, followed by what Snakemake's logger plugin writes."""

import json
import shutil
import subprocess
import sys

import pytest

from silmesh.cli import runner
from silmesh.cli.runner import RunError, Runner, _Reader
from silmesh.cli.workspace import CONFIG, find_snakefile

SNAKEFILE = """\
rule views:
    output:
        "results/cup/views",
    log:
        "logs/views.log",
    message:
        "cup: resizing its photographs"
    shell:
        "echo Error in rule fit:; touch {output}"


rule fit:
    input:
        "results/cup/views",
    output:
        "results/{object}/{variant}.ply",
    log:
        "logs/fit-{object}-{variant}.log",
    message:
        "{wildcards.object}/{wildcards.variant}: fitting"
    shell:
        "echo fit cup/mesh: 150/600, loss 0.0160, 31 s left; touch {output}"


rule broken:
    output:
        "broken",
    log:
        "logs/a broken step.log",
    shell:
        "echo 'silmesh: a.png: is bad' > {log:q}; exit 3"
"""


class Recorder:
    """Keeps what a bar is told, but that it is to be drawn, which the clock says."""

    def __init__(self):
        self.told = []

    def __getattr__(self, name):
        return lambda *values: name == "draw" or self.told.append((name, *values))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder to run the small workflow in, with the real one's profile."""
    profiles = find_snakefile().parent / "workflow" / "profiles"
    shutil.copytree(profiles, tmp_path / "flow" / "workflow" / "profiles")
    (tmp_path / "flow" / "Snakefile").write_text(SNAKEFILE)
    (tmp_path / CONFIG).parent.mkdir(exist_ok=True, parents=True)
    (tmp_path / CONFIG).write_text("{}\n")
    monkeypatch.setattr(runner, "find_snakefile", lambda: tmp_path / "flow" / "Snakefile")
    return tmp_path


def test_how_far_a_run_is(folder):
    bar = Recorder()
    Runner(folder, 1).run(["results/cup/mesh.ply"], bar)
    assert bar.told[0] == ("plan", {"views": 1, "fit": 1})
    (_, first, *views), (_, second, *fit) = [told for told in bar.told if told[0] == "begin"]
    assert views == ["views", "resizing its photographs"]
    assert fit == ["fit", "fitting"]
    ends = [told for told in bar.told if told[0] == "finish"]
    assert ends == [("finish", first), ("finish", second)]
    assert ("go_on", "fit", 0.25) in bar.told
    assert (folder / "results/cup/mesh.ply").exists()


def test_a_failure_is_explained_by_the_steps_own_message(folder):
    with pytest.raises(RunError, match=r"^a\.png: is bad$") as failure:
        Runner(folder, 1).run(["broken"], Recorder())
    assert failure.value.step == "broken"
    log = folder / "logs/a broken step.log"
    snakefile = folder / "flow/Snakefile"
    snakefile.write_text(snakefile.read_text().replace("silmesh: a.png: is bad", "ValueError: 3"))
    with pytest.raises(RunError) as failure:
        Runner(folder, 1).run(["broken"], Recorder())
    assert str(failure.value).startswith(f"the step 'broken' ended unexpectedly; {log} says how")


def test_what_the_snakefile_says_before_it_ends_is_told(folder):
    said = "silmesh: another run is at work in /x; wait for its end"
    (folder / "flow/Snakefile").write_text(f"import sys\nsys.exit({said!r})\n")
    with pytest.raises(RunError, match=r"^another run is at work in /x; wait for its end$"):
        Runner(folder, 1).run(["results/cup/mesh.ply"], Recorder())


def test_a_snakefile_that_is_none_is_no_beginning(folder):
    (folder / "flow/Snakefile").write_text("rule all\n")
    with pytest.raises(RunError, match=r"^Snakemake could not begin; --verbose") as failure:
        Runner(folder, 1).run(["results/cup/mesh.ply"], Recorder())
    assert failure.value.step == ""


@pytest.mark.parametrize("verbose", [True, False])
def test_snakemakes_text_is_shown_to_whoever_wants_it(folder, verbose):
    bar = Recorder()
    Runner(folder, 1, verbose).run(["results/cup/views"], bar)
    said = [line for name, *values in bar.told if name == "say" for line in values]
    assert bool(said) == verbose
    for line in ("Job stats:", "Job 0: cup: resizing its photographs", "Error in rule fit:"):
        assert (line in said) == verbose
    assert not any("\033" in line or '"event"' in line for line in said)


def test_the_first_failure_is_told_of():
    reader = _Reader(Recorder())
    for rule in ("fit", "judge"):
        reader.take({"event": "job_error", "jobid": 1, "rule_name": rule, "log": [f"{rule}.log"]})
    assert (reader.failed, reader.log) == ("fit", "fit.log")


def test_the_plugin_by_itself_writes_events_to_standard_output(folder):
    words = [sys.executable, "-m", "snakemake", "--snakefile", folder / "flow/Snakefile"]
    words += ["--cores", "1", "--logger", "silmesh", "--quiet", "all", "--", "results/cup/mesh.ply"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    events = [json.loads(line) for line in lines]
    assert events[0] == {"event": "run_info", "stats": {"fit": 1, "views": 1, "total": 2}}
    assert events[-1] == {"event": "progress", "done": 2, "total": 2}
    assert {
        "event": "job_info",
        "jobid": 0,
        "rule_name": "fit",
        "rule_msg": "cup/mesh: fitting",
        "wildcards": {"object": "cup", "variant": "mesh"},
    } in events
    assert done.stderr == ""


def test_a_workflow_that_was_killed_is_told_of(tmp_path):
    said = Runner(tmp_path, 1)._explain(_Reader(Recorder()), -9)
    assert said == "the workflow was ended by signal 9; the same command goes on from here"
