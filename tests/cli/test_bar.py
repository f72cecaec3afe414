import io
import re
from pathlib import Path

import pytest

from silmesh.cli.bar import LATE, OTHER, SECONDS, START, Bar, say_seconds, shorten


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    return now


def test_share_and_time_follow_what_steps_usually_take(clock):
    bar = Bar(views=0, source="mask", stream=Terminal())
    views, fit, other = SECONDS["views"][0], SECONDS["fit"][0], OTHER[0]
    bar.plan({"views": 1, "fit": 1, "another": 1})
    assert bar.share == 0
    assert bar.seconds_left == pytest.approx(views + fit + other)
    bar.begin(3, "views", "resizing its photographs")
    clock[0] = 2 * views  # this machine takes twice as long
    bar.finish(3)
    pace = (2 * views + START) / (views + START)
    assert bar.share == pytest.approx(views / (views + fit + other))
    assert bar.seconds_left == pytest.approx((fit + other) * pace)


def test_the_steps_whose_times_are_listed_are_rules():
    """A rule and its step that reports progress go by the same name."""
    rules = Path(__file__).parents[2] / "workflow/rules"
    named = re.findall(
        r"^(?:rule|use rule \w+ as) (\w+)\b",
        "".join(f.read_text() for f in rules.glob("*.smk")),
        re.M,
    )
    assert set(SECONDS) <= set(named)
    steps = Path(__file__).parents[2] / "src/silmesh/steps"
    told = re.findall(r'share_of\(f"(\w+) ', "".join(f.read_text() for f in steps.glob("*.py")))
    assert told
    assert set(told) <= set(named)


def test_a_step_at_work_counts_by_the_clock_until_it_says_how_far_it_is(clock):
    bar = Bar(views=0, source="mask", stream=Terminal())
    fit = SECONDS["fit"][0]
    bar.plan({"fit": 1})
    bar.begin(1, "fit", "fitting")
    clock[0] = fit / 4
    assert bar.seconds_left == pytest.approx(0.75 * fit)
    assert bar.share == pytest.approx(0.25)
    clock[0] = 5 * fit  # late: it may end at any time
    assert bar.seconds_left == pytest.approx(LATE * fit)
    bar.go_on("fit", 0.5)
    assert bar.seconds_left == pytest.approx(5 * fit)
    bar.finish(1)
    assert bar.share == 1
    assert bar.seconds_left == 0


def test_what_is_drawn(clock):
    terminal = Terminal()
    bar = Bar(views=0, source="mask", stream=terminal)
    bar.plan({"fit": 2})
    bar.begin(1, "fit", "fitting")
    bar.finish(1)
    bar.begin(2, "fit", "evaluating")
    bar.close()
    assert "\n" not in terminal.getvalue()  # no line for a stage beside the bar
    drawn = [line.rstrip() for line in terminal.getvalue().split("\r")]
    assert f"  0% |{' ' * 20}| about {2 * SECONDS['fit'][0]:.0f} s left: fitting" in drawn
    assert any(re.match(r" 50% \|.{20}\| about \d+ s left: evaluating", line) for line in drawn)


def test_a_narrow_terminal_has_room_for_the_time(clock, monkeypatch):
    monkeypatch.setenv("COLUMNS", "41")
    terminal = Terminal()
    bar = Bar(views=0, source="mask", stream=terminal)
    bar.plan({"fit": 1})
    bar.begin(1, "fit", "making something of a long name")
    bar.close()
    drawn = [line.rstrip() for line in terminal.getvalue().split("\r")]
    assert f"  0% |{' ' * 8}| about 4 s left: making…" in drawn
    assert max(map(len, drawn)) <= 40


def test_where_nobody_watches_it_is_a_line_a_stage_with_its_time(clock):
    stream = io.StringIO()
    bar = Bar(views=3, source="mask", stream=stream)
    bar.plan({"fit": 1, "judge": 1})
    bar.begin(1, "fit", "fitting")
    bar.begin(2, "judge", "judging its views")
    bar.go_on("fit", 0.5)
    assert stream.getvalue() == ""
    clock[0] = 3.25
    bar.finish(2)
    assert stream.getvalue() == "silmesh: judging its views: 3.2 s\n"
    bar.say("a line")
    clock[0] = 140
    bar.finish(1)
    bar.close()
    lines = ["silmesh: judging its views: 3.2 s", "a line", "silmesh: fitting: 140.0 s"]
    assert stream.getvalue().splitlines() == lines
    assert "\r" not in stream.getvalue()


def test_a_network_takes_its_time():
    slow, quick = (Bar(100, source, io.StringIO()) for source in ("matting", "mask"))
    for bar in (slow, quick):
        bar.plan({"silhouettes": 1})
    assert slow.seconds_left > 50 * quick.seconds_left


@pytest.mark.parametrize(
    ("seconds", "said"), [(12.4, "12 s"), (99.9, "100 s"), (100, "2 min"), (9000, "2.5 h")]
)
def test_times_in_words(seconds, said):
    assert say_seconds(seconds) == said


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ("cup: resizing its photographs", "resizing its photographs"),
        ("cup/mesh: fitting", "fitting"),
        ("cup: cameras from file_36f09b3b", "cameras from a file"),
        ("cup: finding cameras from silhouettes by threshold", "finding cameras from silhouettes"),
        (
            "cup: making the initial mesh 256-pad-mask-calibrate-keep-3-hull",
            "making the initial mesh",
        ),
        ("cup: drawing the cameras of 256-pad-mask-calibrate", "drawing the cameras"),
        ("fetching the weights of isnet, unless the cache has them",) * 2,
    ],
)
def test_messages_without_keys(message, said):
    assert shorten(message) == said
