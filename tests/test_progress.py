import pytest

from silmesh.progress import EVERY, Progress, share_of, within


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    monkeypatch.setenv(EVERY, "5")
    return now


def test_a_line_every_few_seconds_and_one_at_the_end(clock, capsys):
    progress = Progress("fit a/b", total=100)
    for i in range(1, 101):
        clock[0] = i * 0.12
        progress(i, f"loss {1 / i:.2f}")
    assert capsys.readouterr().out.splitlines() == [
        "fit a/b: 42/100, loss 0.02, 7 s left",
        "fit a/b: 84/100, loss 0.01, 2 s left",
        "fit a/b: 100/100, loss 0.01, done in 12.0 s",
    ]


def test_a_short_step_says_only_that_it_is_done(clock, capsys):
    progress = Progress("masks", total=2)
    progress(0)
    progress(2)
    assert capsys.readouterr().out == "masks: 2/2, done in 0.0 s\n"


def test_it_is_quiet_where_nobody_watches(clock, capsys, monkeypatch):
    monkeypatch.delenv(EVERY)
    progress = Progress("masks", total=2)
    progress(2)
    assert capsys.readouterr().out == ""


def test_a_step_that_knows_only_shares_tells_hundredths(clock, capsys):
    progress = share_of("calibrate a")
    for share, now in ((0.25, 6), (0.256, 7), (1.0, 16)):
        clock[0] = now
        progress(share)
    assert capsys.readouterr().out.splitlines() == [
        "calibrate a: 25/100, 18 s left",
        "calibrate a: 100/100, done in 16.0 s",
    ]


def test_a_part_of_a_step_begins_and_ends_within_it():
    told = []
    part = within(told.append, 0.5, 0.75)
    for share in (0, 0.5, 1):
        part(share)
    assert told == [0.5, 0.625, 0.75]
