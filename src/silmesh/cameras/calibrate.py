"""Cameras of a turntable whose geometry is unknown, from silhouettes alone.

The measure is by how much the rays through the outlines miss the body that all other views allow,
``silmesh.cameras.tangency``: one residual a point of an outline, in pixels. It is smooth enough for
least squares, which also says how well the data fix each parameter.

The model: the world turns about its axis y before one camera whose principal point is the image's
middle. Silhouettes show no scale, so the image's side spans WIDTH at the axis, and the half angle
of view says how strong the perspective is: the distance is WIDTH / 2 / tan(half angle). Weak
priors, worth one residual each, keep what the data leave open.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import torch
from scipy.optimize import OptimizeResult, least_squares

from silmesh.cameras.attempt import Attempt
from silmesh.cameras.camera import Cameras
from silmesh.cameras.tangency import Misses, Outlines, Pose, find_misses, measure_at, place, trace
from silmesh.errors import InputError

FEWEST_VIEWS = 3
WIDTH = 1.6  # of the image at the axis, in world units
SAMPLES = 32  # points of each outline
COARSE_VIEWS, COARSE_EVERY = 24, 2  # what the starts are tried on: views, every n-th point
COARSE_STEPS, FINE_STEPS, OFFSET_STEPS = 12, 20, 6  # evaluations of the residuals
NOISE = 0.3  # pixels: how well a traced outline is known
SOFT = 1.0  # pixels beyond which a residual counts less
JITTER = 0.5  # degrees: standard deviation of a turntable's errors from view to view
GAIN = 0.93  # of the rms residual: errors of the steps are kept when they bring it below this;
# they always bring it down some, to 0.99 where the steps are even, 0.94 where masks are rough
CORRELATED = 12  # residuals that are worth one, for neighbours share pixels; by made-up objects
RIVAL = 3.0  # ratio of the two directions' costs up to which the worse one is refined too
AMBIGUOUS = 1.05  # ratio of the two directions' costs under which neither is certain
CERTAIN = 0.05  # pixels: differences in residuals below this prove nothing
LEVEL = 3.0  # degrees of elevation under which a mirrored object fits as well
SUSPECT, REFUSED = 1.0, 4.0  # rms residual per 256 pixels of the image

ELEVATION, ROLL, AXIS, VIEW, STEP = range(5)  # the parameters; each view's own angle follows them
NAMES = ("elevation", "roll", "axis", "half_angle", "step")
STARTS = [(e, a) for e in (4.0, 14.0, 28.0) for a in (8.0, 20.0)]  # elevation, half angle
ARCS = (360.0, 270.0, 180.0, 120.0, 90.0)  # degrees that views at an unknown step may cover
PRIOR_SD = np.array([20.0, 3.0, np.inf, 1.0, np.inf])  # half angle: of its tangent's logarithm
PRIOR = np.array([10.0, 0.0, 0.0, math.log(math.tan(math.radians(12))), 0.0])
FIXED = np.array([2.0, 1.0, 1.0, 0.5, 0.3])  # standard deviations up to which the data fix one
SPREAD = np.array([3.0, 1.0, 3.0, 0.5, 0.1])  # typical sizes of a change
NUDGE = np.array([0.05, 0.05, 0.1, 0.02, 0.005])  # for differences; as small as pixels allow


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
        rms: root mean square of the residuals, in pixels
        view_rms: of each view
        offsets: [views] degrees by which each view's angle differs from even steps
        warnings: what a person should know, in sentences
    """

    cameras: Cameras
    estimates: dict[str, Estimate]
    row: float
    direction_certain: bool
    rms: float
    view_rms: np.ndarray
    offsets: np.ndarray
    warnings: tuple[str, ...]


