"""The search for a turntable of cropped views: on few of them, and few points of each.

It goes from several elevations, half angles, steps and both directions, as that of
``silmesh.cameras.turntable_fit`` does for views that were not cropped.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from silmesh.cameras.crops import Cropped
from silmesh.cameras.frontier import SCALE
from silmesh.cameras.turntable_fit import ARCS, CLEAR, COARSE_STEPS, STARTS, Given
from silmesh.cameras.turntable_residuals import COARSE_SAMPLES, COARSE_VIEWS, NAMES, STEP
from silmesh.progress import Share, within

# Starts that are fitted, by the cost before; those that are refined further; steps of that.
TRIED, REFINED, MORE_STEPS = 8, 2, 30
SEARCHED, REFINED_AT = 0.6, 0.9  # shares of the time after which the search and that end
# Pixels of images of 256: a mean loss on few views from which crops explain nothing.
HOPELESS = 8.0
ROUNDS, AGAIN = 4, 0.9  # of refinement; the share of the cost that another one has to reach
# Photographs may not have been scaled if the standard deviation of their scales is at most this.
SAME_SCALE = 0.05


@dataclass(frozen=True)
class FewViews:
    """What the search found.

    Attributes:
        part: the views that it used
        kept: their positions among all
        x: the best parameters, as ``Cropped`` has them
        rivals, mirror: as ``CropFit`` has them
    """

    part: Cropped
    kept: np.ndarray
    x: np.ndarray
    rivals: list[np.ndarray]
    mirror: str

    def spread(self, cropped: Cropped) -> np.ndarray:
        """Parameters of all views: the others' crops from frontier points."""
        own, crops = self.part.split(self.x)
        views = len(cropped.hulls)
        whole = cropped.turn.widen(own)
        near = self.kept[np.abs(np.arange(views)[:, None] - self.kept).argmin(axis=1)]
        start = cropped.start_crops()
        moved = np.zeros_like(start)
        moved[self.kept] = crops - start[self.kept]
        start = start + moved[near]
        start[:, SCALE] -= start[:, SCALE].mean()
        return cropped.agree(whole, start)


def search_crops(cropped: Cropped, given: Given, progress: Share) -> FewViews | None:
    """Fit few views; None if no crops explain these by far."""
    shared = find_free(given)
    part, kept = cropped.thin(COARSE_VIEWS, COARSE_SAMPLES)
    starts = _search(part, given, within(progress, 0, SEARCHED))
    if part.cost(starts[0]) > HOPELESS * cropped.turn.size / 256:
        return None
    coarse = []
    for done, x in enumerate(starts[:REFINED], start=1):
        coarse.append(_refine(part, x, shared))
        progress(SEARCHED + done / REFINED * (REFINED_AT - SEARCHED))
    coarse.sort(key=part.cost)
    part, coarse = _drop_scales(part, coarse, shared)
    best, mirror = _resolve_mirror(part, coarse[0], shared, given)
    cost = part.cost(best)
    rivals = [
        part.split(x)[0][: part.turn.shared]
        for x in coarse[1:]
        if part.turn.excess(cost, part.cost(x)) <= CLEAR
    ]
    progress(1)
    return FewViews(part, kept, best, rivals, mirror)


def find_free(given: Given) -> np.ndarray:
    """Positions of the turntable's parameters that a fit may change."""
    return np.array([i for i in range(len(NAMES)) if i not in given.known])


def _search(part: Cropped, given: Given, progress: Share) -> list[np.ndarray]:
    """Fits on few views, the best of each direction and arc first."""
    steps = [abs(given.step)] if given.step is not None else [arc / given.count for arc in ARCS]
    starts = STARTS if given.step is not None else STARTS[1::2]
    if given.elevation is not None:
        starts = [(given.elevation, angle) for _, angle in STARTS[:2]]
    held = np.setdiff1d(find_free(given), [STEP])
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
