"""A turntable before which each view was cropped, and scaled or not: a shift and a scale a view.

A pixel p of the camera that stands still lies at s r p + d in the cropped view, with the shift d
and the scale s of the view, and the known scale r of its working image. The residuals are those of
``silmesh.cameras.turntable_residuals``, over these beside the turntable's own parameters. They
start from what the frontier points say of each crop (``silmesh.cameras.frontier``).

Nothing shows the world's scale, so the mean of the scales' logarithms is 0, and the camera before
the crops looks at the axis. Where the object stands beside the axis shows in the shifts, and apart
from them only in the perspective.
"""

from dataclasses import dataclass, replace

import numpy as np

from silmesh.cameras.crop_gauge import aim
from silmesh.cameras.crop_squares import CropSquares
from silmesh.cameras.frontier import NUDGE as CROP_NUDGE
from silmesh.cameras.frontier import SCALE, SHIFT_X, SHIFT_Y, Frontier, to_maps, trace_hulls
from silmesh.cameras.gauss_newton import Problem, minimise
from silmesh.cameras.silhouette_coherence import Misses, measure_at
from silmesh.cameras.turntable_residuals import ELEVATION, Turntable

OWN = 3  # parameters of a view's crop
# Standard deviations of the priors: of shifts, in sizes of the image, and of a scale's logarithm.
SPREAD = np.array([0.25, 0.25, 0.3])
# Weight of these beside the frontier points of the start; steps of that.
START_PRIOR, FRONTIER_STEPS = 1e-4, 10


