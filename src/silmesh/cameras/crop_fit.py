"""The turntable of views that were cropped one by one: search, refinement, and what fits as well.

It is what ``silmesh.cameras.turntable_fit`` does for views that were not, with the crops as further
unknowns (``silmesh.cameras.crops``): on few views and points (``silmesh.cameras.crop_search``),
then on all of them, with angles of their own if the steps are not even, and without the views that
disagree.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from scipy.optimize import OptimizeResult

from silmesh.cameras.consensus import Consensus
from silmesh.cameras.crop_deviations import find_deviations
from silmesh.cameras.crop_gauge import move_world
from silmesh.cameras.crop_search import find_free, search_crops
from silmesh.cameras.crops import Cropped
from silmesh.cameras.turntable_fit import (
    BETTER,
    FEWEST_AGREEING,
    FOLDS,
    OFFSET_STEPS,
    REFUSED_AGREEING,
    SUSPECT,
    Given,
    TurntableFit,
    root_mean_square,
)
from silmesh.cameras.turntable_residuals import NOISE, Turntable
from silmesh.progress import Share, untold, within

FINE_STEPS = 15  # of a fit of all views
SEARCHED, FITTED = 0.5, 0.8  # shares of the time after which these steps end
# Median change by a crop, in sizes of the image and parts of the scale, from which it is one.
LEAST_CHANGE = np.array([0.005, 0.005, 0.005])
TWICE = 3.0  # a view disagrees from so many times the median of all views' residuals


@dataclass(frozen=True)
class CropFit:
    """A turntable of cropped views.

    Attributes:
        cropped: all views with an outline
        x: its parameters, as ``Cropped`` has them
        rivals: those of the turntable, of other fits that are not clearly worse
        mirror: what tells the object from its mirror image, as ``Calibration`` names it
        pixels: [views], root mean square residual
        agrees: [views] bool
    """

    cropped: Cropped
    x: np.ndarray
    rivals: list[np.ndarray]
    mirror: str
    pixels: np.ndarray
    agrees: np.ndarray

    def as_turntable(self) -> tuple[TurntableFit, Consensus | None]:
        """The fit of the views that agree, and how far all do if not all agree."""
        kept = np.flatnonzero(self.agrees)
        turn, own = self.cropped.at(self.x)
        part = turn.alone(kept)
        part.column, part.row = turn.column, turn.row
        x = _keep(turn, own, kept)
        fit = TurntableFit(part, OptimizeResult(x=x), self.rivals, self.mirror, part.misses(x))
        verdict = Consensus(own, self.pixels, self.agrees)
        return fit, None if self.agrees.all() else verdict

    def maps_of(self, positions: int) -> np.ndarray:
        """From pixels of the camera that stands still to those of each view: [positions, 3, 3].

        Of views without an outline as if they were not cropped.
        """
        maps = np.tile(np.eye(3), (positions, 1, 1))
        found = self.cropped.at(self.x)[0].maps
        index = self.cropped.turn.index
        maps[index, 0, 0], maps[index, 1, 1] = found[:, 0].T
        maps[index, :2, 2] = found[:, 1]
        return maps

    @property
    def changes(self) -> bool:
        """Whether the crops differ by more than the place of the object in the world explains."""
        own, crops = self.cropped.split(self.x)
        moves = move_world(self.cropped.turn, own, crops, self.cropped.ratios)
        wanted = crops.reshape(-1, 1)
        left = wanted - moves @ np.linalg.lstsq(moves, wanted, rcond=None)[0]
        left = np.abs(left.reshape(crops.shape)[self.agrees])
        size = self.cropped.turn.size
        return bool((np.median(left, axis=0) > LEAST_CHANGE * [size, size, 1]).any())

    def deviations(self, known: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Standard deviations of the turntable's parameters, and of the crops [views, 3].

        Residuals larger than the noise of outlines are of a minimum that was not quite reached, or
        of steps that are not even: they err alike all along an outline, so they count twice.

        Args:
            known: parameters that were given
        """
        rms = root_mean_square(self.pixels[self.agrees])
        noise = max(NOISE, rms**2 / NOISE)
        return find_deviations(self.cropped, self.x, self.agrees, noise, known)


