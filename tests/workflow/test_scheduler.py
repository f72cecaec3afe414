"""When Snakemake looks for jobs to start, and which it takes first."""

import itertools
import re
import shutil

import pytest

pytestmark = pytest.mark.slow  # each runs snakemake

RUNS = ("round", "boxed")


def look(project, *arguments: str) -> tuple[int, int]:
    """How often it looked for jobs while it made the runs anew, and how many these were."""
    for run in RUNS:
        shutil.rmtree(project / f"results/cup/{run}")
    wanted = [f"results/cup/{run}/mesh.glb" for run in RUNS]
    said = project.run("--verbose", *arguments, *wanted, cores=1)  # one fit waits for the other
    return said.count("Ready jobs"), said.count("Finished job")


def test_it_looks_when_a_job_has_ended(project):
    project.edit("src/silmesh/steps/fit.py", "    given = _parse(argv)\n", SLOW)
    looks, jobs = look(project)
    assert jobs == 4
    assert looks <= jobs + 1, "once at the start, and once after each job"


def test_a_limit_that_a_person_gives_is_kept(project):
    project.edit("src/silmesh/steps/fit.py", "    given = _parse(argv)\n", SLOW)
    looks, jobs = look(project, "--max-jobs-per-timespan", "1/1s")
    assert jobs == 4
    assert looks > jobs + 1


def test_files_are_read_first_then_one_object_is_finished_after_the_other(fresh):
    fresh.add_object("jug", (22, 15))
    said = fresh.run(cores=1)
    jobs = re.findall(r"^Job \d+: (cup|jug)\S* (.+)", said, re.M)
    read = [what.startswith(("resizing", "finding silhouettes")) for _, what in jobs]
    assert len(jobs) > 20
    assert read == sorted(read, reverse=True)
    assert sum(read) == 4
    assert len(list(itertools.groupby(object_ for object_, _ in jobs[4:]))) == 2


SLOW = """\
    import time

    time.sleep(3)
    given = _parse(argv)
"""