@dataclass(frozen=True)
class Cropped:
    """The residuals of cropped views, as functions of all parameters.

    The parameters x are those of ``Turntable``, and then the crops [views, 3] of the views with an
    outline: shifts in pixels and the logarithm of the scale.

    Attributes:
        turn: whose camera looks at the middle of its image
        hulls: [views, n, 2] outermost points of the outlines, in pixels
        ratios: [views, 2] known scales of the working images, about 1 in the mean
        whole: [views] bool, whose outermost points are the object's and not the frame's
        scaled: whether the crops were scaled by more than that
        level: whether the mean of the scales' logarithms is 0, since the world's scale is free
    """

    turn: Turntable
    hulls: np.ndarray
    ratios: np.ndarray
    whole: np.ndarray
    scaled: bool = True
    level: bool = True

    @staticmethod
    def of(turn: Turntable, ratios: np.ndarray, tight: bool = False) -> "Cropped":
        """Of views that were cropped to the object.

        Args:
            tight: by its box, so that an outline at the frame is the object's
        """
        hulls = trace_hulls(turn.outlines.distances)
        maps = to_maps(_start_crops(hulls, ratios, turn.size, True), ratios)
        whole = Turntable(
            turn.outlines, turn.size, turn.aspect, turn.distance, turn.index, maps=maps
        )
        whole.column = whole.row = turn.size / 2
        known = np.ones(len(hulls), bool) if tight else ~turn.outlines.cut
        return Cropped(whole, hulls, ratios, known)

    def select(self, views: np.ndarray, every: int = 1) -> "Cropped":
        """The same of these views, and every so many-th of their points."""
        part = self.turn.select(views, every)
        hulls, ratios, whole = (v[views] for v in (self.hulls, self.ratios, self.whole))
        return replace(self, turn=part, hulls=hulls, ratios=ratios, whole=whole)

    def only(self, samples: np.ndarray) -> "Cropped":
        """The same with residuals only at some points of outlines, [samples] bool."""
        return replace(self, turn=self.turn.only(samples))

    def thin(self, views: int, samples: int) -> tuple["Cropped", np.ndarray]:
        """The same of fewer views and points, for a search, and the positions of the views."""
        count = len(self.hulls)
        kept = np.arange(count)
        if count > views:
            kept = np.unique(np.linspace(0, count, views, endpoint=False).astype(int))
        return self.select(kept, max(1, self.turn.outlines.known.shape[1] // samples)), kept

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The turntable's parameters, and the crops [views, 3], whose mean scale is 1."""
        views = len(self.hulls)
        return x[: -OWN * views], self.levelled(x[-OWN * views :].reshape(views, OWN))

    def at(self, x: np.ndarray) -> tuple[Turntable, np.ndarray]:
        """The turntable with the crops, and its own parameters."""
        own, crops = self.split(x)
        return self.turn.cropped(to_maps(crops, self.ratios)), own

    def start(self, elevation: float, half_angle: float, step: float) -> np.ndarray:
        """Parameters to start from: the crops by which the frontier points agree."""
        x = self.turn.start(elevation, half_angle, step)
        return self.agree(x, self.start_crops())

    def start_crops(self) -> np.ndarray:
        """Crops [views, 3] by which all outlines' boxes are as high, and their middles the same."""
        return _start_crops(self.hulls, self.ratios, self.turn.size, self.scaled)

    def agree(self, own: np.ndarray, crops: np.ndarray) -> np.ndarray:
        """All parameters, for those of the turntable, from frontier points.

        Args:
            own: of the turntable
            crops: [views, 3] to start from; what the frontier points leave open stays so
        """
        frontier = self.frontier(own)
        views = len(crops)
        free = self.own_crops(0)

        def whole(part: np.ndarray) -> np.ndarray:
            x = crops.ravel().copy()
            x[free] = part
            return self.levelled(x.reshape(views, OWN))

        def slopes(part: np.ndarray) -> np.ndarray:
            return self.levelled(frontier.slopes(whole(part))).reshape(rows, -1)[:, free]

        rows = 2 * len(frontier.first)
        problem = Problem(
            lambda part: frontier.residuals(whole(part)).ravel(),
            slopes,
            np.full(rows, views / max(rows, 1)),
            crops.ravel()[free],
            START_PRIOR * self.spread()[free] ** -2.0,
            *np.full((2, len(free)), np.inf) * [[-1], [1]],
        )
        found = whole(minimise(problem, crops.ravel()[free], FRONTIER_STEPS))
        return np.r_[own, found.ravel()]

    def frontier(self, own: np.ndarray) -> Frontier:
        """The frontier points at parameters of the turntable."""
        camera = self.turn.camera(own)
        return Frontier.of(camera, np.zeros(3), self.hulls, self.ratios, self.whole)

    def spread(self) -> np.ndarray:
        """Standard deviations of the crops' priors: [views * 3]."""
        size = self.turn.size
        return np.tile(SPREAD * [size, size, 1], len(self.hulls))

    def levelled(self, values: np.ndarray) -> np.ndarray:
        """Crops, or derivatives by them, [..., views, 3], with a mean scale of 1 where it is so."""
        if self.level:
            values = values.copy()
            values[..., SCALE] -= values[..., SCALE].mean(axis=-1, keepdims=True)
        return values

    def own_crops(self, first: int) -> np.ndarray:
        """Positions of what is free of the crops, which come after ``first`` others."""
        own = [SHIFT_X, SHIFT_Y, *([SCALE] if self.scaled else [])]
        return first + (OWN * np.arange(len(self.hulls))[:, None] + own).ravel()

    def misses(self, x: np.ndarray) -> Misses:
        """The residuals, without the priors."""
        turn, own = self.at(x)
        return turn.misses(own)

    def slopes(self, x: np.ndarray, misses: Misses) -> np.ndarray:
        """The derivatives of the residuals: [views, samples, parameters]."""
        turn, own = self.at(x)
        shared = turn.slopes(own, misses)
        crops = np.zeros((*misses.pixels.shape, len(self.hulls), OWN))
        for i in range(OWN):
            self._add_slopes(crops, x, misses, i)
        views, samples = misses.pixels.shape
        return np.concatenate([shared, self.levelled(crops).reshape(views, samples, -1)], axis=2)

    def _add_slopes(self, slopes: np.ndarray, x: np.ndarray, misses: Misses, i: int) -> None:
        """Add the derivatives by parameter i of the crops: of a ray's view, and of what it misses.

        Args:
            slopes: [views, samples, views, OWN]
        """
        turn, own = self.at(x)
        crops, outlines, here = self.split(x)[1], turn.outlines, turn.pose(own)
        view, sample = np.nonzero(misses.view >= 0)
        missed, nudge = misses.view[view, sample], CROP_NUDGE[i]
        up, down = (
            turn.cropped(to_maps(crops + d * np.eye(OWN)[i], self.ratios)).pose(own)
            for d in (nudge, -nudge)
        )
        own_side = [measure_at(outlines, misses, pose, here) for pose in (up, down)]
        far_side = [measure_at(outlines, misses, here, pose) for pose in (up, down)]
        change = (own_side[0] - own_side[1])[view, sample] / (2 * nudge)
        slopes[view, sample, view, i] += change
        change = (far_side[0] - far_side[1])[view, sample] / (2 * nudge)
        slopes[view, sample, missed, i] += change

    def fit(
        self, start: np.ndarray, shared: np.ndarray, steps: int, frontier: bool = True
    ) -> np.ndarray:
        """Least squares over the crops and the parameters ``shared`` of the turntable.

        Args:
            frontier: whether the frontier points count too, as ``CropSquares`` has it
        """
        own, crops = self.split(CropSquares(self, start, shared, frontier).minimise(steps))
        if self.level and ELEVATION in shared:
            own, crops = aim(self.turn, own, crops, self.middles(), self.ratios)
        return np.r_[own, crops.ravel()]

    def middles(self) -> np.ndarray:
        """Of the outlines' boxes: [views, 2] pixels, NaN where the frame cuts the object."""
        middles = (self.hulls.min(axis=1) + self.hulls.max(axis=1)) / 2
        return np.where(self.whole[:, None], middles, np.nan)

    def cost(self, x: np.ndarray) -> float:
        """Mean soft L1 loss of the residuals, in square pixels."""
        turn, own = self.at(x)
        return turn.cost(own)

    def view_costs(self, x: np.ndarray) -> np.ndarray:
        """The cost of each view: [views]."""
        turn, own = self.at(x)
        return turn.view_costs(own)


def _start_crops(hulls: np.ndarray, ratios: np.ndarray, size: int, scaled: bool) -> np.ndarray:
    """Crops [views, 3] by which all outlines are as high, and their boxes' middles the same."""
    low, high = hulls.min(axis=1), hulls.max(axis=1)
    crops = np.zeros((len(hulls), OWN))
    if scaled:
        height = np.log((high - low)[:, 1] / ratios[:, 1])
        crops[:, SCALE] = height - height.mean()
    scale = ratios * np.exp(crops[:, SCALE:])
    crops[:, :SCALE] = (low + high) / 2 - scale * size / 2
    return crops
