"""Cameras of a turntable whose geometry is unknown, from silhouettes alone.

The parameters minimise the residuals of ``silmesh.cameras.turntable_residuals`` by non-linear least
squares, whose covariance also says how well the silhouettes fix each parameter. The search starts
from several elevations, half angles, steps and both directions of rotation on few views and points;
the best starts are then refined on all of them. If the outlines then miss each other by much, some
silhouettes may be wrong: the views that agree are found (``silmesh.cameras.consensus``) and fitted
alone, and the others are named.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
import torch
from scipy.optimize import OptimizeResult

from silmesh.cameras.attempt import CHECK_SERIES, Attempt
from silmesh.cameras.consensus import Consensus, find_consensus, judge
from silmesh.cameras.silhouette_coherence import Misses, distance_between, trace
from silmesh.cameras.turntable_residuals import (
    ELEVATION,
    INDEPENDENT,
    NAMES,
    NOISE,
    STEP,
    VIEW,
    Turntable,
    mirrored,
)
from silmesh.errors import NAMED, InputError, name_some
from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import whole_frames
from silmesh.progress import Share, untold, within
from silmesh.views import View

FEWEST_VIEWS = 3  # silhouettes without which no turntable is looked for
# All outlines together are sampled at about POINTS points, and each at a number within the limits.
POINTS, FEWEST_SAMPLES, MOST_SAMPLES = 1728, 32, 96
# Elevation and half angle of view, in degrees, from which the search starts.
STARTS = [(e, a) for e in (4.0, 14.0, 28.0) for a in (8.0, 20.0)]
ARCS = (360.0, 270.0, 180.0, 120.0, 90.0)  # degrees of the whole turn, tried if no step is given
# The most evaluations of the residuals in a fit of the search, of the refinement, and of offsets.
COARSE_STEPS, FINE_STEPS, OFFSET_STEPS = 12, 20, 6
# Shares of the run time after which the search, the refinement and the mirror test end, which
# the progress bar shows.
SEARCHED, REFINED, RESOLVED = 0.5, 0.75, 0.8
# A start is refined if its cost is at most RIVAL times the best one, and at most RIVALS starts are.
RIVAL, RIVALS = 3.0, 4
SAME = 0.02  # two steps whose relative difference is smaller count as the same
FOLDS = 8  # arcs that an outline is cut into for cross-validation; every other one is held out
CLEAR = 3.0  # standard errors from which one fit counts as worse than another
# Each view gets an angle of its own if that lowers the cost of held-out arcs by so many standard
# errors.
BETTER = 2.0
# A parameter is reported as found if its standard deviation is at most this, in the order of NAMES
# and in its own unit; otherwise it is reported as open.
FIXED = np.array([2.0, 1.0, 1.0, 0.5, 0.3])
LEVEL = 3.0  # degrees of elevation below which the mirrored object may fit as well, so warn
ALIKE = 0.35  # pixels: outlines whose root mean square difference is less all look the same
# Two neighbours that differ by less than this share of the median difference between neighbours
# are taken to be the same photograph.
REPEATED = 0.05
LATHE = (
    "all silhouettes are the same, as of a thing turned on a lathe that stands on the axis: they "
    "show the axis, and neither elevation, perspective, step nor direction"
)
# Root mean square residual, in pixels of a 256-pixel image, from which a person is warned and from
# which the calibration is refused.
SUSPECT, REFUSED = 1.0, 4.0
# Views that have to agree on a turntable if others do not: a share of those with a silhouette, and
# so many. What chosen views agree on has to fit better, too: the residual in pixels as above.
SHARE, FEWEST_AGREEING, REFUSED_AGREEING = 0.55, 8, 2.0
# Not all views can agree if the search ends above so many times SUSPECT; all are fitted then only
# if no views are found that disagree.
HOPELESS = 2.0
BETTER_FIT = 0.8  # of the residual of all views, from which the fit of those that agree is taken
FULL = "it fills its photograph"


@dataclass(frozen=True)
class Estimate:
    """A parameter as found.

    Attributes:
        value: in degrees; of the axis in pixels
        sd: standard deviation, in the same units; 0 if it was given
        status: ``given``, ``found``, or ``open``: the silhouettes do not fix it
    """

    value: float
    sd: float
    status: str


@dataclass(frozen=True)
class Calibration:
    """Cameras found, and how far to trust them.

    Attributes:
        cameras: in pixels of the silhouettes; the world's axis y is the turntable's
        estimates: ``elevation`` of the camera above the table; ``roll`` of the axis in the image,
            clockwise; ``axis``, its column at the row ``row``; ``half_angle`` of view over half of
            the image's side; ``step`` from view to view, negative where the turning is opposite
            to ``turntable_cameras``
        row: the middle of the silhouettes, in pixels
        direction_certain: whether the other direction fits clearly worse
        mirror: what tells the object from its mirror image: ``perspective``, ``table`` (the camera
            is taken to stand above it), ``elevation`` (it was given), or ``open``
        rms: root mean square of the residuals of the views that agree, in pixels
        view_rms: of each view, 0 without an outline; of one that disagrees, by how much
        disagreeing: views that had no say, since the others contradict their silhouettes: by how
            much, in words
        offsets: [views] degrees by which each view's angle differs from even steps
        warnings: what a person should know, in sentences
    """

    cameras: Cameras
    estimates: dict[str, Estimate]
    row: float
    direction_certain: bool
    mirror: str
    rms: float
    view_rms: np.ndarray
    disagreeing: dict[str, str]
    offsets: np.ndarray
    warnings: tuple[str, ...]


def calibrate(
    silhouettes: np.ndarray,
    views: Sequence[str],
    step: float | None = None,
    elevation: float | None = None,
    distance: float | None = None,
    above_table: bool = True,
    aspect: float = 1.0,
    frames: np.ndarray | None = None,
    progress: Share = untold,
) -> Calibration:
    """Find the cameras of a turntable.

    Args:
        silhouettes: [views, size, size] bool, in the order in which the views were taken; an empty
            one says nothing, and its camera stands where the even steps put it
        views: their names
        step: degrees from view to view, if known; its sign does not matter
        elevation: of the camera above the table in degrees, if known
        distance: of the camera from the axis in sizes of the object, if known roughly
        above_table: whether the camera is taken not to look up at the table, unless perspective
            clearly says so; it tells an object from its mirror image, which turns the other way
            before a camera below
        aspect: height over width of a square's image, for photographs that were stretched
        frames: [views, 4] left, top, right and bottom of the photographs within the images: beyond
            them nothing is known; the whole images if not given
        progress: is told which share is done

    Raises:
        InputError: fewer than 3 views have a silhouette, or no turntable explains most of them
    """
    shown, full = _find_shown(silhouettes, views, frames)
    samples = int(np.clip(POINTS // len(views), FEWEST_SAMPLES, MOST_SAMPLES))
    named = [views[i] for i in shown]
    outlines = trace(silhouettes[shown], samples, named, None if frames is None else frames[shown])
    turn = Turntable(outlines, silhouettes.shape[1], aspect, distance, shown)
    given = _Given(len(views), step, elevation, above_table)
    repeated = _find_repeated(silhouettes[shown], named)
    fewest = max(SHARE * (len(shown) + len(full)), FEWEST_AGREEING)
    fit, verdict = _fit_most(turn, given, fewest, progress)
    progress(1)
    if fit.turn is turn:
        _refuse_incoherent(fit, verdict, repeated)
        verdict = None
    disagreeing = {views[i]: FULL for i in full} | _name_disagreeing(verdict, named)
    said = [*repeated, *_warn_of_disagreement(disagreeing, views), *_find_cut(turn, named)]
    pixels = {} if verdict is None else dict(zip(shown, verdict.pixels, strict=True))
    return _report(fit, given, views, pixels, disagreeing, said)


def calibrate_views(
    silhouettes: np.ndarray, views: Sequence[View], **known: float | bool | Share | None
) -> Attempt:
    """``calibrate`` from the silhouettes of working images, as an attempt.

    Args:
        silhouettes: [views, size, size] bool
        views: these views, in the order in which they were taken
        known: what else ``calibrate`` takes
    """
    scale = views[0].pixel_map
    return attempt_calibration(
        silhouettes,
        [view.view for view in views],
        aspect=float(scale[1, 1] / scale[0, 0]),
        frames=np.array([view.frame for view in views]),
        **known,
    )


def attempt_calibration(
    silhouettes: np.ndarray,
    views: Sequence[str],
    **known: float | bool | np.ndarray | Share | None,
) -> Attempt:
    """``calibrate`` with the same arguments, as an attempt: a refusal is kept, not raised."""
    try:
        found = calibrate(silhouettes, views, **known)
    except InputError as error:
        return Attempt("calibrate", None, refusal=str(error))
    figures = {
        "estimates": {name: asdict(e) for name, e in found.estimates.items()},
        "row": float(found.row),
        "direction_certain": found.direction_certain,
        "mirror": found.mirror,
        "rms": found.rms,
        "disagreeing": found.disagreeing,
        "view_rms": dict(zip(found.cameras.views, found.view_rms.tolist(), strict=True)),
        "offsets": dict(zip(found.cameras.views, found.offsets.tolist(), strict=True)),
    }
    return Attempt("calibrate", found.cameras, warnings=found.warnings, figures=figures)


@dataclass(frozen=True)
class _Given:
    """What is known of a turn: arguments of ``calibrate``, and how many views there are."""

    count: int
    step: float | None
    elevation: float | None
    above_table: bool

    @property
    def known(self) -> list[int]:
        """Positions of the parameters that are given."""
        both = (ELEVATION, self.elevation), (STEP, self.step)
        return [i for i, value in both if value is not None]


@dataclass(frozen=True)
class _Fit:
    """A turntable that was fitted to silhouettes.

    Attributes:
        turn: with the views that it was fitted to
        best: the fit
        rivals: parameters of other fits that are not clearly worse
        mirror: as in ``Calibration``
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
        return _root_mean_square(self.misses.pixels[self.turn.outlines.known])


