"""Into which rounds photographs may fall: from their names, sizes, times and silhouettes.

A round is a series of photographs between two movements of the camera, or of the object by hand.
Nothing here knows of cameras: what is proposed is tried where cameras are found.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from silmesh.cameras.series import (
    ALIKE,
    LEAST,
    Series,
    alternates,
    find_rounds,
    is_shuffled,
    prepare,
)
from silmesh.errors import InputError
from silmesh.settings.turntable import Turntable
from silmesh.views import View, open_image

MOST = 6  # rounds that are looked for
# Numbers in names, and pauses, tell rounds apart if they are PAUSE times every other one; pauses
# have MINUTE seconds at least.
PAUSE, MINUTE = 5.0, 60.0
SILHOUETTES = "their silhouettes"
EXIF, TAKEN = 0x8769, 36867  # the directory of EXIF in which the time stands
# Two parts of a series differ in height if their means do by so many deviations of the parts.
RISEN = 1.5
PLACES = 3  # at most, at which a series is divided because of what rises there
# The last view repeats the first if it differs from it by at most this share of what neighbours do.
REPEATED = 0.35


@dataclass(frozen=True)
class Signs:
    """What photographs say of themselves beside their pixels, in their order.

    Attributes:
        files: their paths
        sizes: width and height of each, in pixels
        times: when each was taken; None where it does not say
    """

    files: tuple[Path, ...]
    sizes: tuple[tuple[int, int], ...]
    times: tuple[datetime | None, ...]


@dataclass(frozen=True)
class Split:
    """Rounds that photographs may fall in.

    Attributes:
        rounds: the positions of the photographs of each, in the order of its turn
        because: what tells them apart, in words
        by_silhouettes: whether only the silhouettes do
    """

    rounds: tuple[np.ndarray, ...]
    because: str
    by_silhouettes: bool = False


def read_signs(views: Sequence[View]) -> Signs:
    """The signs of photographs; times are read from their EXIF data."""
    return Signs(
        tuple(Path(view.source) for view in views),
        tuple((view.width, view.height) for view in views),
        tuple(read_time(view) for view in views),
    )


def propose(silhouettes: np.ndarray, signs: Signs | None = None) -> list[Split]:
    """Rounds that the photographs may fall in, those that are told most clearly first.

    Args:
        silhouettes: [views, height, width] bool, in their order; empty ones say nothing
        signs: what else the photographs say
    Returns:
        splits into two rounds or more of at least ``LEAST`` views; none where nothing tells any
    """
    found = propose_by_signs(signs) if signs else []
    found += propose_by_silhouettes(silhouettes)
    kept: list[Split] = []
    for split in found:
        if not any(_are_same(split, other) for other in kept):
            kept.append(split)
    return kept


def find_given(
    known: Sequence[Turntable], silhouettes: np.ndarray, signs: Signs | None = None
) -> Split:
    """Where the rounds begin of which something is known.

    Args:
        known: of each round; their numbers of photographs, or their steps, tell where they begin,
            or what the photographs show
        silhouettes, signs: as ``propose`` takes them

    Raises:
        InputError: the photographs are not so many, or do not fall in so many rounds, or those of
            a round are not in order
    """
    found = _divide(known, silhouettes, signs)
    for number, turn in enumerate(found.rounds, start=1):
        if not is_in_order(silhouettes[turn]):
            raise InputError(
                f"cameras 'calibrate': round {number} of the {len(known)} that turntable names "
                f"({found.because}) has {len(turn)} photographs whose neighbours are no more alike "
                "than any two of them: they seem not to be in the order in which they were taken, "
                "or the rounds begin elsewhere; name them in that order, one round after the other"
            )
    return found


def is_in_order(silhouettes: np.ndarray) -> bool:
    """Whether the silhouettes of a round may be in the order in which they were taken."""
    shown = silhouettes[silhouettes.any(axis=(1, 2))]
    return len(shown) < LEAST or not is_shuffled(prepare(shown))


def _divide(known: Sequence[Turntable], silhouettes: np.ndarray, signs: Signs | None) -> Split:
    count, rounds = len(silhouettes), len(known)
    counts = [one.photographs for one in known]
    if None not in counts:
        if sum(counts) != count:
            raise InputError(
                f"cameras 'calibrate': turntable names rounds of {_list(counts)} photographs, "
                f"{sum(counts)} in all, but there are {count}"
            )
        return _split_counts(counts, "as given")
    proposed = propose(silhouettes, signs)
    for split in proposed:
        if len(split.rounds) == rounds and not split.by_silhouettes:
            return split
    if all(one.step for one in known):
        turns = [round(360 / abs(one.step)) for one in known]
        for more, because in ((0, ""), (1, " and the first view again")):
            if sum(turns) + more * rounds == count:
                turned = [views + more for views in turns]
                return _split_counts(turned, f"by their steps: a full turn{because} each")
    for split in proposed:
        if len(split.rounds) == rounds:
            return split
    if not proposed and count % rounds == 0 and count // rounds >= LEAST:
        return _split_counts([count // rounds] * rounds, "in parts of equal numbers of views")
    told = " or ".join(f"{_list(map(len, s.rounds))} by {s.because}" for s in proposed[:2])
    raise InputError(
        f"cameras 'calibrate': turntable names {rounds} rounds, but the {count} photographs "
        + (f"fall in rounds of {told}" if told else "do not tell where each begins")
        + "; name as many rounds as there are, each perhaps with its number of photographs, as in "
        "',5,20,18;,40,20,18'"
    )


def _list(counts: Iterable[int]) -> str:
    return " and ".join(map(str, counts))


def _split_counts(counts: Sequence[int], because: str) -> Split:
    edges = np.cumsum([0, *counts]).tolist()
    return _split([range(*ends) for ends in pairwise(edges)], because)


def propose_by_signs(signs: Signs) -> list[Split]:
    """What names, numbers, sizes and times tell of the rounds, in this order."""
    names = [(str(file.parent), _strip_number(file.stem)[0]) for file in signs.files]
    numbers = [_strip_number(file.stem)[1] for file in signs.files]
    told: list[tuple[str, list[range]]] = [
        ("their folders", split_runs([folder for folder, _ in names])),
        ("their names", split_runs(names)),
        ("gaps in the numbers of their names", split_numbers(numbers)),
        ("their sizes", split_runs(signs.sizes)),
        ("long pauses between them", split_times(signs.times)),
    ]
    return [_split(parts, because) for because, parts in told if _are_rounds(parts)]


def propose_by_silhouettes(silhouettes: np.ndarray) -> list[Split]:
    """What the likeness of silhouettes tells of the rounds."""
    shown = np.flatnonzero(silhouettes.any(axis=(1, 2)))
    if len(shown) < 2 * LEAST:
        return []
    series = prepare(silhouettes[shown])
    whole = len(silhouettes)
    closed = find_rounds(series)
    places = [[int(shown[part.start]) for part in closed[1:]]] if len(closed) > 1 else []
    places += [[int(shown[k])] for k in find_rises(series)]
    found = [
        Split(tuple(np.arange(*ends) for ends in pairwise([0, *edges, whole])), SILHOUETTES, True)
        for edges in places
    ]
    if alternates(series):
        every_other = (np.arange(0, whole, 2), np.arange(1, whole, 2))
        found.insert(0, Split(every_other, f"{SILHOUETTES}, every other one of one round", True))
    return found


def split_runs(keys: Sequence[object]) -> list[range]:
    """Runs of equal keys, as ranges of positions."""
    edges = [0, *(i for i, (a, b) in enumerate(pairwise(keys), start=1) if a != b), len(keys)]
    return [range(*ends) for ends in pairwise(edges)]


def split_numbers(numbers: Sequence[int | None]) -> list[range]:
    """Parts between numbers that fall back, or that leave out many more than the others do."""
    if None in numbers or len(numbers) < 2 * LEAST:
        return [range(len(numbers))]
    steps = np.diff(np.array(numbers, dtype=float))
    back = np.flatnonzero(steps <= 0)
    return _split_at(back if len(back) else _find_long(steps, PAUSE), len(numbers))


def split_times(times: Sequence[datetime | None]) -> list[range]:
    """Parts with long pauses between, if all photographs say when they were taken, in order."""
    if None in times or len(times) < 2 * LEAST:
        return [range(len(times))]
    pauses = np.array([(b - a).total_seconds() for a, b in pairwise(times)])
    if pauses.min() < 0:
        return [range(len(times))]
    parts = _split_at(_find_long(pauses, MINUTE), len(times))
    return parts if min(map(len, parts)) >= LEAST else [range(len(times))]


def find_rises(series: Series) -> list[int]:
    """The views at which a series is best divided into two of different heights, best first.

    Turning changes how wide a silhouette is; raising the camera changes how tall it is, where its
    middle lies and how large it is, of all views that follow.
    """
    scores = np.zeros(len(series))
    for k in range(LEAST, len(series) - LEAST + 1):
        first, second = series.upright[:k], series.upright[k:]
        within = np.sqrt((first.var(axis=0) * k + second.var(axis=0) * len(second)) / len(series))
        rise = np.abs(first.mean(axis=0) - second.mean(axis=0))
        scores[k] = (np.where(rise > ALIKE / 2, rise, 0) / np.maximum(within, 1e-9)).max()
    best = [k for k in np.argsort(-scores, kind="stable") if scores[k] >= RISEN]
    return [int(k) for k in best[:PLACES]]


def repeats_first(silhouettes: np.ndarray) -> bool:
    """Whether the last of a full turn's silhouettes, in order, is the first one again."""
    shown = silhouettes[silhouettes.any(axis=(1, 2))]
    if len(shown) < LEAST or not (silhouettes[0].any() and silhouettes[-1].any()):
        return False
    series = prepare(shown)
    usual = np.percentile(series.steps, 25)
    return bool(usual > ALIKE and series.differences[0, -1] <= REPEATED * usual)