def fit_crops(
    turn: Turntable,
    ratios: np.ndarray,
    given: Given,
    tight: bool = False,
    progress: Share = untold,
) -> CropFit | None:
    """Find turntable and crops together; None if none explain the silhouettes by far.

    Args:
        turn: with the views that have an outline
        ratios: [views, 2] known scales of their working images
        tight: whether they were cropped to the object's box
    """
    cropped = Cropped.of(turn, ratios, tight)
    shared = find_free(given)
    few = search_crops(cropped, given, within(progress, 0, SEARCHED))
    if few is None:
        return None
    cropped = replace(cropped, scaled=few.part.scaled)
    x = cropped.fit(few.spread(cropped), shared, FINE_STEPS)
    x = cropped.fit(x, shared, FINE_STEPS, frontier=False)
    progress(FITTED)
    x, pixels, agrees = _fit_agreeing(cropped, x, shared)
    if agrees.sum() < FEWEST_AGREEING:
        return None
    if _are_uneven(*_select(cropped, x, np.flatnonzero(agrees))):
        angles = turn.shared + np.arange(len(agrees))
        x = cropped.fit(x, np.r_[shared, angles], FINE_STEPS, frontier=False)
        x, pixels, agrees = _fit_agreeing(cropped, x, shared)
        if agrees.sum() < FEWEST_AGREEING:
            return None
    progress(1)
    return CropFit(cropped, x, few.rivals, few.mirror, pixels, agrees)


def _measure(cropped: Cropped, x: np.ndarray) -> np.ndarray:
    """Root mean square residual of each view: [views] pixels; 0 for one without known outline."""
    known = cropped.turn.outlines.known
    squares = (cropped.misses(x).pixels ** 2 * known).sum(axis=1)
    return np.sqrt(squares / np.maximum(known.sum(axis=1), 1))


def _are_uneven(cropped: Cropped, x: np.ndarray) -> bool:
    """Whether angles of their own for the views explain held-out parts of the outlines better.

    As for views that were not cropped. It is not asked where the outlines agree to their noise.
    """
    views, count = len(cropped.hulls), cropped.turn.outlines.known.shape[1]
    if root_mean_square(_measure(cropped, x)) <= NOISE:
        return False
    none, angles = np.zeros(0), cropped.turn.shared + np.arange(views)
    fold, gains = np.arange(count) * FOLDS // count % 2 == 0, []
    for part, held_out in permutations((cropped.only(fold), cropped.only(~fold))):
        even, uneven = (part.fit(x, free, OFFSET_STEPS, frontier=False) for free in (none, angles))
        gains.append(held_out.view_costs(even) - held_out.view_costs(uneven))
    gain = np.mean(gains, axis=0)
    return bool(gain.mean() > BETTER * gain.std(ddof=1) / math.sqrt(views))


def _select(cropped: Cropped, x: np.ndarray, views: np.ndarray) -> tuple[Cropped, np.ndarray]:
    """Some views, and the parameters of these."""
    own, crops = cropped.split(x)
    return cropped.select(views), np.r_[_keep(cropped.turn, own, views), crops[views].ravel()]


def _fit_agreeing(
    cropped: Cropped, x: np.ndarray, shared: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit the views that agree alone; the others keep their crops and are judged by all.

    Returns:
        the parameters, each view's root mean square residual in pixels, and whether it agrees
    """
    pixels = _measure(cropped, x)
    agrees = pixels <= max(SUSPECT * cropped.turn.size / 256, TWICE * float(np.median(pixels)))
    if agrees.all() or agrees.sum() < FEWEST_AGREEING:
        return x, pixels, agrees
    kept, count = np.flatnonzero(agrees), cropped.turn.shared
    own, crops = (values.copy() for values in cropped.split(x))
    part, start = _select(cropped, x, kept)
    angles = count + np.flatnonzero(start[count : count + len(kept)])
    found = part.fit(start, np.r_[shared, angles], FINE_STEPS, frontier=False)
    own_found, crops[kept] = part.split(found)
    own[:count], own[count + kept] = own_found[:count], own_found[count:]
    whole = np.r_[own, crops.ravel()]
    pixels = _measure(cropped, whole)
    pixels[kept] = _measure(part, found)
    agrees = np.zeros(len(crops), bool)
    agrees[kept] = pixels[kept] <= REFUSED_AGREEING * cropped.turn.size / 256
    return whole, pixels, agrees


def _keep(turn: Turntable, own: np.ndarray, views: np.ndarray) -> np.ndarray:
    """The turntable's parameters with the offsets of some views."""
    return np.r_[own[: turn.shared], own[turn.shared + views]]
