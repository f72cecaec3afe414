"""A visual hull that bears wrong silhouettes: what views deny is believed if the others allow it.

The visual hull takes the worst view's word at every point, so that one bitten silhouette bites the
hull. The silhouettes contradict each other where a pixel of one shows the object and no point of
its ray is left (Landabaso, Pardas and Casas, *Shape from inconsistent silhouette*, 2008). Here each
view is judged by the hull of the others, in two steps on a grid of points and in small images:

1. Of how many denials a point may have, that number is taken by which the others' hulls predict
   the held-out silhouettes best. Views that are predicted far worse than the rest lose their say,
   in rounds, since their own wrong claims have spoilt the predictions for the others.
2. What a view denies and the others allow is either carved rightly or a bite. It is a bite if the
   others' silhouettes lose more pixels by it than it is large. Bites are judged all at once, then,
   where pixels are still lost, smaller ones one at a time.

The hull is then carved exactly, as ever, from the views that kept their say, with their bites
filled. Where the strict hull explains the silhouettes nothing of this is done, and nothing comes of
it where most views would be doubted.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numba import njit
from scipy import ndimage

from silmesh.geometry.camera import OBJECT_RADIUS, Cameras
from silmesh.geometry.frame import bound_object, is_cut, whole_frames
from silmesh.geometry.small_images import shrink
from silmesh.geometry.visual_hull import Hull, carve

RESOLUTION = 128  # samples a side of the hull that is carved
SIZE = 96  # pixels along the longer side of the images in which views are judged
GLANCE = 64  # and of those in which the strict hull is looked at
COARSE, SAMPLES = 48, 72  # points a side: of the search for the object's box, and of the judging
ENOUGH = 6  # views; of fewer none can be told from the others
# The strict hull explains silhouettes of each of which it leaves at most the share UNCOVERED of the
# pixels uncovered. Cameras that are a little wrong uncover some pixels of all; so it may be UNUSUAL
# times the share of the median view, but never more than MOST_UNCOVERED.
UNCOVERED, UNUSUAL, MOST_UNCOVERED = 0.02, 3, 0.05
SCATTERED = 0.05  # of the strict hull's volume: more than may lie in all pieces but the largest
AGREED = 0.45  # least IoU that the median view is predicted with; below, no views agree
ROUNDS = 4  # in which views lose their say or get it back
WORSE = 0.12  # by how much less than the median a view is predicted that loses its say
SPREAD = 5  # and by how many median deviations
# If more of the views than these are doubted, as a whole or in part, the cameras are wrong rather
# than some silhouettes, and no silhouette is corrected by them.
MOST_DOUBTED = 0.8
BITE = 4  # pixels of a small image: smaller bites are not told from the grid
# What a bite costs others is seen smaller than it is, as pixels at outlines and points of the grid
# beside them count as neither: a small one, looked for last, may be so many times larger.
UNSEEN = 4
MOST_ADDED = 2  # small bites for each view
LOST = 0.25  # of what a view and the others show: if they disagree on more, it has no weight
AROUND = np.ones((3, 3), bool)


@dataclass(frozen=True)
class RobustHull:
    """A hull, and how far each view is believed.

    Attributes:
        hull: the surface is its zero level
        explained: whether the hull of all silhouettes as they are explains them, and is it
        reliability: [views] from 0, not believed at all, to 1: the share of what the view and the
            others' hull show on which they agree; 0 where that is less than 1 - ``LOST``
        disbelieved: [views, height, width] bool, pixels whose silhouette is not believed; all
            pixels of a view without weight
    """

    hull: Hull
    explained: bool
    reliability: np.ndarray
    disbelieved: np.ndarray

    @property
    def trusted(self) -> list[int]:
        """The positions of the views with weight."""
        return np.flatnonzero(self.reliability > 0).tolist()

    @property
    def distrusted(self) -> list[int]:
        """The positions of the views without weight."""
        return np.flatnonzero(self.reliability == 0).tolist()

    @property
    def corrected(self) -> list[int]:
        """The positions of the views of which a part is not believed."""
        some = self.disbelieved.any(axis=(1, 2)) & (self.reliability > 0)
        return np.flatnonzero(some).tolist()

    def believed(
        self,
        silhouettes: np.ndarray,
        cameras: Cameras,
        frames: Sequence[Sequence[int]] | None = None,
    ) -> tuple[np.ndarray, Cameras, np.ndarray]:
        """The views that have weight, with what they deny wrongly filled; cameras and frames."""
        frames = whole_frames(silhouettes) if frames is None else np.asarray(frames)
        kept = self.trusted
        return (silhouettes | self.disbelieved)[kept], cameras.select(kept), frames[kept]

    def count(self, known: np.ndarray | None) -> np.ndarray:
        """The pixels that count of the views that have weight: [views with weight, height, width].

        Args:
            known: [views, height, width] bool, of which pixels the views say anything; None of all
        """
        believed = ~self.disbelieved if known is None else known & ~self.disbelieved
        return believed[self.trusted]


class _Looks(NamedTuple):
    """The points of a grid in the small images.

    Attributes:
        shown: [views, pixels] bool, the silhouettes
        denied: [views, pixels] bool, more than a pixel outside; the last pixel stands for all
            beyond the image
        pixel: [points, views] int32, where each point is seen
        shape: height and width of an image
    """

    shown: np.ndarray
    denied: np.ndarray
    pixel: np.ndarray
    shape: tuple[int, int]


def robust_carve(
    silhouettes: np.ndarray,
    cameras: Cameras,
    frames: Sequence[Sequence[int]] | None = None,
    resolution: int = RESOLUTION,
) -> RobustHull:
    """Carve the visual hull, or where it does not explain the silhouettes one that bears errors.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        frames: [views, 4] left, top, right and bottom of the photographs within the images; the
            whole images if not given
        resolution: samples along each side of the box that the hull fills
    """
    frames = whole_frames(silhouettes) if frames is None else np.asarray(frames)
    hull = carve(silhouettes, cameras, resolution, frames=frames)
    explained = explains(hull, silhouettes, cameras)
    strict = RobustHull(hull, explained, np.ones(len(cameras)), np.zeros_like(silhouettes))
    if len(cameras) < ENOUGH or explained:
        return strict
    looks = _look(silhouettes, cameras, frames)
    if not len(looks.pixel):
        return strict
    trusted, tolerated, agreed = _find_trusted(looks)
    if agreed < AGREED:
        return strict
    bites, trusted = _find_bites(looks, trusted, tolerated)
    if 2 * trusted.sum() <= looks.shown.any(axis=1).sum():  # nothing can be told of any
        return strict
    found = _carve_believed(silhouettes, cameras, frames, resolution, looks, bites, trusted)
    doubted = len(found.distrusted) + len(found.corrected)
    return strict if doubted > MOST_DOUBTED * len(cameras) else found


def explains(hull: Hull, silhouettes: np.ndarray, cameras: Cameras) -> bool:
    """Whether a hull covers every silhouette, and is in one piece but for crumbs.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
    """
    if hull.empty or _scattered(hull) > SCATTERED:
        return False
    left = find_uncovered(hull, silhouettes, cameras)
    allowed = max(UNCOVERED, min(UNUSUAL * float(np.median(left)), MOST_UNCOVERED))
    return bool(left.max() <= allowed)


def predict_held_out(
    silhouettes: np.ndarray, cameras: Cameras, frames: Sequence[Sequence[int]] | None = None
) -> np.ndarray:
    """How well the strict hull of the others predicts each silhouette, in small images.

    Arguments are those of ``robust_carve``.

    Returns:
        [views] IoU, in which pixels within one of the outline are right either way
    """
    frames = whole_frames(silhouettes) if frames is None else np.asarray(frames)
    looks = _look(silhouettes, cameras, frames)
    if not len(looks.pixel):
        return np.zeros(len(cameras))
    return _predict(looks, looks.shown.any(axis=1))[:, 0]


def find_uncovered(hull: Hull, silhouettes: np.ndarray, cameras: Cameras) -> np.ndarray:
    """The share of each silhouette's pixels that a hull does not cover.

    Looked at in small images and in blocks of two samples a side. 1 for an empty silhouette, which
    nothing can explain.

    Returns:
        [views]
    """
    small, covered = _see(hull, silhouettes, cameras, GLANCE)
    area = small.sum(axis=(1, 2))
    left = (small & ~covered).sum(axis=(1, 2)) / np.maximum(area, 1)
    return np.where(area > 0, left, 1.0)


def _see(
    hull: Hull, silhouettes: np.ndarray, cameras: Cameras, size: int
) -> tuple[np.ndarray, np.ndarray]:
    """The silhouettes in small images, and which of their pixels show a hull.

    Returns:
        twice [views, small height, small width] bool
    """
    small, eyes = shrink(silhouettes, cameras, size)
    points = hull.origin + (2 * np.argwhere(hull.solid) + 0.5) * hull.spacing
    pixel = _project(eyes.projections.numpy(), points, small.shape[1], small.shape[2])
    return small, _cover(pixel, small[0].size).reshape(small.shape)


def _scattered(hull: Hull) -> float:
    """The share of a hull's volume in all pieces but the largest, in blocks of two samples."""
    pieces, _ = ndimage.label(hull.solid, np.ones((3, 3, 3)))
    volumes = np.bincount(pieces.ravel())[1:]
    return 1 - volumes.max() / volumes.sum()