def read_time(view: View) -> datetime | None:
    """When a photograph was taken, if it says so."""
    try:
        with open_image(view.source) as opened:
            return datetime.strptime(
                str(opened.getexif().get_ifd(EXIF)[TAKEN]), "%Y:%m:%d %H:%M:%S"
            )
    except Exception:  # of whatever kind: it has none, or cannot be read
        return None


def _strip_number(stem: str) -> tuple[str, int | None]:
    """A name without its last number, and that number."""
    found = re.fullmatch(r"(.*?)(\d+)(\D*)", stem)
    return (found[1] + found[3], int(found[2])) if found else (stem, None)


def _find_long(gaps: np.ndarray, least: float) -> np.ndarray:
    """Positions of the few gaps, if any, that are ``PAUSE`` times as long as all others."""
    order = np.argsort(-gaps, kind="stable")
    for count in range(1, min(MOST, len(gaps))):
        shortest, next_one = gaps[order[count - 1]], gaps[order[count]]
        if shortest >= max(least, PAUSE * next_one):
            return np.sort(order[:count])
    return np.array([], dtype=int)


def _split_at(gaps: np.ndarray, count: int) -> list[range]:
    return [range(*ends) for ends in pairwise([0, *(gaps + 1).tolist(), count])]


def _are_rounds(parts: Sequence[range]) -> bool:
    return 1 < len(parts) <= MOST and min(map(len, parts)) >= LEAST


def _split(parts: Sequence[range], because: str) -> Split:
    return Split(tuple(np.array(part) for part in parts), because)


def _are_same(one: Split, other: Split) -> bool:
    return len(one.rounds) == len(other.rounds) and all(
        map(np.array_equal, one.rounds, other.rounds)
    )
