"""Damaged files give a result or a refusal: some inputs of every reader, and the fuzzer itself."""

import os
import signal

import pytest
from fuzz.readers import Reader, format_of, readers
from fuzz.run import fuzz, make_input, read_input

from silmesh.cameras.formats import FORMATS
from silmesh.errors import InputError

FEW, MANY = 8, 200_000
REFUSED = "weights"  # whose whole files are of another network


def test_every_camera_format_is_fuzzed():
    covered = {format_of(r) for r in readers() if r.name.startswith("cameras")}
    assert covered == set(FORMATS), "a new format needs a maker in fuzz.readers.CAMERAS"


def test_whole_files_are_read(tmp_path):
    wrong = {}
    for reader in readers():
        ending = read_input(reader, reader.files, tmp_path / "case")
        if ending != "result" and not reader.name.startswith(REFUSED):
            wrong[reader.name] = ending
    assert wrong == {}


@pytest.mark.parametrize("reader", readers(), ids=lambda reader: reader.name)
def test_damaged_files(reader):
    count = max(2, round(FEW * reader.share))
    counts, failures = fuzz(reader, 0, range(count))
    assert failures == [], str(failures[0])
    assert sum(counts.values()) == count


@pytest.mark.slow
@pytest.mark.fuzz
def test_many_damaged_files(request):
    if "fuzz" not in request.config.getoption("markexpr"):
        pytest.skip("takes an hour; `bin/test -m fuzz` runs it")
    weight = sum(reader.share for reader in readers())
    for reader in readers():
        _, failures = fuzz(reader, 1, range(round(MANY * reader.share / weight)))
        assert failures == [], str(failures[0])


def test_an_input_is_made_again_from_its_number():
    reader = readers()[0]
    assert make_input(reader, 3, 14) == make_input(reader, 3, 14)
    assert any(make_input(reader, 3, i) != make_input(reader, 4, i) for i in range(3))


def _wrong_type(folder):
    return len(3)


def _crash(folder):
    os.kill(os.getpid(), signal.SIGSEGV)


def _silent(folder):
    raise InputError("cannot be read")


def _greedy(folder):
    return bytearray(9 << 30)


def _endless(folder):
    while True:
        pass


@pytest.mark.parametrize(
    ("read", "why"),
    [
        (_wrong_type, "TypeError"),
        (_crash, "killed"),
        (_silent, "message"),
        (_greedy, "MemoryError"),
        (_endless, "TooSlowError"),
    ],
)
def test_what_the_fuzzer_finds(read, why, monkeypatch):
    monkeypatch.setattr("fuzz.run.SECONDS", 0.2)
    counts, failures = fuzz(Reader("made up", {"a": b"123"}, read), 0, range(3))
    assert counts == {why: 3}
    assert [failure.number for failure in failures] == [0, 1, 2]
    assert "--reader 'made up' --seed 0 --first 1 --inputs 1" in str(failures[1])