def calibrate(
    silhouettes: np.ndarray,
    views: Sequence[str],
    step: float | None = None,
    elevation: float | None = None,
    above_table: bool = True,
    aspect: float = 1.0,
) -> Calibration:
    """Find the cameras of a turntable.

    Args:
        silhouettes: [views, size, size] bool, in the order in which the views were taken
        views: their names
        step: degrees from view to view, if known; its sign does not matter
        elevation: of the camera above the table in degrees, if known
        above_table: whether the camera does not look up at the table; it tells an object from
            its mirror image, which turns the other way before a camera below
        aspect: height over width of a square's image, for photographs that were stretched

    Raises:
        InputError: fewer than 3 views, a silhouette without an outline, or silhouettes that no
            turntable explains
    """
    if len(silhouettes) < FEWEST_VIEWS:
        raise InputError(
            f"cameras 'calibrate': there are {len(silhouettes)} views; it takes at least "
            f"{FEWEST_VIEWS}, and a dozen to be trusted"
        )
    turn = _Turntable(trace(silhouettes, SAMPLES), silhouettes.shape[1], above_table, aspect)
    starts = _search(turn, step, elevation)
    known = [i for i, value in ((ELEVATION, elevation), (STEP, step)) if value is not None]
    costs = [turn.cost(start) for start in starts]
    rivals = [s for s, c in zip(starts, costs, strict=True) if c < RIVAL * min(costs) + NOISE**2]
    fits = [turn.fit(start, _free(turn, known), FINE_STEPS) for start in rivals]
    costs = sorted((turn.cost(fit.x), i) for i, fit in enumerate(fits))
    certain = len(fits) == 1 or costs[1][0] > AMBIGUOUS * costs[0][0] + CERTAIN**2
    best = _fit_offsets(turn, fits[costs[0][1]], known)
    misses = turn.misses(best.x)
    _refuse_incoherent(turn, misses)
    return _report(turn, best, misses, known, views, certain)


def attempt_calibration(
    silhouettes: np.ndarray, views: Sequence[str], **known: float | bool | None
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
        "rms": found.rms,
        "view_rms": dict(zip(found.cameras.views, found.view_rms.tolist(), strict=True)),
        "offsets": dict(zip(found.cameras.views, found.offsets.tolist(), strict=True)),
    }
    return Attempt("calibrate", found.cameras, warnings=found.warnings, figures=figures)


