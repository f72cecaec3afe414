"""Which views of a turntable agree with each other, where some silhouettes are wrong.

Random sample consensus (Fischler and Bolles 1981) over views: a geometry is found from a few views
alone, every view is judged by it, and those that agree find it anew (local optimisation, Chum,
Matas and Kittler 2003), until they stay the same. Photographs of a turn change slowly, so views
whose silhouettes jump between their neighbours are drawn last (as in PROSAC, Chum and Matas 2005).

How far a view disagrees is measured against the body that the views which agree allow:

    own      the rays through the view's outline miss that body: it shows what is not there
    denied   the rays through another view's outline, which touch that body, miss the view's
             silhouette: it lacks what is there

each as a root mean square over the rays of one outline, in pixels; of ``denied`` the most that any
other view's outline has, since a part that is lacking lies on the outlines of few.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from silmesh.cameras.silhouette_coherence import Outlines
from silmesh.cameras.turntable_residuals import Turntable
from silmesh.progress import Share, untold, within

FEWEST = 6  # views; of fewer none can be told to be wrong
HALF = 0.55  # of the views: those nearest to a geometry, by which it is judged and found anew
SAMPLE, SAMPLES = 9, 8  # views of a sample, half the views at most; samples drawn at most
TIGHT = 0.25  # pixels: when HALF of the views disagree by less, no other samples are drawn
JUDGES, RAYS = 16, 16  # views that agree, by which views are judged; rays of each
WRONG = 8  # one judge of so many may be wrong
ROUNDS, STEPS = 4, 12  # of local optimisation; evaluations of the residuals in each
NEIGHBOURS = 3  # on each side, between which a silhouette should lie
# Pixels by which a view may disagree in any case, with some judges unheard, and with all heard.
LEAST, TRUSTING = 0.25, 0.5
SPREAD, QUANTILE = 3.0, 0.3  # it may by so many times what this share of the views does


@dataclass(frozen=True)
class Consensus:
    """What views agree on.

    Attributes:
        x: the parameters of ``Turntable``, without offsets
        pixels: [views], by how much each view disagrees
        agrees: [views] bool
    """

    x: np.ndarray
    pixels: np.ndarray
    agrees: np.ndarray

    @property
    def spread(self) -> float:
        """Pixels by which ``HALF`` of the views disagree at most."""
        return float(np.quantile(self.pixels, HALF))

    def nearest(self) -> np.ndarray:
        """Positions of the views that disagree least, sorted."""
        count = max(FEWEST, math.ceil(HALF * len(self.pixels)))
        return np.sort(np.argsort(self.pixels, kind="stable")[:count])


def find_consensus(
    turn: Turntable,
    search: Callable[[Turntable, Share], np.ndarray],
    free: np.ndarray,
    limit: float,
    random: np.random.Generator,
    progress: Share = untold,
) -> Consensus:
    """Find the geometry that most views agree on.

    Args:
        turn: all views that have an outline, at least ``FEWEST``
        search: finds the parameters of some views from nothing, and tells which share is done
        free: positions of the parameters that may change, without offsets
        limit: pixels from which a view disagrees in any case
        progress: is told which share is done, if all samples have to be drawn
    """
    suspicion, best = suspect(turn.outlines), None
    for attempt in range(SAMPLES):
        sample = _draw(suspicion, random if attempt else None)
        told = within(progress, attempt / SAMPLES, (attempt + 1) / SAMPLES)
        found = _optimise(turn, search(turn.select(sample), told), sample, free, limit)
        if best is None or found.spread < best.spread:
            best = found
        if best.spread <= TIGHT:
            break
    return _settle(turn, best, free, limit)


def agree_on(
    turn: Turntable, x: np.ndarray, believed: np.ndarray, free: np.ndarray, limit: float
) -> Consensus:
    """What most views agree on, from parameters that some of them gave.

    Args:
        believed: positions of the views that gave them
        free, limit: as ``find_consensus`` takes them
    """
    return _settle(turn, _optimise(turn, x, believed, free, limit), free, limit)


def _settle(turn: Turntable, found: Consensus, free: np.ndarray, limit: float) -> Consensus:
    """What all that agree say, without those that do not agree with all the others."""
    if found.agrees.sum() < FEWEST:
        return found
    return _prune(turn, _refit(turn, found, np.flatnonzero(found.agrees), free, limit), limit)


def judge(
    turn: Turntable, x: np.ndarray, agreeing: np.ndarray, limit: float, trusting: bool = False
) -> Consensus:
    """Judge all views by those that agree.

    Args:
        x: parameters, of which offsets are left out
        agreeing: positions of the views that agree so far
        limit: pixels from which a view disagrees in any case
        trusting: whether all that agree so far are heard; otherwise the worst of what one in
            ``WRONG`` of them says is not
    """
    x, judges = x[: turn.shared], thin_out(agreeing, JUDGES)
    unheard = 0 if trusting else len(judges) // WRONG
    pixels = [_disagreement(turn, x, view, judges, unheard) for view in range(len(turn.index))]
    least = TRUSTING if trusting else LEAST
    allowed = min(max(least, SPREAD * np.quantile(pixels, QUANTILE)), limit)
    return Consensus(x, np.array(pixels), np.array(pixels) <= allowed)


def suspect(outlines: Outlines) -> np.ndarray:
    """By how much each silhouette jumps between its neighbours, in usual jumps: [views].

    Of its box's sides, in pixels, and of the square root of its area, whichever jumps most.
    """
    low, high = outlines.points.min(axis=1), outlines.points.max(axis=1)
    side = np.sqrt((outlines.distances > 0).sum(axis=(1, 2)))
    shown = np.column_stack([low, high, side])
    jumps = np.zeros_like(shown)
    for view in range(len(shown)):
        around = np.arange(max(view - NEIGHBOURS, 0), min(view + NEIGHBOURS + 1, len(shown)))
        jumps[view] = shown[view] - np.median(shown[around[around != view]], axis=0)
    return (np.abs(jumps) / (np.median(np.abs(jumps), axis=0) + LEAST)).max(axis=1)


def thin_out(views: np.ndarray, most: int) -> np.ndarray:
    """At most so many of some views, evenly."""
    if len(views) <= most:
        return views
    return views[np.linspace(0, len(views), most, endpoint=False).astype(int)]


def _draw(suspicion: np.ndarray, random: np.random.Generator | None) -> np.ndarray:
    """A view of each part of the turn: the least suspected, or by chance, sorted."""
    views = len(suspicion)
    parts = int(np.clip(views // 2, FEWEST, SAMPLE))
    first = 0 if random is None else random.integers(views)
    edges = np.linspace(0, views, parts + 1).round().astype(int)
    sample = []
    for low, high in pairwise(edges):
        part = (first + np.arange(low, high)) % views
        trust = (suspicion[part] + 0.5) ** -2
        one = trust.argmax() if random is None else random.choice(len(part), p=trust / trust.sum())
        sample.append(part[one])
    return np.sort(sample)


def _optimise(
    turn: Turntable, x: np.ndarray, sample: np.ndarray, free: np.ndarray, limit: float
) -> Consensus:
    """Let the views that agree best find the geometry anew, as long as they agree better then."""
    found = judge(turn, x, sample, limit)
    for _ in range(ROUNDS):
        again = _refit(turn, found, found.nearest(), free, limit)
        if again.spread >= found.spread:
            break
        found = again
    return found


def _refit(
    turn: Turntable, found: Consensus, views: np.ndarray, free: np.ndarray, limit: float
) -> Consensus:
    part = turn.select(views).thin()
    return judge(turn, part.fit(part.widen(found.x), free, STEPS).x, views, limit)


def _prune(turn: Turntable, found: Consensus, limit: float) -> Consensus:
    """Judge by all views that agree, and leave out the worst until all do."""
    agreeing = np.flatnonzero(found.agrees)
    while len(agreeing) >= FEWEST:
        strict = judge(turn, found.x, agreeing, limit, trusting=True)
        pixels = strict.pixels[agreeing]
        wrong = ~strict.agrees[agreeing] & (pixels > pixels.max() / 2)
        if not wrong.any():
            return strict
        agreeing = agreeing[~wrong]
    return found


def _disagreement(
    turn: Turntable, x: np.ndarray, view: int, judges: np.ndarray, unheard: int
) -> float:
    others = judges[judges != view]
    every = max(1, turn.outlines.known.shape[1] // RAYS)
    part = turn.select(np.concatenate([[view], others]), every)
    misses = part.misses(part.widen(x))
    squares = misses.pixels**2
    own = np.array([squares[0, misses.view[0] == j + 1].sum() for j in range(len(others))])
    denied = np.where(misses.view[1:] == 0, squares[1:], 0).mean(axis=1)
    heard = len(others) - unheard
    own, denied = np.sort(own)[:heard].sum() / squares.shape[1], np.sort(denied)[heard - 1]
    return float(np.sqrt(max(own, denied)))