def _look(silhouettes: np.ndarray, cameras: Cameras, frames: np.ndarray) -> _Looks:
    """The points that at least half of the views may see, in the small images."""
    small, eyes = shrink(silhouettes, cameras, SIZE)
    scale = small.shape[2] / silhouettes.shape[2]
    cut = is_cut(silhouettes, frames)
    denied = ~ndimage.binary_dilation(small, AROUND[None])
    for view in np.flatnonzero(cut):
        left, top, right, bottom = np.round(scale * frames[view]).astype(int)
        inside = np.zeros(small.shape[1:], bool)
        inside[top:bottom, left:right] = True
        denied[view] &= inside
    beyond = np.column_stack([denied.reshape(len(small), -1), ~cut])
    P, (height, width) = eyes.projections.numpy(), small.shape[1:]
    shown, bounded = small.any(axis=(1, 2)), bound_object(silhouettes, frames)
    axes = [np.linspace(-1.6 * OBJECT_RADIUS, 1.6 * OBJECT_RADIUS, COARSE)] * 3
    for samples in (SAMPLES, 0):
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        pixel = _project(P, points, height, width)
        against = _count(pixel, beyond, shown)
        kept = against <= shown.sum() / 2
        if not bounded:  # nor is it looked for beyond the sphere that holds it
            kept &= np.linalg.norm(points, axis=1) <= OBJECT_RADIUS
        if samples and kept.any():
            step = axes[0][1] - axes[0][0]
            low, high = points[kept].min(axis=0) - step, points[kept].max(axis=0) + step
            axes = [np.linspace(*ends, samples) for ends in zip(low, high, strict=True)]
    return _Looks(small.reshape(len(small), -1), beyond, pixel[kept], (height, width))


