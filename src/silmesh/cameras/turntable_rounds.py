"""A turntable of several rounds: each is found alone, then laid on the ones before it.

The silhouettes of a round alone show its elevation, axis and steps. What lies between two rounds is
one angle, the phase: it is sought over the whole turn, and all parameters are then refined together
by the residuals of ``silmesh.cameras.turntable_residuals``, in which every ray is followed through
the silhouettes of all rounds. As with one round, views that disagree are told from those that agree
(``silmesh.cameras.consensus``), first within each round and then among all.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from silmesh.cameras.consensus import Consensus, agree_on, find_consensus, judge
from silmesh.cameras.turntable_fit import (
    FEWEST_AGREEING,
    HOPELESS,
    REFUSED_AGREEING,
    SUSPECT,
    Given,
    TurntableFit,
    free_parameters,
    search,
    solve,
)
from silmesh.cameras.turntable_residuals import (
    AXIS,
    FARTHER,
    NAMES,
    NOISE,
    OF_FIRST,
    OF_ROUND,
    PHASE,
    ROUND,
    ROW,
    STEP,
    VIEW,
    Turntable,
)
from silmesh.progress import Share, untold, within

PHASES = 36  # over the whole turn, from which a round is laid on the ones before
LAID, LAID_STEPS = 5, 10  # phases that are refined, and evaluations of the residuals in each
FREED_STEPS = 8  # evaluations in which a step that is not known is let go
KEPT = 3  # starts that go on to the next round, and to the fit of all
WORSE = 3.0  # a start goes on if its cost is at most this times the best one
# Shares of the run time after which the rounds are found alone and laid on each other.
ALONE, JOINED = 0.5, 0.7


@dataclass(frozen=True)
class _Alone:
    """A round by itself.

    Attributes:
        turn: its silhouettes
        starts: its parameters, those of ``NAMES`` first; the best before the others
        believed: positions within its views of those that agree with each other
    """

    turn: Turntable
    starts: list[np.ndarray]
    believed: np.ndarray

    @property
    def is_coherent(self) -> bool:
        """Whether all its views may agree."""
        thin = self.turn.thin()
        allowed = HOPELESS * SUSPECT * self.turn.size / 256
        return thin.cost(thin.widen(self.starts[0])) <= allowed


def fit_rounds(
    turn: Turntable, given: Given, fewest: float, sure: bool, progress: Share = untold
) -> tuple[TurntableFit, Consensus | None] | None:
    """Fit several rounds or, if some views contradict the others, those that agree.

    Args:
        turn: with its rounds
        given: what is known of the first and of the ``later`` ones
        fewest: views that have to agree
        sure: whether these are the rounds; if not, one of them has to be coherent by itself
    Returns:
        the fit, and how far the views agree if that had to be asked; None if no round is coherent
        and they are not sure
    """
    suspect, allowed = (limit * turn.size / 256 for limit in (SUSPECT, REFUSED_AGREEING))
    alone = _find_alone(turn, given, sure, within(progress, 0, ALONE))
    if not alone:
        return None
    believed = np.sort(np.concatenate([_views_of(turn, a, i) for i, a in enumerate(alone)]))
    starts = _join(turn.select(believed), alone, given, within(progress, ALONE, JOINED))
    fit = solve(turn.select(believed), starts, given, within(progress, JOINED, 1))
    if len(believed) == len(turn.index) and fit.rms <= suspect:
        return replace(fit, turn=turn), None
    free = free_parameters(turn, given.known)
    verdict = agree_on(turn, fit.best.x, believed, free, allowed)
    if verdict.agrees.sum() < fewest:
        return fit, verdict
    return _fit_agreeing(turn, verdict, given, fewest, allowed) or (fit, verdict)


def _fit_agreeing(
    turn: Turntable, verdict: Consensus, given: Given, fewest: float, allowed: float
) -> tuple[TurntableFit, Consensus | None] | None:
    """The fit of the views that agree; None if they are too few or fit no turntable."""
    part = turn.select(np.flatnonzero(verdict.agrees))
    apart = solve(part, [part.widen(verdict.x)], given)
    if apart.rms > allowed:
        return None
    if verdict.agrees.all():
        return replace(apart, turn=turn), None
    strict = judge(turn, apart.best.x, np.flatnonzero(verdict.agrees), allowed, trusting=True)
    return (apart, strict) if strict.agrees.sum() >= fewest else None


def _find_alone(turn: Turntable, given: Given, sure: bool, progress: Share) -> list[_Alone]:
    """Each round by itself; none if they are not sure and none is coherent."""
    found = []
    for number, known in enumerate((given, *given.later)):
        part, known = turn.round_alone(number), replace(known, later=())
        share = within(progress, number / len(turn.rounds), (number + 1) / len(turn.rounds))
        found.append((_Alone(part, search(part, known, share), np.arange(len(part.index))), known))
    if not sure and not any(alone.is_coherent for alone, _ in found):
        return []
    believed = [
        (alone if alone.is_coherent else _find_believed(alone, known), known)
        for alone, known in found
    ]
    return [alone if known.step else _free_steps(alone) for alone, known in believed]


def _find_believed(alone: _Alone, given: Given) -> _Alone:
    """A round of which some silhouettes may be wrong, by the views that agree, if enough do."""
    turn = alone.turn
    if len(turn.index) < FEWEST_AGREEING:
        return alone
    verdict = find_consensus(
        turn,
        lambda sample, told: search(sample, given, told)[0][: sample.shared],
        free_parameters(turn, given.known),
        REFUSED_AGREEING * turn.size / 256,
        np.random.default_rng(0),
    )
    if verdict.agrees.sum() < FEWEST_AGREEING:
        return alone
    believed = np.flatnonzero(verdict.agrees)
    return _Alone(turn, [verdict.x, *search(turn.select(believed), given)], believed)


def _free_steps(alone: _Alone) -> _Alone:
    """A round whose step is not known, its starts fitted with the step."""
    turn = alone.turn.select(alone.believed).thin()
    free = np.arange(len(NAMES))
    return replace(
        alone, starts=[turn.fit(turn.widen(x), free, FREED_STEPS).x for x in alone.starts]
    )


def _views_of(turn: Turntable, alone: _Alone, number: int) -> np.ndarray:
    """Where the believed views of a round stand among all."""
    positions = turn.rounds[number][alone.turn.index[alone.believed]]
    return np.flatnonzero(np.isin(turn.index, positions))


def _join(
    turn: Turntable, alone: Sequence[_Alone], given: Given, progress: Share
) -> list[np.ndarray]:
    """Lay each round on the ones before it: parameters of all rounds, the best first."""
    starts = [x[: len(NAMES)] for x in alone[0].starts]
    known = (given, *given.later)
    for number in range(1, len(alone)):
        part = turn.in_rounds(turn.rounds[: number + 1])
        so_far = replace(given, later=known[1 : number + 1])
        starts = _lay(part, starts, alone[number], so_far)
        progress(number / (len(alone) - 1))
    return [turn.widen(x) for x in starts]


def _lay(
    turn: Turntable, before: Sequence[np.ndarray], alone: _Alone, given: Given
) -> list[np.ndarray]:
    """Find the phase of the last round against those before it."""
    thin = turn.thin()
    laid = [
        (thin.cost(thin.widen(x)), x)
        for first in before
        for own in alone.starts
        for x in _turn_all_ways(turn, first, alone.turn, own)
    ]
    laid.sort(key=lambda pair: pair[0])
    free = free_parameters(thin, given.known)
    fits = [thin.fit(thin.widen(x), free, LAID_STEPS).x for x in _spread(laid)]
    ranked = sorted(((thin.cost(x), x) for x in fits), key=lambda pair: pair[0])
    most = WORSE * ranked[0][0] + NOISE**2
    return [x[: turn.shared] for cost, x in ranked[:KEPT] if cost <= most]


def _turn_all_ways(
    turn: Turntable, first: np.ndarray, alone: Turntable, own: np.ndarray
) -> list[np.ndarray]:
    """The rounds so far with one more, at every phase: its camera as far as its silhouettes say."""
    part = np.zeros(len(ROUND))
    part[OF_ROUND] = own[OF_FIRST]
    part[ROW] = alone.row
    part[FARTHER] = math.log(_measure_width(turn.round_alone(0), first[AXIS])) - math.log(
        _measure_width(alone, own[AXIS])
    )
    shared = first.copy()
    if len(shared) == len(NAMES):
        shared[VIEW] = (first[VIEW] + own[VIEW]) / 2
    ways = []
    for phase in 360 / PHASES * np.arange(PHASES):
        part[PHASE] = phase
        ways.append(np.concatenate([shared, part]))
    return ways


def _measure_width(turn: Turntable, axis: float) -> float:
    """Pixels from the axis to the farthest point of any silhouette, which no elevation changes."""
    return float(np.abs(turn.outlines.points[..., 0] - axis).max(axis=1).max())


def _spread(laid: Sequence[tuple[float, np.ndarray]]) -> list[np.ndarray]:
    """The best of some parameters that differ in the direction of turning, or in the phase."""
    kept: list[np.ndarray] = []
    for _, x in laid:
        if len(kept) < LAID and not any(_are_near(x, other) for other in kept):
            kept.append(x)
    return kept


def _are_near(x: np.ndarray, other: np.ndarray) -> bool:
    apart = (x[-len(ROUND) + PHASE] - other[-len(ROUND) + PHASE] + 180) % 360 - 180
    same_way = x[STEP] * other[STEP] > 0 and x[-1] * other[-1] > 0
    return bool(same_way and abs(apart) <= 1.5 * 360 / PHASES)
