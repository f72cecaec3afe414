"""The turntable of views that were cropped one by one: search, refinement, and what fits as well.

It is what ``silmesh.cameras.turntable_fit`` does for views that were not, with the crops as further
unknowns (``silmesh.cameras.crops``): from several elevations, half angles, steps and both
directions on few views and points, then on all of them, without the views that disagree.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import OptimizeResult

from silmesh.cameras.consensus import Consensus
from silmesh.cameras.crop_deviations import find_deviations
from silmesh.cameras.crop_gauge import move_world
from silmesh.cameras.crops import Cropped
from silmesh.cameras.frontier import SCALE
from silmesh.cameras.turntable_fit import (
    ARCS,
    CLEAR,
    COARSE_STEPS,
    FEWEST_AGREEING,
    REFUSED_AGREEING,
    STARTS,
    SUSPECT,
    Given,
    TurntableFit,
    root_mean_square,
)
from silmesh.cameras.turntable_residuals import (
    COARSE_SAMPLES,
    COARSE_VIEWS,
    NAMES,
    NOISE,
    STEP,
    Turntable,
)
from silmesh.progress import Share, untold, within

# Starts that are fitted, by the cost before; those that are refined further; evaluations of that,
# and of the fit of all views.
TRIED, REFINED, MORE_STEPS, FINE_STEPS = 8, 2, 30, 15
PARTS = (0.4, 0.6, 0.8)  # shares of the time after which the search and the refinements end
# Pixels of images of 256: a mean loss on few views from which crops explain nothing.
HOPELESS = 8.0
ROUNDS, AGAIN = 4, 0.9  # of refinement; the share of the cost that another one has to reach
# Photographs may not have been scaled if the standard deviation of their scales is at most this.
SAME_SCALE = 0.05
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
        x = part.widen(own)
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
    shared = _find_free(given)
    part, kept = cropped.thin(COARSE_VIEWS, COARSE_SAMPLES)
    starts = _search(part, given, within(progress, 0, PARTS[0]))
    if part.cost(starts[0]) > HOPELESS * turn.size / 256:
        return None
    coarse = [_refine(part, x, shared) for x in starts[:REFINED]]
    coarse.sort(key=part.cost)
    progress(PARTS[1])
    part, coarse = _drop_scales(part, coarse, shared)
    best, mirror = _resolve_mirror(part, coarse[0], shared, given)
    cost = part.cost(best)
    rivals = [
        part.split(x)[0][: turn.shared]
        for x in coarse[1:]
        if part.turn.excess(cost, part.cost(x)) <= CLEAR
    ]
    cropped = replace(cropped, scaled=part.scaled)
    x = cropped.fit(_spread(cropped, part, best, kept), shared, FINE_STEPS)
    x = cropped.fit(x, shared, FINE_STEPS, frontier=False)
    progress(PARTS[2])
    pixels = _measure(cropped, x)
    agrees = pixels <= max(SUSPECT * turn.size / 256, TWICE * float(np.median(pixels)))
    if not agrees.all() and agrees.sum() >= FEWEST_AGREEING:
        x, pixels, agrees = _fit_agreeing(cropped, x, agrees, shared)
    return CropFit(cropped, x, rivals, mirror, pixels, agrees)


def _find_free(given: Given) -> np.ndarray:
    return np.array([i for i in range(len(NAMES)) if i not in given.known])


def _search(part: Cropped, given: Given, progress: Share) -> list[np.ndarray]:
    """Fits on few views, the best of each direction and arc first."""
    steps = [abs(given.step)] if given.step is not None else [arc / given.count for arc in ARCS]
    starts = STARTS if given.step is not None else STARTS[1::2]
    if given.elevation is not None:
        starts = [(given.elevation, angle) for _, angle in STARTS[:2]]
    held = np.setdiff1d(_find_free(given), [STEP])
    ways = [(e, a, d * s) for e, a in starts for s in steps for d in (1, -1)]
    tried = []
    for done, way in enumerate(ways, start=1):
        x = part.start(*way)
        tried.append((part.cost(x), x))
        progress(done / len(ways) / 2)
    tried.sort(key=lambda pair: pair[0])
    found = []
    for done, (_, x) in enumerate(tried[:TRIED], start=1):
        fitted = part.fit(x, held, COARSE_STEPS)
        found.append((part.cost(fitted), fitted))
        progress(0.5 + done / TRIED / 2)
    return [x for _, x in sorted(found, key=lambda pair: pair[0])]


def _refine(part: Cropped, x: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """Fit, and again from what the frontier points say then, which leaves local minima."""
    x = part.fit(x, shared, MORE_STEPS)
    for _ in range(ROUNDS):
        own, crops = part.split(x)
        again = part.fit(part.agree(own, crops), shared, COARSE_STEPS)
        if part.cost(again) > AGAIN * part.cost(x):
            return min(again, x, key=part.cost)
        x = again
    return x


def _drop_scales(
    part: Cropped, fits: Sequence[np.ndarray], shared: np.ndarray
) -> tuple[Cropped, list[np.ndarray]]:
    """Without scales, if shifts alone explain the silhouettes as well."""
    if np.std(part.split(fits[0])[1][:, SCALE]) > SAME_SCALE:
        return part, list(fits)
    plain = replace(part, scaled=False)
    own, crops = part.split(fits[0])
    crops[:, SCALE] = 0
    again = _refine(plain, plain.agree(own, crops), shared)
    if part.turn.excess(part.cost(fits[0]), plain.cost(again)) > CLEAR:
        return part, list(fits)
    return plain, [again, *fits[1:]]


def _resolve_mirror(
    part: Cropped, best: np.ndarray, shared: np.ndarray, given: Given
) -> tuple[np.ndarray, str]:
    """Decide between a fit and that of the mirrored object, as for views that were not cropped."""
    if given.elevation is not None:
        return best, "elevation"
    own, crops = part.split(best)
    twin = part.fit(np.r_[part.turn.mirrored(own), crops.ravel()], shared, COARSE_STEPS)
    cost, other = part.cost(best), part.cost(twin)
    if part.turn.excess(other, cost) > CLEAR:
        return twin, "perspective"
    if part.turn.excess(cost, other) > CLEAR:
        return best, "perspective"
    return best, "table" if given.above_table else "open"


def _spread(cropped: Cropped, part: Cropped, x: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Parameters of all views from those of some: the others' crops from frontier points."""
    own, crops = part.split(x)
    views = len(cropped.hulls)
    whole = cropped.turn.widen(own)
    near = kept[np.abs(np.arange(views)[:, None] - kept).argmin(axis=1)]
    start = cropped.start_crops()
    moved = np.zeros_like(start)
    moved[kept] = crops - start[kept]
    start = start + moved[near]
    start[:, SCALE] -= start[:, SCALE].mean()
    return cropped.agree(whole, start)