class _Turntable:
    """The residuals of some silhouettes, as functions of all parameters.

    The parameters x are, in degrees but for two: elevation, roll, axis (pixels), logarithm of the
    half angle's tangent, step, and [views] offsets of the views from even steps.
    """

    def __init__(self, outlines: Outlines, size: int, above_table: bool, aspect: float):
        self.outlines = outlines
        self.size = size
        self.above_table = above_table
        self.aspect = aspect
        self.index = np.arange(len(outlines.points))  # of the views, in steps from the first
        low, high = outlines.points.min(axis=1), outlines.points.max(axis=1)  # [views, 2]
        self.column, self.row = ((low + high) / 2).mean(axis=0)
        from_middle = (outlines.points - [self.column, self.row]) / [1, aspect]
        reach = np.linalg.norm(from_middle, axis=2).max()
        self.radius = 1.2 * reach * WIDTH / size  # of the object about its middle, with a margin

    def thin(self) -> "_Turntable":
        """The same on fewer views and points."""
        count = len(self.index)
        kept = np.unique(np.linspace(0, count, COARSE_VIEWS, endpoint=False).astype(int))
        kept = kept if count > COARSE_VIEWS else np.arange(count)
        thin = _Turntable(self.outlines, self.size, self.above_table, self.aspect)
        thin.outlines, thin.index = self.outlines.select(kept, COARSE_EVERY), kept
        return thin

    def start(self, elevation: float, half_angle: float, step: float) -> np.ndarray:
        """Parameters with the axis amid the silhouettes."""
        log_tan = math.log(math.tan(math.radians(half_angle)))
        return np.array([elevation, 0, self.column, log_tan, step] + [0] * len(self.index))

    def rotations(self, x: np.ndarray) -> np.ndarray:
        """From the world to each view: [views, 3, 3]."""
        e, roll = np.radians(x[[ELEVATION, ROLL]])
        a = np.radians(x[STEP] * self.index + x[STEP + 1 :])
        tilt = np.array(
            [[1, 0, 0], [0, -math.cos(e), math.sin(e)], [0, -math.sin(e), -math.cos(e)]]
        )
        lean = np.array(
            [[math.cos(roll), -math.sin(roll), 0], [math.sin(roll), math.cos(roll), 0], [0, 0, 1]]
        )
        turn = np.zeros((len(a), 3, 3))
        turn[:, 0, 0], turn[:, 0, 2] = np.cos(a), -np.sin(a)
        turn[:, 2, 0], turn[:, 2, 2] = np.sin(a), np.cos(a)
        turn[:, 1, 1] = 1
        return lean @ tilt @ turn

    def camera(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """K [3, 3], R [views, 3, 3], t [views, 3]."""
        half, focal = self.size / 2, self.size / 2 / math.exp(x[VIEW])
        K = np.array([[focal, 0, half], [0, focal * self.aspect, half], [0, 0, 1]])
        unit = WIDTH / self.size  # of a pixel at the axis
        t = [(x[AXIS] - half) * unit, (self.row - half) * unit / self.aspect, focal * unit]
        return K, self.rotations(x), np.tile(t, (len(self.index), 1))

    def pose(self, x: np.ndarray) -> Pose:
        """The cameras for the kernels."""
        return place(*self.camera(x), self.outlines.points)

    def misses(self, x: np.ndarray) -> Misses:
        """The data's residuals."""
        return find_misses(self.outlines, self.pose(x), self.radius)

    def slopes(self, x: np.ndarray, misses: Misses) -> np.ndarray:
        """The data's derivatives: [views, samples, parameters]."""
        shared = len(NUDGE)
        slopes = np.zeros((*misses.pixels.shape, len(x)))
        for i, nudge in enumerate(NUDGE):
            up, down = (self.pose(x + d * np.eye(len(x))[i]) for d in (nudge, -nudge))
            at = [measure_at(self.outlines, misses, pose, pose) for pose in (up, down)]
            slopes[..., i] = (at[0] - at[1]) / (2 * nudge)
        here, nudge = self.pose(x), NUDGE[ELEVATION]
        every = np.r_[np.zeros(shared), np.ones(len(x) - shared)]
        up, down = (self.pose(x + d * every) for d in (nudge, -nudge))
        own = [measure_at(self.outlines, misses, pose, here) for pose in (up, down)]
        other = [measure_at(self.outlines, misses, here, pose) for pose in (up, down)]
        view, sample = np.nonzero(misses.view >= 0)
        missed = misses.view[view, sample]
        slopes[view, sample, shared + view] = ((own[0] - own[1]) / (2 * nudge))[view, sample]
        slopes[view, sample, shared + missed] = ((other[0] - other[1]) / (2 * nudge))[view, sample]
        return slopes

    def prior(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation of every parameter before the data."""
        sd = np.concatenate([PRIOR_SD, np.full(len(self.index), JITTER)])
        sd[AXIS] = self.size / 10
        mean = np.concatenate([PRIOR, np.zeros(len(self.index))])
        mean[AXIS] = self.column
        return mean, sd

    def fit(self, start: np.ndarray, free: np.ndarray, steps: int) -> OptimizeResult:
        """Least squares over the parameters ``free``; x of the result holds all of them."""
        mean, sd = self.prior(start)
        last: list[tuple[bytes, Misses]] = []

        def whole(part: np.ndarray) -> np.ndarray:
            x = start.copy()
            x[free] = part
            return x

        def residuals(part: np.ndarray) -> np.ndarray:
            x = whole(part)
            last[:] = [(part.tobytes(), self.misses(x))]
            return np.r_[last[0][1].pixels.ravel(), NOISE * ((x - mean) / sd)[free]]

        def jacobian(part: np.ndarray) -> np.ndarray:
            x = whole(part)
            misses = last[0][1] if last[0][0] == part.tobytes() else self.misses(x)
            data = self.slopes(x, misses).reshape(-1, len(x))[:, free]
            return np.concatenate([data, np.diag(NOISE / sd[free])])

        spread = np.r_[SPREAD, np.full(len(self.index), JITTER)]
        bounds = self._bounds(len(start))[:, free]
        found = least_squares(
            residuals, np.clip(start[free], bounds[0] + 1e-6, bounds[1] - 1e-6), jacobian,
            bounds=bounds, x_scale=spread[free], loss="soft_l1", f_scale=SOFT, tr_solver="lsmr",
            max_nfev=steps, ftol=1e-4, xtol=1e-5,
        )  # fmt: skip
        found.x = whole(found.x)
        return found

    def _bounds(self, count: int) -> np.ndarray:
        """Least and greatest parameters: [2, parameters]."""
        bounds = np.array([[-np.inf], [np.inf]]).repeat(count, axis=1)
        bounds[:, ELEVATION] = -1.0 if self.above_table else -75.0, 75.0
        bounds[:, ROLL] = -30, 30
        bounds[:, AXIS] = -self.size / 2, 1.5 * self.size
        bounds[:, VIEW] = np.log(np.tan(np.radians([1.0, 45.0])))
        return bounds

    def cost(self, x: np.ndarray) -> float:
        """Mean square of the data's residuals, in square pixels, large ones counting less."""
        square = (self.misses(x).pixels[self.outlines.known] / SOFT) ** 2
        return float(SOFT**2 * (2 * (np.sqrt(1 + square) - 1)).mean())


def _free(turn: _Turntable, known: Sequence[int], offsets: bool = False) -> np.ndarray:
    """The parameters that a fit may change."""
    free = [i for i in range(len(NAMES)) if i not in known]
    return np.array(free + [len(NAMES) + i for i in range(len(turn.index)) if offsets])


def _search(turn: _Turntable, step: float | None, elevation: float | None) -> list[np.ndarray]:
    """The best parameters of each direction of turning, found on fewer views."""
    thin = turn.thin()
    count = len(turn.index)
    steps = [abs(step)] if step is not None else [arc / count for arc in ARCS]
    starts = STARTS if step is not None else STARTS[::2]
    if elevation is not None:
        starts = [(elevation, angle) for _, angle in STARTS[:2]]
    if not turn.above_table and elevation is None:
        starts = [(sign * e, a) for e, a in starts for sign in (1, -1)]
    free = _free(thin, [STEP] if elevation is None else [STEP, ELEVATION])
    best = []
    for sign in (1, -1):
        fits = [
            thin.fit(thin.start(e, a, sign * s), free, COARSE_STEPS)
            for s in steps
            for e, a in starts
        ]
        x = min(fits, key=lambda fit: thin.cost(fit.x)).x
        best.append(np.concatenate([x[: len(NAMES)], np.zeros(count)]))
    return best


def _fit_offsets(turn: _Turntable, fit: OptimizeResult, known: Sequence[int]) -> OptimizeResult:
    """Let every view have its own angle, if that explains the silhouettes clearly better."""
    own = turn.fit(fit.x, _free(turn, known, offsets=True), OFFSET_STEPS)
    return own if turn.cost(own.x) < GAIN**2 * turn.cost(fit.x) else fit


def _refuse_incoherent(turn: _Turntable, misses: Misses) -> None:
    rms = _root_mean_square(misses.pixels[turn.outlines.known])
    allowed = REFUSED * turn.size / 256
    if rms > allowed:
        raise InputError(
            f"cameras 'calibrate': no turntable explains these silhouettes: at best their "
            f"outlines miss each other by {rms:.2g} pixels (root mean square; at most "
            f"{allowed:.2g} is accepted). Are the views in the order in which they were taken, "
            "one even step apart, the camera still, and the silhouettes whole? A known step and "
            "elevation help: turntable ',elevation,step'"
        )


def _report(
    turn: _Turntable,
    fit: OptimizeResult,
    misses: Misses,
    known: Sequence[int],
    views: Sequence[str],
    certain: bool,
) -> Calibration:
    own = fit.x[len(NAMES) :]
    estimates = _estimate(turn, fit, misses, known, _free(turn, known, offsets=bool(own.any())))
    view_rms = np.array(
        [
            _root_mean_square(r[k]) if k.any() else 0.0
            for r, k in zip(misses.pixels, turn.outlines.known, strict=True)
        ]
    )
    rms = _root_mean_square(misses.pixels[turn.outlines.known])
    K, R, t = (torch.as_tensor(part) for part in turn.camera(fit.x))
    count = len(views)
    cameras = Cameras(tuple(views), torch.full((count, 2), turn.size), K.repeat(count, 1, 1), R, t)
    warnings = tuple(_warn(turn, estimates, certain, rms, view_rms, views))
    return Calibration(cameras, estimates, turn.row, certain, rms, view_rms, own, warnings)


def _estimate(
    turn: _Turntable, fit: OptimizeResult, misses: Misses, known: Sequence[int], free: np.ndarray
) -> dict[str, Estimate]:
    """Values with their deviations, from the curvature of the cost where the fit ended."""
    noise = max(NOISE, _root_mean_square(misses.pixels[turn.outlines.known]))
    data = turn.slopes(fit.x, misses).reshape(-1, len(fit.x))[:, free]
    _, prior_sd = turn.prior(fit.x)
    precision = data.T @ data / (CORRELATED * noise**2) + np.diag(prior_sd[free] ** -2.0)
    sd = np.zeros(len(fit.x))
    sd[free] = np.sqrt(np.diag(np.linalg.pinv(precision)))
    values = fit.x[: len(NAMES)].copy()
    values[VIEW] = math.degrees(math.atan(math.exp(values[VIEW])))
    status = ["found" if s <= most else "open" for s, most in zip(sd, FIXED, strict=False)]
    sd[VIEW] *= math.degrees(math.sin(2 * math.radians(values[VIEW])) / 2)  # d angle / d log tan
    return {
        name: Estimate(float(values[i]), float(sd[i]), "given" if i in known else status[i])
        for i, name in enumerate(NAMES)
    }


def _warn(
    turn: _Turntable,
    estimates: dict[str, Estimate],
    certain: bool,
    rms: float,
    view_rms: np.ndarray,
    views: Sequence[str],
) -> list[str]:
    """What a person should know of the result, in sentences."""
    said = [
        f"{name} is not fixed by the silhouettes: {e.value:.3g} +- {e.sd:.2g} is mostly a guess"
        for name, e in estimates.items()
        if e.status == "open"
    ]
    elevation = estimates["elevation"].value
    if not certain:
        said.append(
            "both directions of turning explain the silhouettes; if the mesh is mirrored, "
            "it is the other one"
        )
    elif abs(elevation) < LEVEL:
        said.append(
            f"the camera looks almost level ({elevation:.2g} degrees), where a mirrored object "
            "that turns the other way looks the same; the direction may be wrong"
        )
    if rms > SUSPECT * turn.size / 256:
        worst = sorted(range(len(views)), key=lambda i: -view_rms[i])[:3]
        listed = ", ".join(f"{views[i]!r} ({view_rms[i]:.2g})" for i in worst)
        said.append(
            f"the outlines miss each other by {rms:.2g} pixels; the views that miss most are "
            f"{listed}: look at their silhouettes, and at the order of the views"
        )
    return said


def _root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))