def _find_shown(
    silhouettes: np.ndarray, views: Sequence[str], frames: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Positions of the views with an outline, and of those whose silhouette fills its photograph.

    Raises:
        InputError: too few have an outline
    """
    shown = silhouettes.any(axis=(1, 2))
    if shown.sum() < FEWEST_VIEWS:
        raise InputError(
            f"cameras 'calibrate': there are {shown.sum()} views with a silhouette; it takes at "
            f"least {FEWEST_VIEWS}, and a dozen to be trusted"
        )
    boxes = whole_frames(silhouettes) if frames is None else frames
    full = np.array(
        [
            s[top:bottom, left:right].all()
            for s, (left, top, right, bottom) in zip(silhouettes, boxes, strict=True)
        ]
    )
    if (shown & ~full).sum() < max(FEWEST_VIEWS, SHARE * shown.sum()):
        names = name_some([repr(views[i]) for i in np.flatnonzero(full)])
        raise InputError(
            f"cameras 'calibrate': {full.sum()} of the {shown.sum()} silhouettes fill their "
            f"photographs and have no outline: {names}"
        )
    return np.flatnonzero(shown & ~full), np.flatnonzero(full)


def _fit_most(
    turn: Turntable, given: _Given, fewest: float, progress: Share
) -> tuple[_Fit, Consensus | None]:
    """Fit all views or, if these contradict each other, those that agree.

    Args:
        fewest: views that have to agree
    Returns:
        the fit, and how far the views agree if that had to be asked
    """
    suspect, allowed = (limit * turn.size / 256 for limit in (SUSPECT, REFUSED_AGREEING))
    starts = _search(turn, given, within(progress, 0, SEARCHED))
    thin = turn.thin()
    cost = thin.cost(np.r_[starts[0][: len(NAMES)], np.zeros(len(thin.index))])
    fit = _solve(turn, starts, given, progress) if cost <= HOPELESS * suspect else None
    if len(turn.index) < FEWEST_AGREEING or (fit and fit.rms <= suspect):
        return fit or _solve(turn, starts, given, progress), None
    verdict = find_consensus(
        turn,
        lambda sample: _search(sample, given)[0][: len(NAMES)],
        _free(turn, given.known),
        allowed,
        np.random.default_rng(0),
    )
    if verdict.agrees.sum() >= fewest and not verdict.agrees.all():
        agreeing = np.flatnonzero(verdict.agrees)
        part = turn.alone(agreeing)
        apart = _solve(part, _search(part, given), given)
        if apart.rms <= (min(allowed, BETTER_FIT * fit.rms) if fit else allowed):
            whole = part.of(turn.outlines, turn.index)
            strict = judge(whole, apart.best.x, agreeing, allowed, trusting=True)
            if strict.agrees.sum() >= fewest:
                return apart, strict
    return fit or _solve(turn, starts, given, progress), verdict


def _solve(
    turn: Turntable, starts: Sequence[np.ndarray], given: _Given, progress: Share = untold
) -> _Fit:
    """Refine starts on all views, and tell apart what fits as well."""
    free = _free(turn, given.known)
    fits, mirror = _refine(turn, starts, free, within(progress, SEARCHED, REFINED)), "elevation"
    if given.elevation is None:
        fits, mirror = _resolve_mirror(turn, fits, free, given.above_table)
    progress(RESOLVED)
    best = _fit_offsets(turn, fits[0], given.known)
    return _Fit(turn, best, _find_rivals(turn, fits), mirror, turn.misses(best.x))


def _free(turn: Turntable, known: Sequence[int], offsets: bool = False) -> np.ndarray:
    """Positions of the parameters that a fit may change."""
    free = [i for i in range(len(NAMES)) if i not in known]
    return np.array(free + [len(NAMES) + i for i in range(len(turn.index)) if offsets])


def _search(turn: Turntable, given: _Given, progress: Share = untold) -> list[np.ndarray]:
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
    free = _free(thin, [STEP] if elevation is None else [STEP, ELEVATION])
    found = []
    ways = [(direction * s, side) for direction in (1, -1) for s in steps for side in sides]
    for turning, side in ways:
        fits = [thin.fit(thin.start(side * e, a, turning), free, COARSE_STEPS) for e, a in starts]
        found.append(min(((thin.cost(fit.x), fit.x) for fit in fits), key=lambda pair: pair[0]))
        progress(len(found) / len(ways))
    found.sort(key=lambda pair: pair[0])
    most = RIVAL * found[0][0] + NOISE**2
    best = [x[: len(NAMES)] for cost, x in found[:RIVALS] if cost < most]
    return [np.concatenate([x, np.zeros(len(turn.index))]) for x in best]


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
    part = free[free < len(NAMES)]

    def refine(x: np.ndarray) -> np.ndarray:
        start = np.concatenate([x[: len(NAMES)], np.zeros(len(thin.index))])
        return thin.fit(start, part, COARSE_STEPS).x

    cost, other = (thin.cost(refine(x)) for x in (best.x, mirrored(best.x)))
    if other < cost:
        twin = turn.fit(mirrored(best.x), free, FINE_STEPS)
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
    own = len(NAMES) + np.arange(len(turn.index))
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
    return turn.fit(fit.x, _free(turn, known, offsets=True), OFFSET_STEPS)


def _find_repeated(silhouettes: np.ndarray, views: Sequence[str]) -> list[str]:
    """A sentence that names neighbours with the same silhouette, if there are any."""
    changes = np.array([(a ^ b).sum() for a, b in pairwise(silhouettes)])
    twice = np.flatnonzero(changes < REPEATED * np.median(changes))
    if not len(twice):
        return []
    pairs = [f"{views[i]!r} and {views[i + 1]!r}" for i in twice]
    return [
        f"{name_some(pairs)} show the same silhouette: if a photograph came twice, leave one out"
    ]


def _find_cut(turn: Turntable, views: Sequence[str]) -> list[str]:
    """A sentence that names the views in which the frame cuts the object, if there are any."""
    cut = np.flatnonzero(turn.outlines.cut)
    if not len(cut):
        return []
    names = name_some([repr(views[i]) for i in cut])
    return [f"the frame cuts the object in {len(cut)} of {len(views)} views: {names}"]


def _name_disagreeing(verdict: Consensus | None, views: Sequence[str]) -> dict[str, str]:
    """The views that disagree, and by how much."""
    if verdict is None:
        return {}
    judged = zip(views, verdict.pixels, verdict.agrees, strict=True)
    wrong = {str(view): pixels for view, pixels, agrees in judged if not agrees}
    return {view: f"it disagrees by {pixels:.2g} pixels" for view, pixels in wrong.items()}


def _warn_of_disagreement(disagreeing: dict[str, str], views: Sequence[str]) -> list[str]:
    if not disagreeing:
        return []
    names = name_some([f"{view!r} ({why})" for view, why in disagreeing.items()])
    return [
        f"the silhouettes of {len(disagreeing)} of {len(views)} views disagree with the turntable "
        f"that the others agree on, and had no say: {names}"
    ]


def _refuse_incoherent(fit: _Fit, verdict: Consensus | None, said: Sequence[str]) -> None:
    """Refuse a fit of all views whose residuals are too large."""
    allowed = REFUSED * fit.turn.size / 256
    if fit.rms <= allowed:
        return
    most = f"; no turntable explains more than {verdict.agrees.sum()} of the {len(verdict.agrees)}"
    raise InputError(
        f"cameras 'calibrate': no turntable explains these silhouettes: at best their "
        f"outlines miss each other by {fit.rms:.2g} pixels (root mean square; at most "
        f"{allowed:.2g} is accepted)"
        + (most if verdict else "")
        + "".join(f"; {s}" for s in said)
        + CHECK_SERIES
    )


def _report(
    fit: _Fit,
    given: _Given,
    views: Sequence[str],
    pixels: dict[int, float],
    disagreeing: dict[str, str],
    said: Sequence[str],
) -> Calibration:
    """What was found; ``pixels`` says by how much views disagree, if that had to be asked."""
    turn, best, misses, count = fit.turn, fit.best, fit.misses, len(views)
    *camera, own = turn.cameras_at(best.x, count)
    alike = distance_between(turn.outlines) < ALIKE
    free = _free(turn, given.known, offsets=bool(own.any()))
    estimates = _estimate(turn, best, misses, given.known, free, alike)
    view_rms = np.zeros(count)
    view_rms[list(pixels)] = list(pixels.values())
    view_rms[turn.index] = [
        _root_mean_square(r[k]) if k.any() else 0.0
        for r, k in zip(misses.pixels, turn.outlines.known, strict=True)
    ]
    K, R, t = map(torch.as_tensor, camera)
    cameras = Cameras(tuple(views), torch.full((count, 2), turn.size), K.repeat(count, 1, 1), R, t)
    certain = not alike and all(x[STEP] * best.x[STEP] > 0 for x in fit.rivals)
    warnings = [
        *said,
        *([LATHE] if alike else _warn_of_estimates(estimates)),
        *([] if alike else _warn_of_rivals(estimates, fit.rivals, certain, fit.mirror)),
        *_warn_of_misses(turn, fit.rms, view_rms, views),
    ]
    return Calibration(
        cameras, estimates, turn.row, certain, fit.mirror, fit.rms, view_rms, disagreeing, own,
        tuple(warnings),
    )  # fmt: skip


def _estimate(
    turn: Turntable,
    fit: OptimizeResult,
    misses: Misses,
    known: Sequence[int],
    free: np.ndarray,
    alike: bool,
) -> dict[str, Estimate]:
    """The parameters with their standard deviations, from the residuals' derivatives at the fit.

    If all silhouettes look the same, they fix the axis and the roll only. Elevation, half angle
    and step then get the standard deviations of their priors.
    """
    noise = max(NOISE, _root_mean_square(misses.pixels[turn.outlines.known]))
    turn = turn.sparse()
    slopes = turn.slopes(fit.x, turn.misses(fit.x))
    slopes[..., : len(NAMES)] = turn.secants(fit.x)
    data = slopes.reshape(-1, len(fit.x))[:, free]
    _, prior_sd = turn.prior()
    weight = INDEPENDENT / turn.outlines.known.shape[1] / noise**2
    precision = weight * data.T @ data + np.diag(prior_sd[free] ** -2.0)
    sd = np.zeros(len(fit.x))
    sd[free] = np.sqrt(np.diag(np.linalg.pinv(precision)))
    if alike:
        unknown = [i for i in (ELEVATION, VIEW, STEP) if i not in known]
        sd[unknown] = np.where(
            np.isfinite(prior_sd[unknown]), prior_sd[unknown], np.abs(fit.x[unknown])
        )
    values = fit.x[: len(NAMES)].copy()
    values[VIEW] = math.degrees(math.atan(math.exp(values[VIEW])))
    status = ["found" if s <= most else "open" for s, most in zip(sd, FIXED, strict=False)]
    sd[VIEW] *= math.degrees(math.sin(2 * math.radians(values[VIEW])) / 2)  # d angle / d log tan
    return {
        name: Estimate(float(values[i]), float(sd[i]), "given" if i in known else status[i])
        for i, name in enumerate(NAMES)
    }


def _warn_of_estimates(estimates: dict[str, Estimate]) -> list[str]:
    return [
        f"{name} is not fixed by the silhouettes: {e.value:.3g} +- {e.sd:.2g} is mostly a guess"
        for name, e in estimates.items()
        if e.status == "open"
    ]


def _warn_of_rivals(
    estimates: dict[str, Estimate],
    rivals: Sequence[np.ndarray],
    certain: bool,
    mirror: str,
) -> list[str]:
    """Sentences that name other turntables which explain the silhouettes as well."""
    said = []
    elevation, step = estimates["elevation"].value, estimates["step"].value
    others = {round(abs(x[STEP]), 3) for x in rivals if abs(abs(x[STEP] / step) - 1) > SAME}
    if others:
        listed = ", ".join(f"{other:.3g}" for other in sorted(others))
        said.append(
            f"steps of {abs(step):.3g} and {listed} degrees explain the silhouettes as well; if "
            "you know the step, give it: turntable ',,step'"
        )
    if mirror == "perspective" and elevation < 0:
        said.append(
            f"the camera looks up at the table ({elevation:.3g} degrees): by its perspective, a "
            "camera above fits clearly worse"
        )
    if not certain:
        said.append(
            "both directions of turning explain the silhouettes; if the mesh is mirrored, "
            "it is the other one"
        )
    elif mirror == "open":
        said.append(
            "a camera above and one below the table explain the silhouettes; if the mesh is "
            "mirrored, it is the other one"
        )
    elif abs(elevation) < LEVEL and mirror == "table":
        said.append(
            f"the camera looks almost level ({elevation:.2g} degrees), where a mirrored object "
            "that turns the other way looks the same; the direction may be wrong"
        )
    return said


def _warn_of_misses(
    turn: Turntable, rms: float, view_rms: np.ndarray, views: Sequence[str]
) -> list[str]:
    if rms <= SUSPECT * turn.size / 256:
        return []
    worst = sorted(range(len(views)), key=lambda i: -view_rms[i])[:NAMED]
    listed = ", ".join(f"{views[i]!r} ({view_rms[i]:.2g})" for i in worst)
    return [
        f"the outlines miss each other by {rms:.2g} pixels; the views that miss most are "
        f"{listed}: look at their silhouettes, and at the order of the views"
    ]


def _root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))
