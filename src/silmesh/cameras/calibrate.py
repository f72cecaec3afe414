"""Cameras of a turntable whose geometry is unknown, from silhouettes alone.

The parameters minimise the residuals of ``silmesh.cameras.turntable_residuals`` by non-linear least
squares, whose covariance also says how well the silhouettes fix each parameter. The search starts
from several elevations, half angles, steps and both directions of rotation on few views and points;
the best starts are then refined on all of them.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
import torch
from scipy.optimize import OptimizeResult

from silmesh.cameras.attempt import CHECK_SERIES, Attempt
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
        rms: root mean square of the residuals, in pixels
        view_rms: of each view, 0 without a silhouette
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
        InputError: fewer than 3 views have a silhouette, one fills its image, or no turntable
            explains them
    """
    shown = _find_shown(silhouettes)
    samples = int(np.clip(POINTS // len(views), FEWEST_SAMPLES, MOST_SAMPLES))
    named = [views[i] for i in shown]
    outlines = trace(silhouettes[shown], samples, named, None if frames is None else frames[shown])
    turn = Turntable(outlines, silhouettes.shape[1], aspect, distance, shown)
    known = [i for i, value in ((ELEVATION, elevation), (STEP, step)) if value is not None]
    sides = (1,) if above_table else (1, -1)
    starts = _search(turn, len(views), step, elevation, sides, within(progress, 0, SEARCHED))
    fits = _refine(turn, starts, _free(turn, known), within(progress, SEARCHED, REFINED))
    mirror = "elevation"
    if elevation is None:
        fits, mirror = _resolve_mirror(turn, fits, _free(turn, known), above_table)
    progress(RESOLVED)
    best = _fit_offsets(turn, fits[0], known)
    progress(1)
    misses = turn.misses(best.x)
    repeated = _find_repeated(silhouettes[shown], named)
    _refuse_incoherent(turn, misses, repeated)
    said = [*repeated, *_find_cut(turn, named)]
    return _report(turn, best, misses, known, views, _find_rivals(turn, fits), mirror, said)


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
        "view_rms": dict(zip(found.cameras.views, found.view_rms.tolist(), strict=True)),
        "offsets": dict(zip(found.cameras.views, found.offsets.tolist(), strict=True)),
    }
    return Attempt("calibrate", found.cameras, warnings=found.warnings, figures=figures)


def _find_shown(silhouettes: np.ndarray) -> np.ndarray:
    """Positions of the views with a silhouette, if there are enough of them."""
    shown = np.flatnonzero(silhouettes.any(axis=(1, 2)))
    if len(shown) < FEWEST_VIEWS:
        raise InputError(
            f"cameras 'calibrate': there are {len(shown)} views with a silhouette; it takes at "
            f"least {FEWEST_VIEWS}, and a dozen to be trusted"
        )
    return shown


def _free(turn: Turntable, known: Sequence[int], offsets: bool = False) -> np.ndarray:
    """Positions of the parameters that a fit may change."""
    free = [i for i in range(len(NAMES)) if i not in known]
    return np.array(free + [len(NAMES) + i for i in range(len(turn.index)) if offsets])


def _search(
    turn: Turntable,
    positions: int,
    step: float | None,
    elevation: float | None,
    sides: Sequence[int],
    progress: Share,
) -> list[np.ndarray]:
    """Find starts to refine, on fewer views and points: [parameters] each.

    The best start is kept of each combination of rotation direction, side of the table and arc,
    unless it is clearly worse than the best of all.

    Args:
        positions: views in the turn, with or without a silhouette
        sides: 1 for a camera above the table, -1 for one below
    """
    thin = turn.thin()
    steps = [abs(step)] if step is not None else [arc / positions for arc in ARCS]
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


def _refuse_incoherent(turn: Turntable, misses: Misses, said: Sequence[str]) -> None:
    rms = _root_mean_square(misses.pixels[turn.outlines.known])
    allowed = REFUSED * turn.size / 256
    if rms > allowed:
        raise InputError(
            f"cameras 'calibrate': no turntable explains these silhouettes: at best their "
            f"outlines miss each other by {rms:.2g} pixels (root mean square; at most "
            f"{allowed:.2g} is accepted)" + "".join(f"; {s}" for s in said) + CHECK_SERIES
        )


def _report(
    turn: Turntable,
    fit: OptimizeResult,
    misses: Misses,
    known: Sequence[int],
    views: Sequence[str],
    rivals: Sequence[np.ndarray],
    mirror: str,
    said: Sequence[str],
) -> Calibration:
    count = len(views)
    *camera, own = turn.cameras_at(fit.x, count)
    alike = distance_between(turn.outlines) < ALIKE
    free = _free(turn, known, offsets=bool(own.any()))
    estimates = _estimate(turn, fit, misses, known, free, alike)
    view_rms = np.zeros(count)
    view_rms[turn.index] = [
        _root_mean_square(r[k]) if k.any() else 0.0
        for r, k in zip(misses.pixels, turn.outlines.known, strict=True)
    ]
    rms = _root_mean_square(misses.pixels[turn.outlines.known])
    K, R, t = map(torch.as_tensor, camera)
    cameras = Cameras(tuple(views), torch.full((count, 2), turn.size), K.repeat(count, 1, 1), R, t)
    certain = not alike and all(x[STEP] * fit.x[STEP] > 0 for x in rivals)
    warnings = [
        *said,
        *([LATHE] if alike else _warn_of_estimates(estimates)),
        *([] if alike else _warn_of_rivals(estimates, rivals, certain, mirror)),
        *_warn_of_misses(turn, rms, view_rms, views),
    ]
    return Calibration(
        cameras, estimates, turn.row, certain, mirror, rms, view_rms, own, tuple(warnings)
    )


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
