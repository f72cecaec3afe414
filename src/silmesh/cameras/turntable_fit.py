"""The turntable that most of some silhouettes agree on.

Its parameters minimise the residuals of ``silmesh.cameras.turntable_residuals`` by non-linear least
squares. The search starts from several elevations, half angles, steps and both directions of
rotation on few views and points; the best starts are then refined on all of them. If the outlines
then miss each other by much, some silhouettes may be wrong: the views that agree are found
(``silmesh.cameras.consensus``) and fitted alone.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult

from silmesh.cameras.consensus import Consensus, find_consensus, judge
from silmesh.cameras.silhouette_coherence import Misses
from silmesh.cameras.turntable_residuals import (
    ELEVATION,
    NOISE,
    STEP,
    Turntable,
    place_of,
)
from silmesh.progress import Share, untold, within

# Elevation and half angle of view, in degrees, from which the search starts.
STARTS = [(e, a) for e in (4.0, 14.0, 28.0) for a in (8.0, 20.0)]
ARCS = (360.0, 270.0, 180.0, 120.0, 90.0)  # degrees of the whole turn, tried if no step is given
# The most evaluations of the residuals in a fit of the search, of the refinement, and of offsets.
COARSE_STEPS, FINE_STEPS, OFFSET_STEPS = 12, 20, 6
# Shares of the run time after which the search, the refinement and the mirror test end, which
# the progress bar shows.
SEARCHED, REFINED, RESOLVED = 0.5, 0.75, 0.8
# And after which fits of other kinds, and which views agree, are found, if that has to be asked.
OTHERS, AGREED = 0.88, 0.9
# A start is refined if its cost is at most RIVAL times the best one, and at most RIVALS starts are.
RIVAL, RIVALS = 3.0, 4
FOLDS = 8  # arcs that an outline is cut into for cross-validation; every other one is held out
CLEAR = 3.0  # standard errors from which one fit counts as worse than another
# Each view gets an angle of its own if that lowers the cost of held-out arcs by so many standard
# errors.
BETTER = 2.0
# Not all views can agree if the search ends above so many times SUSPECT; all are fitted then only
# if no views are found that disagree.
HOPELESS = 2.0
# Share of the views that have to agree if little time is taken, and the mean loss, in pixels of
# images of 256, from which these do not.
MOST, LOST = 0.8, 8.0
BETTER_FIT = 0.8  # of the residual of all views, from which the fit of those that agree is taken
# Root mean square residual, in pixels of a 256-pixel image, from which some silhouettes may be
# wrong, and from which what chosen views agree on is no turntable.
SUSPECT, REFUSED_AGREEING = 1.0, 2.0
ROUGH = 0.75  # pixels of any image, below which outlines of pixels do not settle what agrees
FEWEST_AGREEING = 8  # views that have to agree on a turntable if others do not


@dataclass(frozen=True)
class Given:
    """What is known of a turn.

    Attributes:
        count: how many views there are, with an outline or without
        step, elevation, above_table: as ``silmesh.cameras.calibrate.calibrate`` takes them
        later: the same of the rounds after the first
    """

    count: int
    step: float | None
    elevation: float | None
    above_table: bool
    later: "tuple[Given, ...]" = ()

    @property
    def known(self) -> list[int]:
        """Positions of the parameters that are given."""
        found = []
        for number, one in enumerate((self, *self.later)):
            both = (ELEVATION, one.elevation), (STEP, one.step)
            found += [place_of(name, number) for name, value in both if value is not None]
        return found

    @property
    def side_known(self) -> bool:
        """Whether an elevation says on which side of the table the camera stood."""
        return any(one.elevation is not None for one in (self, *self.later))


@dataclass(frozen=True)
class TurntableFit:
    """A turntable that was fitted to silhouettes.

    Attributes:
        turn: with the views that it was fitted to
        best: the fit
        rivals: parameters of other fits that are not clearly worse
        mirror: what tells the object from its mirror image, as ``Calibration`` names it
        misses: the residuals
    """

    turn: Turntable
    best: OptimizeResult
    rivals: list[np.ndarray]
    mirror: str
    misses: Misses

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, in pixels."""
        return root_mean_square(self.misses.pixels[self.turn.outlines.known])


