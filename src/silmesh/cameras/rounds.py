"""Into which rounds photographs may fall: from their names, sizes, times and silhouettes.

A round is a series of photographs between two movements of the camera, or of the object by hand.
Nothing here knows of cameras: what is proposed is tried where cameras are found.
"""

import os
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy import ndimage

from silmesh.cameras.series import (
    ALIKE,
    LEAST,
    Series,
    alternates,
    find_rounds,
    is_closed,
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
EVENLY = "in parts of equal numbers of views"
SILHOUETTES = "by their silhouettes"
EXIF, TAKEN = 0x8769, 36867  # the directory of EXIF in which the time stands
# Scores from which a series may be divided where it rises, and from which it clearly is (those of
# one round reach 6); a difference of two views counts MOST_JUMP times at most.
RISEN, CLEARLY_RISEN, MOST_JUMP = 4.0, 8.0, 8.0
# A view that differs from the median of so many around it by more than ODD times what most do is
# taken to be like them where rises are looked for: its silhouette is rather wrong.
NEARBY, ODD = 5, 6.0
SAME_HEIGHT = 0.004  # differences of heights, in sizes of the object, that say nothing
AGREEING = 0.6  # by so much the share of views that agree is larger in a round than outside
FULL_TURN = 8  # views of a full turn at least, if it is found in a part of the photographs
PLACES = 2  # at most beside the best, at which a series is divided in two
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
        clear: whether it is told clearly, so that one round alone hardly shows the same
    """

    rounds: tuple[np.ndarray, ...]
    because: str
    by_silhouettes: bool = False
    clear: bool = True


def read_signs(views: Sequence[View]) -> Signs:
    """The signs of photographs; times are read from their EXIF data."""
    return Signs(
        _find_own([Path(view.source) for view in views]),
        tuple((view.width, view.height) for view in views),
        tuple(read_time(view) for view in views),
    )


def _find_own(files: Sequence[Path]) -> tuple[Path, ...]:
    """The files; of links that all lie in one folder those that they lead to, in their folders."""
    alone = len({file.parent for file in files}) < 2
    led = [file.parent / os.readlink(file) if file.is_symlink() else file for file in files]
    return tuple(led if alone else files)


def propose(silhouettes: np.ndarray, signs: Signs | None = None) -> list[Split]:
    """Rounds that the photographs may fall in, those that are told most clearly first.

    Args:
        silhouettes: [views, height, width] bool, in their order; empty ones say nothing
        signs: what else the photographs say
    Returns:
        splits into two rounds or more of at least ``LEAST`` views; none where nothing tells any
    """
    found = propose_by_signs(signs) if signs else []
    return _drop_same([*found, *propose_by_silhouettes(silhouettes)])


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
                return _split_counts(turned, f"by their steps, a full turn{because} each")
    for split in proposed:
        if len(split.rounds) == rounds:
            return split
    if not proposed and count % rounds == 0 and count // rounds >= LEAST:
        return _split_counts([count // rounds] * rounds, EVENLY)
    told = " or ".join(f"{_list(map(len, s.rounds))} {s.because}" for s in proposed[:2])
    short = describe_short(signs) if signs else []
    raise InputError(
        f"cameras 'calibrate': turntable names {rounds} rounds, but the {count} photographs "
        + (f"fall in rounds of {told}" if told else "do not tell where each begins")
        + "".join(f"; {sentence}" for sentence in short)
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
    told = [(because, parts) for because, parts in _read_parts(signs) if _are_rounds(parts)]
    return _drop_same([_split(parts, because) for because, parts in told])


def describe_short(signs: Signs, among: Collection[int] | None = None) -> list[str]:
    """A sentence that names a part of the photographs that is too short for a round, if one is.

    Args:
        among: positions, of which all of the part have to be; any if not given
    """
    for because, parts in _read_parts(signs):
        fewest = min(parts, key=len)
        short = 1 < len(parts) <= MOST and len(fewest) < LEAST <= max(map(len, parts))
        if short and (among is None or set(fewest) <= set(among)):
            first, last = signs.files[fewest[0]].name, signs.files[fewest[-1]].name
            return [
                f"{because} the photographs fall in rounds of {_list(map(len, parts))}; one of "
                f"{len(fewest)} ({first!r} to {last!r}) is too short, each takes at least {LEAST}"
            ]
    return []


def _read_parts(signs: Signs) -> list[tuple[str, list[range]]]:
    """The parts that each sign tells, and the sign."""
    names = [(str(file.parent), _strip_number(file.stem)[0]) for file in signs.files]
    numbers = [_strip_number(file.stem)[1] for file in signs.files]
    return [
        ("by their folders", split_runs([folder for folder, _ in names])),
        ("by their names", split_runs(names)),
        ("by gaps in the numbers of their names", split_numbers(numbers)),
        ("by their sizes", split_runs(signs.sizes)),
        ("by long pauses between them", split_times(signs.times)),
    ]


def propose_by_silhouettes(silhouettes: np.ndarray) -> list[Split]:
    """What the likeness of silhouettes tells of the rounds."""
    shown = np.flatnonzero(silhouettes.any(axis=(1, 2)))
    if len(shown) < 2 * LEAST:
        return []
    series = prepare(silhouettes[shown])
    whole = len(silhouettes)
    closed = find_rounds(series)
    told = [([part.start for part in closed[1:]], True)] if len(closed) > 1 else []
    told += [(edges, score >= CLEARLY_RISEN) for score, edges in find_rises(series)]
    found = []
    if alternates(series):
        every_other = (np.arange(0, whole, 2), np.arange(1, whole, 2))
        found.append(Split(every_other, f"{SILHOUETTES}, every other one of one round", True))
    for edges, clear in told:
        parts = pairwise([0, *shown[edges].tolist(), whole])
        found.append(Split(tuple(np.arange(*ends) for ends in parts), SILHOUETTES, True, clear))
    return found


def are_full_turns(split: Split, silhouettes: np.ndarray) -> bool:
    """Whether every round of a split ends where it began."""
    shown = silhouettes.any(axis=(1, 2))
    series = [prepare(silhouettes[turn[shown[turn]]]) for turn in split.rounds if shown[turn].any()]
    return all(is_closed(one, range(len(one))) for one in series)


def divide_evenly(silhouettes: np.ndarray) -> list[Split]:
    """Two or three full turns of equal numbers of views, where nothing tells their heights."""
    count = len(silhouettes)
    if not silhouettes.any(axis=(1, 2)).all():
        return []
    series = prepare(silhouettes)
    even = [
        [range(k * count // rounds, (k + 1) * count // rounds) for k in range(rounds)]
        for rounds in (2, 3)
        if count % rounds == 0 and count // rounds >= FULL_TURN
    ]
    turns = [parts for parts in even if all(is_closed(series, part) for part in parts)]
    return [replace(_split(parts, EVENLY), by_silhouettes=True, clear=False) for parts in turns]


def divide_by_agreement(agrees: np.ndarray) -> list[Split]:
    """The rounds of which one is a run of views that agree on a turn, [views] bool, and most of it.

    Or every other view, if those and no others agree.
    """
    count = len(agrees)
    every_other = np.arange(0, count, 2), np.arange(1, count, 2)
    if abs(agrees[every_other[0]].mean() - agrees[every_other[1]].mean()) >= AGREEING:
        return [Split(every_other, "by which agree, every other one", True, False)]
    gains = np.concatenate([[0], np.where(agrees, 1, -1).cumsum()])
    low, high = max(
        ((a, b) for a in range(count) for b in range(a + FULL_TURN, count + 1)),
        key=lambda ends: gains[ends[1]] - gains[ends[0]],
        default=(0, count),
    )
    outside = np.r_[agrees[:low], agrees[high:]]
    parts = [range(*ends) for ends in pairwise(sorted({0, low, high, count}))]
    if not _are_rounds(parts) or agrees[low:high].mean() < AGREEING + outside.mean():
        return []
    return [Split(tuple(map(np.array, parts)), "by which views agree", True, False)]


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


def find_rises(series: Series) -> list[tuple[float, list[int]]]:
    """Views at which a series is best divided into parts of different heights, and a score of each.

    Turning changes how wide a silhouette is; raising the camera changes how tall it is, where its
    middle lies and how large it is, at once and in all views that follow. A place is scored by how
    much the means on both sides differ, in deviations within them, times how much the two views
    there do, in usual differences of neighbours. Single views that differ from all around them have
    no say.
    """
    upright = _smooth_odd(series.upright)
    whole = _rank_rises(upright, 0, len(series))
    places = [(score, place) for score, place in whole if score >= RISEN]
    if not places:
        return []
    score, best = places[0]
    by_rises = _divide_again(upright, [0, best, len(series)])
    by_turns = _find_turns(series, [0, best, len(series)])
    several = [(score, edges) for edges in (by_rises, by_turns) if len(edges) > 1]
    apart = [(less, [place]) for less, place in places if abs(place - best) > LEAST][:PLACES]
    return [*several, (score, [best]), *apart]


def _smooth_odd(upright: np.ndarray) -> np.ndarray:
    """The same with views that differ from all around them in any column as the median of these.

    Where a round begins, most around each view are of its own.
    """
    around = ndimage.median_filter(upright, (NEARBY, 1), mode="nearest")
    off = np.abs(upright - around)
    odd = (off > ODD * (np.quantile(off, 0.75, axis=0) + SAME_HEIGHT)).any(axis=1)
    return np.where(odd[:, None], around, upright)


def _find_turns(series: Series, edges: Sequence[int]) -> list[int]:
    """The places at which a series is divided, with those at which a part's full turns end."""
    found = set(edges[1:-1])
    for low, high in pairwise(edges):
        turns = find_rounds(series.part(low, high))
        if min(map(len, turns)) >= FULL_TURN:
            found |= {low + part.start for part in turns[1:]}
    return sorted(found)


def _divide_again(upright: np.ndarray, edges: list[int]) -> list[int]:
    """The places at which a series is divided, with those at which its parts clearly are."""
    for low, high in pairwise(edges):
        ranked = _rank_rises(upright, low, high)
        if ranked and ranked[0][0] >= CLEARLY_RISEN and len(edges) <= MOST:
            return _divide_again(upright, sorted([*edges, ranked[0][1]]))
    return edges[1:-1]


def _rank_rises(upright: np.ndarray, low: int, high: int) -> list[tuple[float, int]]:
    """Scores of the places at which a part may be divided, the best first."""
    part, count = upright[low:high], high - low
    if count < 2 * LEAST:
        return []
    jumps = np.abs(np.diff(part, axis=0))
    usual = np.quantile(jumps, 0.75, axis=0) + SAME_HEIGHT
    ranked = []
    for k in range(LEAST, count - LEAST + 1):
        first, second = part[:k], part[k:]
        within = np.sqrt((first.var(axis=0) * k + second.var(axis=0) * (count - k)) / count)
        apart = np.abs(first.mean(axis=0) - second.mean(axis=0)) / (within + SAME_HEIGHT)
        balance = 2 * np.sqrt(k * (count - k)) / count
        scores = apart * balance * np.minimum(jumps[k - 1] / usual, MOST_JUMP)
        ranked.append((float(scores.max()), low + k))
    return sorted(ranked, reverse=True)


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


def _drop_same(splits: Sequence[Split]) -> list[Split]:
    """Those that none before has the rounds of."""
    kept: list[Split] = []
    for split in splits:
        if not any(_are_same(split, other) for other in kept):
            kept.append(split)
    return kept


def _are_same(one: Split, other: Split) -> bool:
    return len(one.rounds) == len(other.rounds) and all(
        map(np.array_equal, one.rounds, other.rounds)
    )
