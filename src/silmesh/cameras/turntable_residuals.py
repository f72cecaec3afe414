"""The residuals of a turntable's silhouettes, as functions of its geometry, and their fit.

A residual is the distance, in pixels, by which the ray through a point of an outline misses the
visual hull of the other views (``silmesh.cameras.silhouette_coherence``). Each sampled point of an
outline gives one residual.

The model has one camera that stands still, whose principal point is the image's middle, and a world
that turns about its axis y. Silhouettes do not show scale, so the scale is fixed: the image's side
spans WIDTH at the axis. The half angle of view gives the strength of the perspective, since the
camera's distance is WIDTH / 2 / tan(half angle). Each parameter has a weak prior, which weighs as
much as one measurement and decides only what the silhouettes leave open.

Several rounds of one object share the camera's intrinsics and the axis of the world. Before each
round but the first the camera may have been moved, so each has an elevation, a roll, an axis and a
row of its own, a distance (as a factor of the first round's), a step, and a phase: the turn of its
first view against that of the first round.
"""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from silmesh.cameras.gauss_newton import SOFT, remember_last, soft_l1
from silmesh.cameras.silhouette_coherence import (
    Misses,
    Outlines,
    Pose,
    find_misses,
    make_pose,
    measure_at,
    uncrop,
)

WIDTH = 1.6  # world units that the image's side spans at the axis
# The search for a start uses at most so many views, and about so many points of each outline.
COARSE_VIEWS, COARSE_SAMPLES = 24, 16
NOISE = 0.15  # pixels: standard deviation of a point on a traced outline
JITTER = 0.5  # degrees: prior standard deviation of a view's angle about its even step
# The errors along an edge are correlated, so all points of an outline together weigh as much as
# this many independent measurements.
INDEPENDENT = 3