def fit_most(
    turn: Turntable,
    given: Given,
    fewest: float,
    progress: Share,
    otherwise: Callable[[Share], tuple[TurntableFit, Consensus | None] | None] = lambda told: None,
    patient: bool = True,
) -> tuple[TurntableFit, Consensus | None]:
    """Fit all views or, if these contradict each other, those that agree.

    Args:
        fewest: views that have to agree
        otherwise: is asked, where some views contradict others, for a fit of another kind, which
            is taken if there is one; tells its own progress
        patient: whether views that agree are looked for even if most contradict the others by far
    Returns:
        the fit, and how far the views agree if that had to be asked
    """
    suspect, allowed = (limit * turn.size / 256 for limit in (SUSPECT, REFUSED_AGREEING))
    starts = search(turn, given, within(progress, 0, SEARCHED))
    thin = turn.thin()
    cost = thin.cost(thin.widen(starts[0]))
    fit = solve(turn, starts, given, progress) if cost <= HOPELESS * suspect else None
    if len(turn.index) < FEWEST_AGREEING or (fit and fit.rms <= suspect):
        return fit or solve(turn, starts, given, progress), None
    asked = reached = RESOLVED if fit else SEARCHED

    def tell(share: float) -> None:
        nonlocal reached
        reached = asked + share * (OTHERS - asked)
        progress(reached)

    if other := otherwise(tell):
        return other
    if not patient and _is_lost(thin, starts[0]):
        return fit or solve(turn, starts, given, progress), None
    verdict = find_consensus(
        turn,
        lambda sample, told: search(sample, given, told)[0][: sample.shared],
        free_parameters(turn, given.known),
        allowed,
        np.random.default_rng(0),
        within(progress, reached, AGREED),
    )
    left = within(progress, AGREED, 1)
    if verdict.agrees.sum() >= fewest and not verdict.agrees.all():
        most = max(allowed, ROUGH)
        better = min(most, BETTER_FIT * fit.rms) if fit else most
        apart, strict = _fit_agreeing(turn, verdict, given, most, left)
        if apart.rms <= better and strict.agrees.sum() >= fewest:
            return apart, strict
    return fit or solve(turn, starts, given, left), verdict


def _fit_agreeing(
    turn: Turntable, verdict: Consensus, given: Given, allowed: float, progress: Share
) -> tuple[TurntableFit, Consensus]:
    """Fit the views that agree alone, and judge all by that.

    Args:
        allowed: pixels, by which a view that agrees may miss the others
    """
    agreeing = np.flatnonzero(verdict.agrees)
    part = turn.alone(agreeing)
    apart = solve(part, search(part, given, within(progress, 0, SEARCHED)), given, progress)
    whole = part.of(turn.outlines, turn.index)
    return apart, judge(whole, apart.best.x, agreeing, allowed, trusting=True)


def _is_lost(thin: Turntable, x: np.ndarray) -> bool:
    """Whether even the views that fit best, ``MOST`` of them, are contradicted by far."""
    costs = np.sort(thin.view_costs(thin.widen(x)))[: math.ceil(MOST * len(thin.index))]
    return bool(costs.mean() > LOST * thin.size / 256)


def solve(
    turn: Turntable, starts: Sequence[np.ndarray], given: Given, progress: Share = untold
) -> TurntableFit:
    """Refine starts on all views, and tell apart what fits as well."""
    free = free_parameters(turn, given.known)
    fits, mirror = _refine(turn, starts, free, within(progress, SEARCHED, REFINED)), "elevation"
    if not given.side_known:
        fits, mirror = _resolve_mirror(turn, fits, free, given.above_table)
    progress(RESOLVED)
    best = _fit_offsets(turn, fits[0], given.known)
    return TurntableFit(turn, best, _find_rivals(turn, fits), mirror, turn.misses(best.x))


def free_parameters(turn: Turntable, known: Sequence[int], offsets: bool = False) -> np.ndarray:
    """Positions of the parameters that a fit may change."""
    free = [i for i in range(turn.shared) if i not in known]
    return np.array(free + [turn.shared + i for i in range(len(turn.index)) if offsets])


