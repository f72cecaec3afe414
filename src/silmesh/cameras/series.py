"""What a series of silhouettes says of itself: rounds, order, and views that do not belong.

Nothing is known of the cameras here. Photographs of a turn change little from one to the next, and
the last of a full round is a neighbour of its first. Differences are 1 - IoU of two silhouettes.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

LEAST = 5  # least number of views of a round
# A round is closed if its first and last view differ by at most this times the third quartile of
# the differences between neighbours.
CLOSED = 1.4
# Views are in order if neighbours differ, in the median, by less than this share of the median
# difference of any two views.
NEAR = 0.8
# A round is seen from another height than the one before if its least rise over that, in any view,
# is at least this share of its mean rise. RISEN_UNEQUAL is for rounds of different lengths.
RISEN = 0.35
RISEN_UNEQUAL = 0.6
NOTICED = 0.02  # a mean rise below this share of the object's size or area counts as none
# Two rounds turn alike if their silhouettes' columns differ by less than this share of what the
# turn changes in them.
MATCHED = 0.3
ALIKE = 0.03  # silhouettes whose difference is below this say nothing about their order
# Views are shuffled if neighbours differ by more than this times the difference of similar views.
SHUFFLED = 1.5
# Two series are interleaved if every other view differs by less than this share of the difference
# between neighbours.
ALTERNATE = 0.6
# A view is a stray if it differs from both neighbours by more than this times the difference of
# these from each other, and times the median difference of neighbours.
STRAY = 2.0
# A gap is a difference of neighbours larger than this times the two beside it, and the median.
GAP = 3.0


@dataclass(frozen=True)
class Series:
    """Silhouettes in their order, prepared.

    Attributes:
        differences: [views, views], 1 - IoU
        across: [views, 2] mean and deviation of the columns, in pixels
        upright: [views, 3] deviation of the rows and mean row, in sizes of the object, and the
            logarithm of the area: what changes when a camera is raised
    """

    differences: np.ndarray
    across: np.ndarray
    upright: np.ndarray

    def __len__(self) -> int:
        return len(self.differences)

    def part(self, low: int, high: int) -> "Series":
        """Its views from one position to before another."""
        views = slice(low, high)
        return Series(self.differences[views, views], self.across[views], self.upright[views])

    @property
    def steps(self) -> np.ndarray:
        """[views - 1] the difference of each view from the next."""
        return np.diagonal(self.differences, 1)


def prepare(silhouettes: np.ndarray) -> Series:
    """Measure silhouettes, [views, height, width] bool, of which none is empty."""
    flat = silhouettes.reshape(len(silhouettes), -1).astype(np.float32)
    both, area = flat @ flat.T, flat.sum(axis=1)
    differences = 1 - both / (area[:, None] + area - both)
    rows, row = _spread(silhouettes.sum(axis=2))
    columns, column = _spread(silhouettes.sum(axis=1))
    size = np.median(np.hypot(rows, columns))
    upright = np.stack([rows / size, row / size, np.log(area)], axis=1)
    return Series(differences, np.stack([column, columns], axis=1), upright)


def _spread(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Deviation and mean of the places along an axis, from the pixels at each: [views, length]."""
    position, total = np.arange(counts.shape[1]) + 0.5, counts.sum(axis=1)
    mean = counts @ position / total
    return np.sqrt(np.maximum(counts @ position**2 / total - mean**2, 0)), mean


def find_rounds(series: Series) -> list[range]:
    """The rounds that the views fall in, one after the other; all views if they are one.

    Each of several is closed, its last view a neighbour of its first, and seen from another height
    than the one before. Rounds of equally many views are looked for first: where they differ there
    are many places where one may end, and more must speak for it.
    """
    count = len(series)
    for rounds in (2, 3, 4):
        edges = [round(count * k / rounds) for k in range(rounds + 1)]
        parts = [range(*ends) for ends in pairwise(edges)]
        if all(is_closed(series, part) for part in parts) and all(
            _is_another_round(series, *pair) for pair in pairwise(parts)
        ):
            return parts
    return _split(series, range(count))


def _split(series: Series, part: range) -> list[range]:
    """The rounds of a part: it in two at the best place, each of these again."""
    positions = range(part.start + LEAST, part.stop - LEAST + 1)
    pairs = [(range(part.start, k), range(k, part.stop)) for k in positions]
    pairs = [
        pair
        for pair in pairs
        if all(is_closed(series, side) and _is_dense(series, side) for side in pair)
    ]
    rise, _, best = max(
        ((_measure_rise(series, *pair), -pair[0].stop, pair) for pair in pairs),
        default=(0.0, 0, ()),
    )
    if rise < RISEN_UNEQUAL:
        return [part]
    return [found for side in best for found in _split(series, side)]


