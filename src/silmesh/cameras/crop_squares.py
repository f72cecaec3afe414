"""Robust least squares over a turntable and the crops of its views (``silmesh.cameras.crops``)."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from silmesh.cameras.frontier import Frontier
from silmesh.cameras.gauss_newton import Problem, minimise, remember_last
from silmesh.cameras.turntable_residuals import AXIS, INDEPENDENT, NOISE, NUDGE

if TYPE_CHECKING:
    from silmesh.cameras.crops import Cropped


@dataclass
class CropSquares:
    """What is minimised over the crops and some parameters of the turntable.

    Attributes:
        cropped: the views
        start: all parameters; those that are not free stay so
        shared: of the turntable, that are free
        frontier: whether the frontier points count beside the outlines, as much as all these
            together: they lead out of local minima, but are less exact
    """

    cropped: "Cropped"
    start: np.ndarray
    shared: np.ndarray
    frontier: bool
    free: np.ndarray = field(init=False)
    touching: Frontier = field(init=False)

    def __post_init__(self) -> None:
        own = self.cropped.split(self.start)[0]
        self.shared = np.setdiff1d(self.shared, [AXIS]).astype(int)
        self.free = np.r_[self.shared, self.cropped.own_crops(len(own))].astype(int)
        self.touching = self.cropped.frontier(own)

    def minimise(self, steps: int) -> np.ndarray:
        """All parameters after at most so many steps."""
        return self._whole(minimise(self._problem(), self.start[self.free], steps))

    def _problem(self) -> Problem:
        cropped, free = self.cropped, self.free
        turn, (own, crops) = cropped.turn, cropped.split(self.start)
        mean, sd = turn.prior()
        mean, sd = np.r_[mean, crops.ravel()], np.r_[sd, cropped.spread()]
        worth = NOISE**2 * turn.outlines.known.shape[1] / INDEPENDENT
        limits = np.full((2, len(self.start)), np.inf) * [[-1], [1]]
        limits[:, : len(own)] = turn.limits(own)
        known = turn.outlines.known.ravel()
        pairs = 2 * len(self.touching.first) * self.frontier
        weights = np.r_[known, np.full(pairs, known.sum() / max(pairs, 1))]
        precision = worth * sd[free] ** -2.0
        return Problem(
            self._residuals, self._slopes, weights, mean[free], precision, *limits[:, free]
        )

    def _whole(self, part: np.ndarray) -> np.ndarray:
        x = self.start.copy()
        x[self.free] = part
        return x

    @cached_property
    def _misses(self):
        return remember_last(lambda part: self.cropped.misses(self._whole(part)))

    def _residuals(self, part: np.ndarray) -> np.ndarray:
        pixels = self._misses(part).pixels.ravel()
        return np.r_[pixels, self._touch(self._whole(part))] if self.frontier else pixels

    def _slopes(self, part: np.ndarray) -> np.ndarray:
        x = self._whole(part)
        data = self.cropped.slopes(x, self._misses(part)).reshape(-1, len(x))[:, self.free]
        if not self.frontier:
            return data
        return np.concatenate([data, self._slope(x)[:, self.free]])

    def _touch(self, x: np.ndarray) -> np.ndarray:
        own, crops = self.cropped.split(x)
        moved = self.touching.of_cameras(self.cropped.turn.camera(own), np.zeros(3))
        return moved.residuals(crops).ravel()

    def _slope(self, x: np.ndarray) -> np.ndarray:
        """Derivatives of the frontier points' residuals: [residuals, parameters]."""
        own, crops = self.cropped.split(x)
        moved = self.touching.of_cameras(self.cropped.turn.camera(own), np.zeros(3))
        rows = 2 * len(self.touching.first)
        slopes = np.zeros((rows, len(x)))
        slopes[:, len(own) :] = self.cropped.levelled(moved.slopes(crops)).reshape(rows, -1)
        for i in self.shared:
            step = NUDGE[i] * np.eye(len(x))[i]
            up, down = (self._touch(x + side * step) for side in (1, -1))
            slopes[:, i] = (up - down) / (2 * NUDGE[i])
        return slopes