def _measure(cropped: Cropped, x: np.ndarray) -> np.ndarray:
    """Root mean square residual of each view: [views] pixels; 0 for one without known outline."""
    known = cropped.turn.outlines.known
    squares = (cropped.misses(x).pixels ** 2 * known).sum(axis=1)
    return np.sqrt(squares / np.maximum(known.sum(axis=1), 1))


def _fit_agreeing(
    cropped: Cropped, x: np.ndarray, agrees: np.ndarray, shared: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit the views that agree alone; the others keep their crops and are judged by all."""
    kept = np.flatnonzero(agrees)
    own, crops = cropped.split(x)
    views = len(crops)
    part = cropped.select(kept)
    start = np.r_[part.turn.widen(own), crops[kept].ravel()]
    found = part.fit(start, shared, FINE_STEPS, frontier=False)
    own_found, crops_found = part.split(found)
    crops = crops.copy()
    crops[kept] = crops_found
    whole = np.r_[cropped.turn.widen(own_found), crops.ravel()]
    pixels = np.maximum(_measure(cropped, whole), 0)
    pixels[kept] = _measure(part, found)
    agrees = np.zeros(views, bool)
    agrees[kept] = pixels[kept] <= REFUSED_AGREEING * cropped.turn.size / 256
    return whole, pixels, agrees
