"""One progress bar over all steps of a run, with the time that is left."""

import re
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from shutil import get_terminal_size
from typing import TextIO

from tqdm import tqdm

# What a step takes on two cores: seconds, and seconds a photograph. They tell the steps apart; how
# fast this machine is follows from those that are done.
SECONDS = {
    "views": (0.5, 0.01),
    "silhouettes": (0.4, 0.004),
    "calibrate": (4.0, 0.05),
    "colmap_features": (1.0, 0.35),
    "colmap_matches": (1.0, 0.3),
    "colmap_map": (1.0, 0.15),
    "colmap": (2.0, 0.05),
    "colmap_attempt": (1.0, 0.15),
    "scene": (1.0, 0.012),
    "judge": (1.0, 0.1),
    "initial": (2.0, 0.01),
    "fit": (4.0, 0.04),
    "fit_outlines": (4.0, 0.04),
    "relief": (4.0, 0.4),
    "colour": (1.0, 0.005),
    "texture": (3.0, 0.15),
    "evaluate": (1.0, 0.005),
    "fetch_weights": (20.0, 0.0),
    "picture": (3.0, 0.02),
    "gallery": (2.0, 0.03),
    "figure": (3.0, 0.0),
}
OTHER = (3.0, 0.0)  # a step that is not listed
NETWORKS = {"matting": 0.6, "deeplab": 0.2}  # seconds a photograph, of silhouettes
LATE = 0.1  # of its usual time: estimate of the rest of a job that takes longer than usual
# Letters of a bar, and of a narrow terminal's; a terminal of WIDE letters gets the long one.
LONG, SHORT, WIDE = 20, 8, 72
START = 5.0  # seconds of work whose speed is assumed to be that of the table at the beginning


@dataclass
class _Job:
    """A job at work: its rule, what it does, when it began, how far it says that it is."""

    rule: str
    what: str
    began: float
    share: float = 0.0


class Bar:
    """Steps done, what is at work, and about how long the rest takes.

    If it is drawn on no terminal, it is a line for each step as that ends, with its time.

    Args:
        views: how many photographs there are
        source: where silhouettes come from
        stream: where it is drawn
    """

    def __init__(self, views: int, source: str, stream: TextIO = sys.stderr):
        self._views, self._source, self._stream = views, source, stream
        self._left: dict[str, int] = {}  # jobs of each rule that are not done
        self._running: dict[int, _Job] = {}  # by their number
        self._done = 0.0  # in seconds of the listed speed
        self._start = time.monotonic()
        self._pace = 1.0  # seconds that pass for one of the listed speed
        self._what = "starting"
        columns = get_terminal_size().columns - 1
        bar = LONG if columns >= WIDE else SHORT
        self._drawn = tqdm(
            total=1.0,
            file=stream,
            disable=None,
            leave=False,
            ncols=columns,
            nrows=20,  # tqdm takes a terminal that does not say its size for one of 0 x 0
            bar_format=f"{{percentage:3.0f}}% |{{bar:{bar}}}| {{desc}}",
        )
        self._room = columns - bar - len("100% || ")

    def plan(self, jobs: Mapping[str, int]) -> None:
        """Set how many jobs of each rule there are to do."""
        self._left, self._done, self._start = dict(jobs), 0.0, time.monotonic()

    def begin(self, job: int, rule: str, what: str) -> None:
        """A job begins."""
        self._running[job] = _Job(rule, what, time.monotonic())
        self._what = what
        self.draw()

    def go_on(self, rule: str, share: float) -> None:
        """A job of a rule says how far it is, from 0 to 1."""
        for job in self._running.values():
            if job.rule == rule:
                job.share = share
        self.draw()

    def finish(self, job: int) -> None:
        """A job ends."""
        ended = self._running.pop(job)
        if self._drawn.disable:
            self.say(f"silmesh: {ended.what}: {time.monotonic() - ended.began:.1f} s")
        if self._left.get(ended.rule):
            self._left[ended.rule] -= 1
            self._done += self._expect(ended.rule)
        passed = time.monotonic() - self._start
        self._pace = (passed + START) / (self._done + START)
        self.draw()

    @property
    def share(self) -> float:
        """How much is done, from 0 to 1, by what the steps usually take."""
        if not (total := self._done + self._waiting):
            return 0.0
        return max(0.0, 1 - self.seconds_left / self._pace / total)

    @property
    def seconds_left(self) -> float:
        """About how long the rest takes, by what that which is done took."""
        running = [job for job in self._running.values() if self._left.get(job.rule)]
        begun = sum(self._expect(job.rule) for job in running)
        waiting = max(0.0, self._waiting - begun) * self._pace
        return waiting + sum(self._rest(job) for job in running)

    def draw(self) -> None:
        """Draw it anew."""
        self._drawn.n = max(self._drawn.n, self.share)  # a second try does not go back
        left = f"about {say_seconds(self.seconds_left)} left: " if self._left else ""
        self._drawn.set_description_str(_fit(f"{left}{self._what}", self._room), refresh=False)
        self._drawn.refresh()

    def say(self, line: str) -> None:
        """Write a line above the bar."""
        tqdm.write(line, file=self._stream)

    def close(self) -> None:
        """Take it away."""
        self._drawn.close()

    @property
    def _waiting(self) -> float:
        """What is not done, in seconds of the listed speed."""
        return sum(self._expect(rule) * count for rule, count in self._left.items())

    def _rest(self, job: _Job) -> float:
        """Seconds until a job at work is done, by what it says, else by what is usual."""
        passed = time.monotonic() - job.began
        if job.share:
            return passed * (1 - job.share) / job.share
        usual = self._expect(job.rule) * self._pace
        return max(usual - passed, LATE * usual)

    def _expect(self, rule: str) -> float:
        base, each = SECONDS.get(rule, OTHER)
        if rule == "silhouettes":
            each = NETWORKS.get(self._source, each)
        return base + each * self._views


def _fit(text: str, room: int) -> str:
    """The text, its end left out if it is too long."""
    return text if len(text) <= room else text[: max(room - 1, 0)].rstrip() + "…"


def say_seconds(seconds: float) -> str:
    """A time in words: ``40 s``, ``3 min``, ``2.5 h``."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def shorten(message: str) -> str:
    """A rule's message without the names of the object, the variant and stages."""
    message = re.sub(r"^[\w-]+(/[\w-]+)?: ", "", message)
    message = re.sub(r" file_\w+$", " a file", message)
    return re.sub(r"( of)? \S*\d+-(pad|stretch)\S*| by \w+$", "", message)