# Positions of the shared parameters in a vector; the offsets of the single views come after them.
ELEVATION, ROLL, AXIS, VIEW, STEP = range(5)
NAMES = ("elevation", "roll", "axis", "half_angle", "step")
# What each round after the first has of its own, in this order, after what NAMES lists.
ROUND = ("elevation", "roll", "axis", "row", "distance", "phase", "step")
# Where what the first round has too stands among NAMES, and in ROUND.
OF_FIRST, OF_ROUND = [ELEVATION, ROLL, AXIS, STEP], [0, 1, 2, 6]
ROW, FARTHER, PHASE = 3, 4, 5  # within ROUND; the distance is the logarithm of the factor
# Standard deviations and means of the priors, in the order of NAMES and in the units of the
# parameters: degrees, pixels for the axis, and the logarithm of its tangent for the half angle.
PRIOR_SD = np.array([20.0, 3.0, np.inf, 1.0, np.inf])
PRIOR = np.array([10.0, 0.0, 0.0, math.log(math.tan(math.radians(12))), 0.0])
DISTANCE_SD = 0.25  # standard deviation of the logarithm of a distance that the user gave
OVER = 1.0  # degrees: how far a fit that starts above the table may go below it, and vice versa
SPREAD = np.array([3.0, 1.0, 3.0, 0.5, 0.1])  # scale of each parameter for the optimiser
# Steps of the central differences that give the derivatives: as small as the pixels allow.
NUDGE = np.array([0.05, 0.05, 0.1, 0.02, 0.005])
# Changes that are large enough to show in the silhouettes, for the secants that give the standard
# deviations. The change of the step is that over the whole turn.
PROBE = np.array([2.0, 0.7, 1.0, 0.3, 1.5])
# The same of a round's own parameters, in the order of ROUND. Axis and row are expected in the
# middle of the round's silhouettes, with a deviation of a tenth of the image's side.
ROUND_SD = np.array([30.0, 3.0, np.inf, np.inf, 0.3, np.inf, np.inf])
ROUND_PRIOR = np.array([20.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
ROUND_SPREAD = np.array([3.0, 1.0, 3.0, 3.0, 0.1, 3.0, 0.1])
ROUND_NUDGE = np.array([0.05, 0.05, 0.1, 0.1, 0.002, 0.05, 0.005])
ROUND_PROBE = np.array([2.0, 0.7, 1.0, 1.0, 0.05, 1.5, 1.5])


class Turntable:
    """The residuals of silhouettes, as functions of all parameters of the turntable.

    The parameters x are, in degrees but for two: elevation, roll, axis (pixels), logarithm of the
    half angle's tangent, step; those of ``ROUND`` of each round after the first (axis and row in
    pixels, distance the logarithm of a factor); and [views] offsets of the views from even steps.

    Args:
        outlines: of the silhouettes
        size: of their square images
        aspect: height over width of a square's image
        distance: of the camera from the axis in sizes of the object, if it is known roughly
        index: [views] position of each view among all photographs; 0, 1, 2, ... if not given
        rounds: positions of the photographs of each round, in the order of its turn; one round of
            all if not given
        maps: [views, 2, 2] scale (x, y) and shift (x, y) by which each view was cropped; None if
            none was

    Attributes:
        shared: how many parameters come before the offsets
    """

    def __init__(
        self,
        outlines: Outlines,
        size: int,
        aspect: float = 1.0,
        distance: float | None = None,
        index: np.ndarray | None = None,
        rounds: Sequence[np.ndarray] = (),
        maps: np.ndarray | None = None,
    ):
        self.outlines = outlines
        self.size = size
        self.aspect = aspect
        self.distance = distance
        self.index = np.arange(len(outlines.points)) if index is None else index
        self.maps = maps
        self.rounds = tuple(rounds) if len(rounds) > 1 else ()
        self.shared = len(NAMES) + len(ROUND) * max(len(self.rounds) - 1, 0)
        points = outlines.points if maps is None else uncrop(outlines.points, maps)
        low, high = points.min(axis=1), points.max(axis=1)  # [views, 2]
        middles = (low + high) / 2
        of = [np.isin(self.index, turn) for turn in self.rounds or [self.index]]
        self.middles = [middles[views].mean(axis=0) for views in of]  # column and row, a round each
        self.column, self.row = self.middles[0]
        each = zip(of, self.middles, strict=True)
        self.reach = max(self._reach(points[views], middle) for views, middle in each)  # pixels
        self.radius = 1.2 * self.reach * WIDTH / size  # about the object's middle, with a margin

    def _reach(self, points: np.ndarray, middle: np.ndarray) -> float:
        """Pixels from a middle to the farthest of some points."""
        from_middle = (points - middle) / [1, self.aspect]
        return np.linalg.norm(from_middle, axis=2).max()

    def select(self, views: np.ndarray, every: int = 1) -> "Turntable":
        """The same on these views, and every so many-th of their points."""
        maps = None if self.maps is None else self.maps[views]
        return self.of(self.outlines.select(views, every), self.index[views], maps)

    def alone(self, views: np.ndarray) -> "Turntable":
        """A turntable whose silhouettes are those of these views alone."""
        outlines, index = self.outlines.select(views), self.index[views]
        maps = None if self.maps is None else self.maps[views]
        return Turntable(outlines, self.size, self.aspect, self.distance, index, self.rounds, maps)

    def cropped(self, maps: np.ndarray) -> "Turntable":
        """The same turntable before views that were cropped so."""
        return self.of(self.outlines, self.index, maps)

    def in_rounds(self, rounds: Sequence[np.ndarray]) -> "Turntable":
        """The same silhouettes, taken in these rounds; views of no round are left out."""
        views = np.flatnonzero(np.isin(self.index, np.concatenate(rounds)))
        outlines, index = self.outlines.select(views), self.index[views]
        return Turntable(outlines, self.size, self.aspect, self.distance, index, rounds)

    def round_alone(self, number: int) -> "Turntable":
        """A round as a turntable of its own; its views have their positions in it."""
        turn = self.rounds[number]
        views = np.flatnonzero(np.isin(self.index, turn))
        place = {position: step for step, position in enumerate(turn)}
        index = np.array([place[position] for position in self.index[views]])
        outlines = self.outlines.select(views)
        return Turntable(outlines, self.size, self.aspect, self.distance, index)

    def thin(self) -> "Turntable":
        """The same turntable with fewer views and points, for the search."""
        count = len(self.index)
        kept = np.unique(np.linspace(0, count, COARSE_VIEWS, endpoint=False).astype(int))
        kept = kept if count > COARSE_VIEWS else np.arange(count)
        every = max(1, self.outlines.known.shape[1] // COARSE_SAMPLES)
        return self.select(kept, every)

    def sparse(self) -> "Turntable":
        """The same turntable with every other point of the outlines."""
        return self.select(np.arange(len(self.index)), 2)

    def only(self, samples: np.ndarray) -> "Turntable":
        """The same turntable with residuals only at some points of outlines, [samples] bool."""
        known = self.outlines.known & samples
        return self.of(replace(self.outlines, known=known), self.index, self.maps)

    def cameras_at(
        self, x: np.ndarray, positions: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The cameras at the first so many positions of the turn, with or without a silhouette.

        Returns:
            K [3, 3], R [positions, 3, 3], t [positions, 3], and the views' offsets from even steps
            [positions], 0 without a silhouette
        """
        offsets = np.zeros(positions)
        offsets[self.index] = x[self.shared :]
        whole = self.of(self.outlines, np.arange(positions))
        return *whole.camera(np.r_[x[: self.shared], offsets]), offsets

    def of(
        self, outlines: Outlines, index: np.ndarray, maps: np.ndarray | None = None
    ) -> "Turntable":
        """The same turntable with other outlines: their parameters mean the same."""
        part = copy(self)
        part.outlines, part.index, part.maps = outlines, index, maps
        return part

    def widen(self, shared: np.ndarray) -> np.ndarray:
        """Parameters with no offsets: those that are shared, as these or as a longer vector has."""
        return np.concatenate([shared[: self.shared], np.zeros(len(self.index))])

    def start(self, elevation: float, half_angle: float, step: float) -> np.ndarray:
        """Parameters of one round to start from, the axis in the middle of the silhouettes."""
        log_tan = math.log(math.tan(math.radians(half_angle)))
        return np.array([elevation, 0, self.column, log_tan, step] + [0] * len(self.index))

    def parameters_of(self, x: np.ndarray, number: int) -> np.ndarray:
        """The parameters of a round, in the order of ``ROUND``."""
        if number:
            return x[part_of(number)]
        first = np.zeros(len(ROUND))
        first[OF_ROUND], first[ROW] = x[OF_FIRST], self.row
        return first

    def rotations(self, x: np.ndarray) -> np.ndarray:
        """The rotations from the world to each camera: [views, 3, 3]."""
        offsets = x[self.shared :]
        if not self.rounds:
            return rotate(x[ELEVATION], x[ROLL], x[STEP] * self.index + offsets)
        R = np.zeros((len(self.index), 3, 3))
        for number, (views, steps) in enumerate(self._places()):
            own = self.parameters_of(x, number)
            angles = own[PHASE] + own[-1] * steps + offsets[views]
            R[views] = rotate(own[0], own[1], angles)
        return R

    def _places(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The views of each round, and how many steps each is from its first."""
        found = []
        for turn in self.rounds:
            views = np.flatnonzero(np.isin(self.index, turn))
            order = np.argsort(turn)
            found.append((views, order[np.searchsorted(turn, self.index[views], sorter=order)]))
        return found

    def camera(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """K [3, 3], R [views, 3, 3], t [views, 3]."""
        half, focal = self.size / 2, self.size / 2 / math.exp(x[VIEW])
        K = np.array([[focal, 0, half], [0, focal * self.aspect, half], [0, 0, 1]])
        unit = WIDTH / self.size  # of a pixel at the axis
        t = [(x[AXIS] - half) * unit, (self.row - half) * unit / self.aspect, focal * unit]
        t = np.tile(t, (len(self.index), 1))
        for number, (views, _) in enumerate(self._places()[1:], start=1):
            own = self.parameters_of(x, number)
            there = [own[2] - half, (own[ROW] - half) / self.aspect, focal]
            t[views] = np.multiply(there, unit * math.exp(own[FARTHER]))
        return K, self.rotations(x), t

    def pose(self, x: np.ndarray) -> Pose:
        """The cameras, as the kernels take them."""
        return make_pose(*self.camera(x), self.outlines.points, self.maps)

    def misses(self, x: np.ndarray) -> Misses:
        """The residuals, without the priors."""
        return find_misses(self.outlines, self.pose(x), self.radius)

    def slopes(self, x: np.ndarray, misses: Misses) -> np.ndarray:
        """The derivatives of the residuals, 0 where a ray hits: [views, samples, parameters]."""
        shared = self.shared
        slopes = np.zeros((*misses.pixels.shape, len(x)))
        for i, nudge in enumerate(self._each(NUDGE, ROUND_NUDGE)):
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

    def _each(self, first: np.ndarray, later: np.ndarray) -> np.ndarray:
        """A value of each shared parameter: [shared]."""
        return np.concatenate([first, *[later] * (len(self.rounds) - 1)])

    def secants(self, x: np.ndarray) -> np.ndarray:
        """Differences over large changes of shared parameters: [views, samples, parameters].

        A residual is 0 as long as its ray hits, so it has no derivative where silhouettes and
        cameras agree, although the silhouettes may fix the parameters well.
        """
        probes = self._each(PROBE, ROUND_PROBE)
        steps = [len(turn) for turn in self.rounds] or [len(self.index)]
        probes[self.of_rounds(STEP)] /= steps
        sides = [
            [self.misses(x + side * probe * np.eye(len(x))[i]).pixels for side in (1, -1)]
            for i, probe in enumerate(probes)
        ]
        each = [(up - down) / (2 * p) for (up, down), p in zip(sides, probes, strict=True)]
        return np.stack(each, axis=-1)

    def of_rounds(self, name: int) -> list[int]:
        """Where a parameter that each round has stands: one of ``OF_FIRST``."""
        return [place_of(name, number) for number in range(max(1, len(self.rounds)))]

    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation of the prior of each parameter: each [parameters]."""
        views = len(self.index)
        sd = np.concatenate([self._each(PRIOR_SD, ROUND_SD), np.full(views, JITTER)])
        sd[self.of_rounds(AXIS)] = self.size / 10
        mean = np.concatenate([self._each(PRIOR, ROUND_PRIOR), np.zeros(views)])
        mean[AXIS] = self.column
        for number in range(1, len(self.rounds)):
            part = part_of(number)
            mean[part][[2, ROW]] = self.middles[number]
            sd[part][ROW] = self.size / 10
        if self.distance is not None:  # the object's size is twice its reach
            mean[VIEW] = math.log(self.size / 2 / (2 * self.reach * self.distance))
            sd[VIEW] = DISTANCE_SD
        return mean, sd

    def fit(self, start: np.ndarray, free: np.ndarray, steps: int) -> OptimizeResult:
        """Least squares over the parameters ``free``; x of the result holds all of them.

        A camera that starts above the table stays there, and so does one below.
        """
        mean, sd = self.prior()
        # A prior weighs as much as one of INDEPENDENT measurements, not as one of all samples.
        worth = NOISE * math.sqrt(self.outlines.known.shape[1] / INDEPENDENT)

        def whole(part: np.ndarray) -> np.ndarray:
            x = start.copy()
            x[free] = part
            return x

        misses = remember_last(lambda part: self.misses(whole(part)))

        def residuals(part: np.ndarray) -> np.ndarray:
            return np.r_[misses(part).pixels.ravel(), worth * ((whole(part) - mean) / sd)[free]]

        def jacobian(part: np.ndarray) -> np.ndarray:
            data = self.slopes(whole(part), misses(part)).reshape(-1, len(start))[:, free]
            return np.concatenate([data, np.diag(worth / sd[free])])

        spread = np.r_[self._each(SPREAD, ROUND_SPREAD), np.full(len(self.index), JITTER)]
        bounds = self.limits(start)[:, free]
        found = least_squares(
            residuals, np.clip(start[free], bounds[0] + 1e-6, bounds[1] - 1e-6), jacobian,
            bounds=bounds, x_scale=spread[free], loss="soft_l1", f_scale=SOFT, tr_solver="lsmr",
            max_nfev=steps, ftol=1e-4, xtol=1e-5,
        )  # fmt: skip
        found.x = whole(found.x)
        return found

    def limits(self, start: np.ndarray) -> np.ndarray:
        """The least and greatest values that a fit may reach: [2, parameters]."""
        bounds = np.array([[-np.inf], [np.inf]]).repeat(len(start), axis=1)
        for i in self.of_rounds(ELEVATION):
            bounds[:, i] = (-OVER, 75) if start[i] >= 0 else (-75, OVER)
        bounds[:, self.of_rounds(ROLL)] = [[-30], [30]]
        bounds[:, self.of_rounds(AXIS)] = [[-self.size / 2], [1.5 * self.size]]
        bounds[:, VIEW] = np.log(np.tan(np.radians([1.0, 45.0])))
        return bounds

    def cost(self, x: np.ndarray) -> float:
        """Mean soft L1 loss of the residuals, in square pixels."""
        return float(self._squares(x)[self.outlines.known].mean())

    def view_costs(self, x: np.ndarray) -> np.ndarray:
        """The cost of each view: [views]; 0 for one without an outline."""
        known = self.outlines.known
        return (self._squares(x) * known).sum(axis=1) / np.maximum(known.sum(axis=1), 1)

    def _squares(self, x: np.ndarray) -> np.ndarray:
        return soft_l1(self.misses(x).pixels)

    def excess(self, better: float, worse: float) -> float:
        """By how many standard errors the cost ``worse`` exceeds the cost ``better``."""
        square = INDEPENDENT * len(self.index) * (worse - better) / max(better, NOISE**2)
        return math.copysign(math.sqrt(abs(square)), square)

    def mirrored(self, x: np.ndarray) -> np.ndarray:
        """The parameters at which distant cameras see the mirrored object the same.

        Negating depth, with D = diag(1, 1, -1), takes R = lean tilt(e) turn(a) to D R = R' D with
        R' = lean tilt(-e) turn(-a).
        """
        twin = x.copy()
        twin[self.of_rounds(ELEVATION)] *= -1
        twin[self.of_rounds(STEP)] *= -1
        twin[[part_of(number).start + PHASE for number in range(1, len(self.rounds))]] *= -1
        twin[self.shared :] *= -1
        return twin


def part_of(number: int) -> slice:
    """Where a round's own parameters stand; not of the first, whose are those of ``NAMES``."""
    first = len(NAMES) + len(ROUND) * (number - 1)
    return slice(first, first + len(ROUND))


def place_of(name: int, number: int) -> int:
    """Where a parameter stands of a round: one of ``OF_FIRST``, which every round has."""
    return part_of(number).start + OF_ROUND[OF_FIRST.index(name)] if number else name


def rotate(elevation: float, roll: float, angles: np.ndarray) -> np.ndarray:
    """lean(roll) tilt(elevation) turn(angle) of each angle, all in degrees: [angles, 3, 3]."""
    e, roll = np.radians([elevation, roll])
    a = np.radians(angles)
    tilt = np.array([[1, 0, 0], [0, -math.cos(e), math.sin(e)], [0, -math.sin(e), -math.cos(e)]])
    lean = np.array(
        [[math.cos(roll), -math.sin(roll), 0], [math.sin(roll), math.cos(roll), 0], [0, 0, 1]]
    )
    turn = np.zeros((len(a), 3, 3))
    turn[:, 0, 0], turn[:, 0, 2] = np.cos(a), -np.sin(a)
    turn[:, 2, 0], turn[:, 2, 2] = np.sin(a), np.cos(a)
    turn[:, 1, 1] = 1
    return lean @ tilt @ turn