def is_closed(series: Series, part: range) -> bool:
    """Whether the ends of a part differ by what its neighbours do, as in a full turn."""
    if len(part) < LEAST:
        return False
    usual = np.percentile(series.steps[part.start : part.stop - 1], 75)
    return bool(series.differences[part.start, part.stop - 1] <= CLOSED * max(usual, ALIKE / 2))


def _is_dense(series: Series, part: range) -> bool:
    """Whether neighbours differ by less than any two views, unless all are alike."""
    inside = series.differences[part.start : part.stop, part.start : part.stop]
    any_two = np.median(inside[np.triu_indices_from(inside, 1)])
    return bool(np.median(np.diagonal(inside, 1)) < NEAR * any_two or any_two < ALIKE)


@dataclass(frozen=True)
class _Laid:
    """Two rounds laid on each other by what turning changes, which is where silhouettes lie across.

    Attributes:
        rise: [views, 3], by how much the second differs in ``upright``
        missed: by how much they differ across, of what turning changes there
        changed: the difference of a view from the one that it lies on, usually
    """

    rise: np.ndarray
    missed: float
    changed: float


def _lay(series: Series, first: range, second: range) -> _Laid:
    positions = np.arange(len(second)) * len(first) / len(second)
    wrapped = np.r_[first, first.start]

    def take(values: np.ndarray, at: np.ndarray) -> np.ndarray:
        rounded = np.arange(len(wrapped))
        return np.stack([np.interp(at, rounded, v[wrapped]) for v in values.T], axis=1)

    def miss(at: np.ndarray) -> float:
        off = take(series.across, at) - series.across[second]
        return float((off - off.mean(axis=0)).std())

    ways = [
        (way * positions + start) % len(first) for start in range(len(first)) for way in (1, -1)
    ]
    at = min(ways, key=miss)
    turned = (series.across[second] - series.across[second].mean(axis=0)).std()
    return _Laid(
        series.upright[second] - take(series.upright, at),
        miss(at) / max(float(turned), 1e-9),
        float(np.median(series.differences[wrapped[at.round().astype(int)], second])),
    )


def _measure_rise(series: Series, first: range, second: range) -> float:
    """How alike in all views two rounds differ in height: the least rise as a share of the mean."""
    rise = _lay(series, first, second).rise
    mean = rise.mean(axis=0)
    least = (rise * np.sign(mean)).min(axis=0) / np.maximum(np.abs(mean), 1e-9)
    return float(np.where(np.abs(mean) > NOTICED, least, 0).max())


def _is_another_round(series: Series, first: range, second: range) -> bool:
    """Whether a round is seen from another height than the one before.

    It rises over that in every view; or it turns alike, and differs otherwise.
    """
    laid = _lay(series, first, second)
    usual = np.median(series.steps[second.start : second.stop - 1])
    alike = laid.missed < MATCHED and laid.changed > max(usual / 3, ALIKE)
    return alike or _measure_rise(series, first, second) >= RISEN


def is_shuffled(series: Series) -> bool:
    """Whether neighbours differ as any two views do, and others are far more alike.

    The most like one is left out, since a body may look the same from behind.
    """
    if len(series) < LEAST:
        return False
    usual, ordered = np.median(series.steps), np.sort(series.differences, axis=1)
    any_two, second = np.median(ordered[:, 1:]), np.median(ordered[:, 2])  # after the view itself
    return bool(usual > max(SHUFFLED * second, NEAR * any_two, ALIKE))


def alternates(series: Series) -> bool:
    """Whether every other view is nearer than the next: two series that were taken together."""
    if len(series) < 2 * LEAST:
        return False
    every_other = np.median(np.diagonal(series.differences, 2))
    return bool(every_other < ALTERNATE * np.median(series.steps) > ALTERNATE * ALIKE)


def find_strays(series: Series) -> list[int]:
    """The views that differ from both neighbours by far more than these from each other."""
    steps = series.steps
    around = np.diagonal(series.differences, 2)  # of a view's neighbours
    least = np.maximum(STRAY * around, max(STRAY * np.median(steps), ALIKE))
    return (1 + np.flatnonzero(np.minimum(steps[:-1], steps[1:]) > least)).tolist()


def find_gaps(series: Series) -> list[int]:
    """The views before which the silhouettes change far more than elsewhere, once."""
    steps = series.steps
    if len(steps) < LEAST:
        return []
    beside = np.maximum(np.r_[0, steps[:-1]], np.r_[steps[1:], 0])
    least = GAP * np.maximum(beside, max(np.median(steps), ALIKE))
    return (1 + np.flatnonzero(steps > least)).tolist()