def search(turn: Turntable, given: Given, progress: Share = untold) -> list[np.ndarray]:
    """Find starts to refine, on fewer views and points: [parameters] each.

    The best start is kept of each combination of rotation direction, side of the table and arc,
    unless it is clearly worse than the best of all.
    """
    thin, step, elevation = turn.thin(), given.step, given.elevation
    sides = (1,) if given.above_table else (1, -1)  # of the table: above, below
    steps = [abs(step)] if step is not None else [arc / given.count for arc in ARCS]
    starts = STARTS if step is not None else STARTS[::2]
    if elevation is not None:
        starts, sides = [(elevation, angle) for _, angle in STARTS[:2]], (1,)
    free = free_parameters(thin, [STEP] if elevation is None else [STEP, ELEVATION])
    found = []
    ways = [(direction * s, side) for direction in (1, -1) for s in steps for side in sides]
    for turning, side in ways:
        fits = [thin.fit(thin.start(side * e, a, turning), free, COARSE_STEPS) for e, a in starts]
        found.append(min(((thin.cost(fit.x), fit.x) for fit in fits), key=lambda pair: pair[0]))
        progress(len(found) / len(ways))
    found.sort(key=lambda pair: pair[0])
    most = RIVAL * found[0][0] + NOISE**2
    return [turn.widen(x) for cost, x in found[:RIVALS] if cost < most]


def _refine(
    turn: Turntable, starts: Sequence[np.ndarray], free: np.ndarray, progress: Share
) -> list[OptimizeResult]:
    """Fit the parameters ``free`` from each start, on all views and points; the best fit first."""
    fits = []
    for done, start in enumerate(starts, start=1):
        fits.append(turn.fit(start, free, FINE_STEPS))
        progress(done / len(starts))
    return sorted(fits, key=lambda fit: turn.cost(fit.x))


def _resolve_mirror(
    turn: Turntable, fits: list[OptimizeResult], free: np.ndarray, above_table: bool
) -> tuple[list[OptimizeResult], str]:
    """Decide between the best fit and that of the mirrored object.

    Perspective decides where it does so clearly; otherwise the assumption that the camera stands
    above the table does.

    Returns:
        the fits, the mirrored one first if it is clearly better, and what decided
    """
    best, thin = fits[0], turn.thin()
    part = free[free < turn.shared]

    def refine(x: np.ndarray) -> np.ndarray:
        return thin.fit(thin.widen(x), part, COARSE_STEPS).x

    cost, other = (thin.cost(refine(x)) for x in (best.x, turn.mirrored(best.x)))
    if other < cost:
        twin = turn.fit(turn.mirrored(best.x), free, FINE_STEPS)
        cost, other = turn.cost(best.x), turn.cost(twin.x)
        if turn.excess(other, cost) > CLEAR:
            return [twin, *fits], "perspective"
        return fits, "table" if above_table else "open"
    clear = thin.excess(cost, other) > CLEAR
    return fits, "perspective" if clear else "table" if above_table else "open"


def _find_rivals(turn: Turntable, fits: Sequence[OptimizeResult]) -> list[np.ndarray]:
    """The parameters of the other fits that are not clearly worse than the first."""
    cost = turn.cost(fits[0].x)
    return [fit.x for fit in fits[1:] if turn.excess(cost, turn.cost(fit.x)) <= CLEAR]


def _fit_offsets(turn: Turntable, fit: OptimizeResult, known: Sequence[int]) -> OptimizeResult:
    """Give every view its own angle, if that explains held-out parts of the outlines better.

    This is a cross-validation in two folds: the angles are fitted to every other arc of each
    outline and evaluated on the arcs between.
    """
    count = turn.outlines.known.shape[1]
    fold = np.arange(count) * FOLDS // count % 2 == 0
    own = turn.shared + np.arange(len(turn.index))
    gains = []
    for fitted, held_out in (
        (turn.only(fold), turn.only(~fold)),
        (turn.only(~fold), turn.only(fold)),
    ):
        x = fitted.fit(fit.x, own, OFFSET_STEPS).x
        gains.append(held_out.view_costs(fit.x) - held_out.view_costs(x))
    gain = np.mean(gains, axis=0)
    if gain.mean() <= BETTER * gain.std(ddof=1) / math.sqrt(len(gain)):
        return fit
    return turn.fit(fit.x, free_parameters(turn, known, offsets=True), OFFSET_STEPS)


def root_mean_square(values: np.ndarray) -> float:
    """Of all values together."""
    return float(np.sqrt((values**2).mean()))
