"""What Snakemake says is read as it says it: this text is a real run's, shortened."""

import pytest

from silmesh.cli.runner import Runner, _last_message, _Reader

RUN = """\
Job stats:
job            count
-----------  -------
views              1
fit                1
total              2

Select jobs to execute...
Execute 1 jobs...

[Tue Nov 24 19:59:04 2026]
Job 5: cup: resizing its photographs
[Tue Nov 24 19:59:06 2026]
Finished jobid: 5 (Rule: views)
1 of 2 steps (50%) done

[Tue Nov 24 20:00:24 2026]
Job 1: cup/mesh: fitting
Shell command: python -m silmesh.steps fit --first results/cup/stages/first/x/first.ply
fit cup/mesh: 150/600, loss 0.0160, 31 s left
"""
FAILURE = """\
[Tue Nov 24 20:10:00 2026]
Error in rule views:
    message: cup: resizing its photographs
    jobid: 5
    input: photographs/a.png
    output: results/cup/stages/views/64-pad
    log: logs/views/cup-64-pad.log (check log file(s) for error details)
    shell:
        PATH=/bin:$PATH; python -m silmesh.steps views
"""


class Recorder:
    """Keeps what a bar is told."""

    def __init__(self):
        self.told = []

    def __getattr__(self, name):
        return lambda *values: self.told.append((name, *values))


def read(text):
    bar = Recorder()
    reader = _Reader(bar)
    for line in text.splitlines():
        reader.read(line)
    return reader, bar.told


def test_how_far_a_run_is():
    reader, told = read(RUN)
    assert told == [
        ("plan", {"views": 1, "fit": 1}),
        ("begin", "5", "resizing its photographs"),
        ("finish", "5", "views"),
        ("begin", "1", "fitting"),
        ("name", "1", "fit"),
        ("go_on", "fit", 0.25),
    ]
    assert reader.failed == ""


def test_a_failure_is_explained_by_the_steps_own_message(tmp_path):
    reader, _ = read(RUN + FAILURE)
    log = tmp_path / "logs/views/cup-64-pad.log"
    log.parent.mkdir(parents=True)
    log.write_text("# cd x && python\nsilmesh: b.png: odd\nsilmesh: a.png: is bad\nand worse\n")
    assert Runner(tmp_path, 1)._explain(reader) == "a.png: is bad\nand worse"
    log.write_text("# cd x && python\nTraceback (most recent call last):\nValueError: 3\n")
    said = Runner(tmp_path, 1)._explain(reader)
    assert said.startswith(f"the step 'views' ended unexpectedly; {log} says how")


def test_a_workflow_that_was_killed_is_told_of(tmp_path):
    said = Runner(tmp_path, 1)._explain(read("")[0], -9)
    assert said == "the workflow was ended by signal 9; the same command goes on from here"


def test_another_run_at_work_is_told_of(tmp_path):
    reader, _ = read("silmesh: another run is at work in /x; wait for its end\n")
    assert Runner(tmp_path, 1)._explain(reader).startswith("another run is at work in /x")


@pytest.mark.parametrize("text", ["", "# command\n", "Traceback\n  silmesh: no\n"])
def test_a_log_without_a_message(tmp_path, text):
    (tmp_path / "log").write_text(text)
    assert _last_message(tmp_path / "log") == ""