def _find_trusted(looks: _Looks) -> tuple[np.ndarray, int, float]:
    """Which views keep their say, [views] bool, how many may deny a point, the median's score."""
    shown = looks.shown.any(axis=1)
    trusted = shown.copy()
    for _ in range(ROUNDS):
        scores = _predict(looks, trusted)
        tolerated, agreed = _tolerate(scores[shown])
        before, trusted = trusted, shown & ~_far_below(scores[:, tolerated], shown)
        if (trusted == before).all():
            break
    else:  # the number is of other views
        tolerated, agreed = _tolerate(_predict(looks, trusted)[shown])
    return trusted, tolerated, agreed


def _tolerate(scores: np.ndarray) -> tuple[int, float]:
    """The number of denials by which the median view is predicted best, and how well that is."""
    medians = np.median(scores, axis=0)
    return int(medians.argmax()), float(medians.max())


def _far_below(scores: np.ndarray, usual: np.ndarray) -> np.ndarray:
    """Whether each score is far below the median of the usual views' scores."""
    median = np.median(scores[usual])
    deviation = 1.4826 * np.median(np.abs(scores[usual] - median))
    return scores < median - max(WORSE, min(SPREAD * deviation, 2 * WORSE))


def _predict(looks: _Looks, trusted: np.ndarray) -> np.ndarray:
    """How well the others' hull predicts each silhouette: [views, denials that it bears] IoU.

    Pixels within one of the outline are right either way.
    """
    most = max(1, int(trusted.sum()) // 3)
    against = _count(looks.pixel, looks.denied, trusted)

    def score(view: int) -> list[float]:
        least = _fewest(looks.pixel, against, looks.denied, view, trusted[view], most + 1)
        return [_agree(looks, view, least <= tolerated) for tolerated in range(most + 1)]

    return np.array(_share(score, len(trusted)))


def _agree(looks: _Looks, view: int, allowed: np.ndarray) -> float:
    """The IoU of a silhouette and what the others allow, apart from a pixel at the outline."""
    shown, denied = looks.shown[view], looks.denied[view, :-1]
    wrong = (allowed & denied).sum() + (shown & ~allowed).sum()
    return 1 - wrong / max((shown | (allowed & denied)).sum(), 1)


def _find_bites(
    looks: _Looks, trusted: np.ndarray, tolerated: int
) -> tuple[np.ndarray, np.ndarray]:
    """What views deny wrongly, [views, pixels] bool, and which views keep their say in the end.

    Bites are sought in all views, in hulls that bear fewer and fewer denials: those that overlap
    are found first in hulls that bear both. What is still lost in the end is laid to smaller ones.
    """
    bites = np.zeros_like(looks.shown)
    most = max(2 * tolerated, int(trusted.sum()) // 4, 2)
    looks = looks._replace(pixel=looks.pixel[_count(looks.pixel, looks.denied, trusted) <= most])
    for bearing in (*sorted({tolerated, tolerated // 2, 1} - {0}, reverse=True), 0, 0):
        denied, against = _count_believed(looks, bites, trusted)
        bites = _rate(looks, denied, against, trusted, bearing) > 0
        trusted = looks.shown.any(axis=1) & (_measure(looks, bites, trusted, bearing) >= 1 - LOST)
    bites = _add_bites(looks, bites, trusted)
    return bites, looks.shown.any(axis=1) & (_measure(looks, bites, trusted) >= 1 - LOST)


def _add_bites(looks: _Looks, bites: np.ndarray, trusted: np.ndarray) -> np.ndarray:
    """These bites, and small ones beside them: the dearest first, and none is taken back.

    Where filling either of two gives a third view back what it lost, both are dear while neither
    is filled, and neither is while both are: judged all at once they come and go.
    """
    bites = bites.copy()
    for _ in range(MOST_ADDED * len(bites)):
        denied, against = _count_believed(looks, bites, trusted)
        costs = _rate(looks, denied, against, trusted, unseen=UNSEEN)
        costs[bites] = 0
        view = int(costs.max(axis=1).argmax())
        if not costs[view].any():
            break
        bites[view] |= costs[view] == costs[view].max()
    return bites


def _count_believed(
    looks: _Looks, bites: np.ndarray, trusted: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What views deny rightly, [views, pixels + 1], and how many trusted ones do so: [points]."""
    denied = looks.denied.copy()
    denied[:, :-1] &= ~bites
    return denied, _count(looks.pixel, denied, trusted)


def _share(work: Callable[[int], Any], views: int) -> list[Any]:
    """The work for each view, as many at a time as torch has threads."""
    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        return list(pool.map(work, range(views)))


def _rate(
    looks: _Looks,
    denied: np.ndarray,
    against: np.ndarray,
    trusted: np.ndarray,
    bearing: int = 0,
    unseen: int = 1,
) -> np.ndarray:
    """What the parts of what each view denies cost the others; 0 where they are worth it.

    They are worth their pixels; they cost what the others' silhouettes lose, as many times as
    there are views that lose by them: one view is rather wrong than several, that agree, are.

    Args:
        denied: [views, pixels + 1] bool, what is believed
        against: [points], how many trusted views deny each, of what is believed
        bearing: how many denials the hull bears
        unseen: how many times more than is seen they may cost
    Returns:
        [views, pixels] int
    """
    covering = _covering(looks.pixel, against <= bearing, looks.shown.shape)

    def find(view: int) -> np.ndarray:
        own = denied[view] & trusted[view]
        args = (looks, own, against, covering, trusted, bearing, view)
        lost = _count_losses(*args)
        parts, count = ndimage.label(lost.reshape(looks.shape) > 0, AROUND)
        parts = parts.ravel().astype(np.int32)
        area = np.bincount(parts, minlength=count + 1)
        gain = _sum_losses(*args, parts, count)
        losers = np.maximum((gain >= BITE).sum(axis=1), 1)
        lost = gain.sum(axis=1)
        cost = lost * losers
        dear = (np.minimum(area, lost) >= BITE) & (unseen * cost > area)
        dear[0] = False
        return np.where(dear, cost, 0)[parts]

    return np.stack(_share(find, len(trusted)))


def _measure(looks: _Looks, bites: np.ndarray, trusted: np.ndarray, bearing: int = 0) -> np.ndarray:
    """The share of what each view and the others' hull show on which they agree: [views].

    What a view alone cuts off, and nobody misses, is no disagreement. Disagreement outside of its
    largest part counts twice: a bite or a blob is one part, another object differs all around.
    """
    denied, against = _count_believed(looks, bites, trusted)

    def agree(view: int) -> float:
        least = _fewest(looks.pixel, against, denied, view, trusted[view], bearing + 1)
        wrong = bites[view] | (looks.shown[view] & (least > bearing))
        parts, _ = ndimage.label(wrong.reshape(looks.shape), AROUND)
        counted = 2 * wrong.sum() - max(np.bincount(parts.ravel())[1:], default=0)
        return max(0.0, 1 - counted / max((looks.shown[view] | bites[view]).sum(), 1))

    return np.array(_share(agree, len(bites))) * looks.shown.any(axis=1)


def _carve_believed(
    silhouettes: np.ndarray,
    cameras: Cameras,
    frames: np.ndarray,
    resolution: int,
    looks: _Looks,
    bites: np.ndarray,
    trusted: np.ndarray,
) -> RobustHull:
    """The exact hull of what is believed, and what is not believed in the images' own size."""
    agreed = np.where(trusted, _measure(looks, bites, trusted), 0.0)
    kept = np.flatnonzero(trusted)
    bitten = _enlarge(bites.reshape(-1, *looks.shape), silhouettes.shape) & ~silhouettes
    eyes = cameras.select(kept.tolist())
    hull = carve((silhouettes | bitten)[kept], eyes, resolution, frames=frames[kept])
    small, covered = _see(hull, silhouettes, cameras, SIZE)
    added = small & ~ndimage.binary_dilation(covered, AROUND[None])
    disbelieved = bitten | (_enlarge(added, silhouettes.shape) & silhouettes)
    disbelieved[~trusted] = True
    return RobustHull(hull, False, agreed, disbelieved)


def _enlarge(parts: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Parts of small images, grown by two of their pixels, in images of this shape."""
    grown = ndimage.binary_dilation(parts, AROUND[None], iterations=2)
    rows, columns = (np.arange(n) * m // n for n, m in zip(shape[1:], parts.shape[1:], strict=True))
    return grown[:, rows[:, None], columns]


@njit(nogil=True, cache=True, error_model="numpy")
def _project(P, points, height, width):
    """The pixel in which each view sees each point: [points, views]; behind the last, if none."""
    pixel = np.empty((len(points), len(P)), np.int32)
    for n in range(len(points)):
        x, y, z = points[n]
        for v in range(len(P)):
            m = P[v]
            depth = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
            column = (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) / depth
            row = (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) / depth
            within = depth > 0 and 0 <= column < width and 0 <= row < height
            pixel[n, v] = int(row) * width + int(column) if within else height * width
    return pixel


@njit(nogil=True, cache=True)
def _count(pixel, denied, trusted):
    """How many trusted views deny each point: [points]."""
    against = np.zeros(len(pixel), np.int32)
    for n in range(len(pixel)):
        for v in range(len(denied)):
            if trusted[v] and denied[v, pixel[n, v]]:
                against[n] += 1
    return against


@njit(nogil=True, cache=True)
def _cover(pixel, size):
    """Which pixels show at least one point: [views, size] bool."""
    covered = np.zeros((pixel.shape[1], size + 1), np.bool_)
    for n in range(len(pixel)):
        for v in range(pixel.shape[1]):
            covered[v, pixel[n, v]] = True
    return covered[:, :size]


@njit(nogil=True, cache=True)
def _covering(pixel, solid, shape):
    """How many solid points each pixel shows: [views, pixels + 1]."""
    covering = np.zeros((shape[0], shape[1] + 1), np.int32)
    for n in range(len(pixel)):
        if solid[n]:
            for v in range(shape[0]):
                covering[v, pixel[n, v]] += 1
    return covering


@njit(nogil=True, cache=True)
def _fewest(pixel, against, denied, view, counts, most):
    """Along each ray of a view, the fewest other views that deny a point: [pixels] up to most."""
    least = np.full(denied.shape[1], most, np.int32)
    for n in range(len(pixel)):
        p = pixel[n, view]
        others = against[n] - (1 if counts and denied[view, p] else 0)
        if others < least[p]:
            least[p] = others
    return least[:-1]


@njit(nogil=True, cache=True)
def _without(looks, against, covering, bearing, view):
    """How many solid points each pixel shows, once a view has carved what it denies."""
    left = covering.copy()
    for n in range(len(against)):
        if against[n] <= bearing and looks.denied[view, looks.pixel[n, view]]:
            for v in range(len(left)):
                left[v, looks.pixel[n, v]] -= 1
    return left


@njit(nogil=True, cache=True)
def _count_losses(looks, own, against, covering, trusted, bearing, view):
    """Along each ray of what a view denies, the most other silhouettes that lose their last point.

    Args:
        own: [pixels + 1] bool, what the view denies in ``against``
    """
    left = _without(looks, against, covering, bearing, view)
    lost = np.zeros(looks.shown.shape[1], np.int32)
    for n in range(len(against)):
        p = looks.pixel[n, view]
        if p < len(lost) and looks.denied[view, p] and against[n] - own[p] <= bearing:
            here = 0
            for v in range(len(left)):
                q = looks.pixel[n, v]
                if v != view and trusted[v] and q < len(lost) and looks.shown[v, q]:
                    here += left[v, q] == 0
            lost[p] = max(lost[p], here)
    return lost


@njit(nogil=True, cache=True)
def _sum_losses(looks, own, against, covering, trusted, bearing, view, parts, count):
    """How many pixels each silhouette loses by each part of what a view denies: [parts, views]."""
    left = _without(looks, against, covering, bearing, view)
    gain = np.zeros((count + 1, len(covering)), np.int64)
    for n in range(len(against)):
        p = looks.pixel[n, view]
        if p == len(parts) or not parts[p] or not looks.denied[view, p]:
            continue
        if against[n] - own[p] > bearing:
            continue
        for v in range(len(left)):
            q = looks.pixel[n, v]
            if v == view or not trusted[v] or q == len(parts) or not looks.shown[v, q]:
                continue
            if left[v, q] == 0:
                left[v, q] = -1  # counted
                gain[parts[p], v] += 1
    return gain
