"""A step's log ends with what it used: of its own work, also where it is a fork."""

import subprocess
import sys

import pytest

from silmesh.planning.usage import Usage, measure_usage, read_usage

WORK = """
import sys, time
from silmesh.planning.usage import measure_usage
began, end = time.monotonic(), time.process_time() + 0.3
block = bytearray(200_000_000)
block[::4096] = b"1" * len(block[::4096])
while time.process_time() < end:
    pass
print(measure_usage(began))
"""


@pytest.mark.parametrize("gpu", [0.0, 312.0])
def test_what_is_written_is_read(tmp_path, gpu):
    log, usage = tmp_path / "fit.log", Usage(20.1, 812.0, gpu, 12.3)
    log.write_text(f"# cd here && fit\nsilmesh: a word\n{usage}\n")
    assert read_usage(log) == usage


def test_a_step_that_failed_has_not_said_what_it_used(tmp_path):
    log = tmp_path / "fit.log"
    log.write_text("# cd here && fit\nsilmesh: no such file\n")
    assert read_usage(log) is None


def test_it_measures_memory_and_processor_time(tmp_path):
    log = tmp_path / "work.log"
    log.write_text(
        subprocess.run([sys.executable, "-c", WORK], capture_output=True, text=True).stdout
    )
    usage = read_usage(log)
    assert 0.3 <= usage.processor < 30
    assert 200 < usage.memory < 400
    assert usage.seconds > 0
    assert usage.gpu == measure_usage(0).gpu == 0
