"""One progress bar over all steps of a run, with the time that is left."""

import re
import sys
import time
from collections.abc import Mapping
from typing import TextIO

from tqdm import tqdm

# What a step takes on two cores: seconds, and seconds a photograph. They tell the steps apart; how
# fast this machine is follows from those that are done.
SECONDS = {
    "views": (1.5, 0.01),
    "silhouettes": (1.5, 0.02),
    "calibrate": (6.0, 0.05),
    "colmap_features": (2.0, 0.35),
    "colmap_matches": (2.0, 0.3),
    "colmap_map": (2.0, 0.15),
    "colmap": (4.0, 0.05),
    "colmap_masked": (4.0, 0.1),
    "scene": (5.0, 0.05),
    "judge": (3.0, 0.15),
    "first": (4.0, 0.02),
    "fit": (8.0, 0.05),
    "colour": (3.0, 0.02),
    "evaluate": (4.0, 0.02),
    "fetch_weights": (20.0, 0.0),
}
OTHER = (3.0, 0.0)  # a step that is not listed
NETWORKS = {"matting": 3.0, "deeplab": 0.2}  # seconds a photograph, of silhouettes
START = 5.0  # seconds of the listed speed that are believed before anything is done


class Bar:
    """Steps done, what is at work, and about how long the rest takes; nothing if no terminal.

    Args:
        views: how many photographs there are
        source: where silhouettes come from
        stream: where it is drawn
    """

    def __init__(self, views: int, source: str, stream: TextIO = sys.stderr):
        self._views, self._source = views, source
        self._left: dict[str, int] = {}  # jobs of each rule that are not done
        self._parts: dict[str, float] = {}  # how far jobs at work are
        self._running: dict[str, str] = {}  # job to what it does
        self._done, self._start = 0.0, time.monotonic()
        self._drawn = tqdm(
            total=1.0,
            file=stream,
            disable=None,
            leave=False,
            nrows=20,  # a terminal that does not say how high it is hides no line
            bar_format="{desc} {percentage:3.0f}% |{bar:20}| {postfix}",
        )

    def plan(self, jobs: Mapping[str, int]) -> None:
        """Set how many jobs of each rule there are to do."""
        self._left, self._done, self._start = dict(jobs), 0.0, time.monotonic()

    def begin(self, job: str, what: str) -> None:
        """A job begins."""
        self._running[job] = what
        self.draw()

    def go_on(self, rule: str, share: float) -> None:
        """A job of a rule is so far, from 0 to 1."""
        self._parts[rule] = share
        self.draw()

    def finish(self, job: str, rule: str) -> None:
        """A job ends."""
        self._running.pop(job, None)
        self._parts.pop(rule, None)
        if self._left.get(rule):
            self._left[rule] -= 1
            self._done += self._expect(rule)
        self.draw()

    @property
    def share(self) -> float:
        """How much is done, from 0 to 1, by what the steps usually take."""
        done, left = self._amounts()
        return done / (done + left) if done + left else 0.0

    @property
    def seconds_left(self) -> float:
        """About how long the rest takes, by what was done so far took."""
        done, left = self._amounts()
        passed = time.monotonic() - self._start
        return left * (passed + START) / (done + START)

    def draw(self) -> None:
        """Draw it anew."""
        what = list(self._running.values())[-1] if self._running else "starting"
        self._drawn.n = max(self._drawn.n, self.share)  # a second try does not go back
        self._drawn.set_description_str(f"{what:<32.32}", refresh=False)
        left = f"about {say_seconds(self.seconds_left)} left" if self._left else ""
        self._drawn.set_postfix_str(left, refresh=False)
        self._drawn.refresh()

    def say(self, line: str) -> None:
        """Write a line above the bar."""
        tqdm.write(line, file=self._drawn.fp)

    def close(self) -> None:
        """Take it away."""
        self._drawn.close()

    def _amounts(self) -> tuple[float, float]:
        """What is done and what is left, in seconds of the listed speed."""
        begun = sum(self._expect(rule) * share for rule, share in self._parts.items())
        left = sum(self._expect(rule) * count for rule, count in self._left.items())
        return self._done + min(begun, left), left - min(begun, left)

    def _expect(self, rule: str) -> float:
        base, each = SECONDS.get(rule, OTHER)
        if rule == "silhouettes":
            each = NETWORKS.get(self._source, each)
        return base + each * self._views


def say_seconds(seconds: float) -> str:
    """A time in words: ``40 s``, ``3 min``, ``2.5 h``."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def shorten(message: str) -> str:
    """A rule's message without the names of the object, the variant and stages."""
    message = re.sub(r"^[\w-]+(/[\w-]+)?: ", "", message)
    return re.sub(r" \S*\d+-(pad|stretch)\S*| by \w+$", "", message)
