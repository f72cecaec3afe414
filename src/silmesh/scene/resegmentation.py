"""Silhouettes solved jointly: masks, the votes of the other views, and colours, in rounds.

Each round asks which silhouettes, or parts of them, the others contradict. Of these pixels, and of
no others, a minimum cut decides (``silmesh.scene.graph_cut``; after Campbell et al., *Automatic 3D
Object Segmentation in Multiple Views*, 2010). The odds that a pixel is the object are the sum
of two logarithms:

- how much more often, in the views that nothing contradicts, a pixel as deep in the hull of the
  others belongs to the silhouette than not. So the hull counts as much as it has been right;
- how much likelier its colour is the object's, which the views around have shown, than that of the
  background, which the same photograph shows beyond the hull.

What was decided votes about the others in the next round, until nothing moves.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import find_shown, whole_frames
from silmesh.geometry.overlap import iou
from silmesh.geometry.robust_hull import AROUND, robust_carve
from silmesh.progress import Share, untold
from silmesh.scene.colour_model import ColourModel
from silmesh.scene.coverage import keep_outline, settle_outline, undo_shaving
from silmesh.scene.graph_cut import cut
from silmesh.scene.outliers import Verdict, find_outliers
from silmesh.scene.votes import find_allowed

ROUNDS = 3
FEWEST = 3  # views that must have a say
STILL = 0.002  # of a silhouette's area: less is no movement
OUTER = 4  # pixels of 256 around the hull: those beyond are background
DEEPEST = 12  # and in it: all those that are deeper count alike
CALM = 8  # views that nothing contradicts, by which the hull is measured
AROUND_VIEW = 6  # such views nearest to one, whose colours are the object's
SURE = 4.0  # nats: the most that the hull counts, and the colours
SPECK = 4  # pixels: a smaller part of the object, or of what is around it, is a speck
MOSTLY_RIGHT = 0.5  # IoU with what a silhouette becomes, from which only parts of it are wrong
# Specks are decided anew if they are so many, and more than this share of a silhouette's area. A
# thin part that is seen at a slant falls into a few of them.
MANY, SPECKLED = 6, 0.004


@dataclass
class Contest:
    """What the other views contradict.

    Attributes:
        whole: positions of the views without any say
        parts: [height, width] bool of views of which only that is contradicted, by position
        filled: [views, height, width] bool, what views deny wrongly
        reasons: why, by position, of those that no verdict names
    """

    whole: set[int] = field(default_factory=set)
    parts: dict[int, np.ndarray] = field(default_factory=dict)
    filled: np.ndarray | None = None
    reasons: dict[int, str] = field(default_factory=dict)

    @property
    def views(self) -> list[int]:
        """Positions of all that are contradicted."""
        return sorted({*self.whole, *self.parts})


@dataclass(frozen=True)
class Solved:
    """What came of a joint segmentation.

    Attributes:
        silhouettes: [views, height, width] bool, those that nothing contradicts as they were
        reasons: why views were contradicted, by position
        left: positions of the views that the others contradict still
    """

    silhouettes: np.ndarray
    reasons: Mapping[int, str] = field(default_factory=dict)
    left: Collection[int] = ()


class _Shown(NamedTuple):
    """What the views show and whence: ``look``, ``cameras`` and ``frames`` of ``solve_jointly``."""

    look: Callable[[int], np.ndarray]
    cameras: Cameras
    frames: np.ndarray


def find_contest(
    silhouettes: np.ndarray, cameras: Cameras, frames: np.ndarray, verdict: Verdict
) -> Contest:
    """Which silhouettes, and which parts of them, the other views contradict.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        frames: [views, 4] of the photographs within the images
        verdict: on the same silhouettes
    """
    hull = robust_carve(silhouettes, cameras, frames)
    area = np.maximum(silhouettes.sum(axis=(1, 2)), 1)
    found = Contest(filled=hull.disbelieved & ~silhouettes)
    found.filled[hull.distrusted] = False
    for i, silhouette in enumerate(silhouettes):
        part = hull.disbelieved[i] if i in hull.corrected else np.zeros_like(silhouette)
        if i in hull.distrusted or (i in verdict.outliers and not part.any()):
            found.whole.add(i)
            found.reasons[i] = "other views contradict it"
            continue
        specks, count = find_specks(silhouette)
        if part.any():
            found.reasons[i] = f"other views contradict {part.sum() / area[i]:.0%} of it"
        if count >= MANY and specks.sum() > SPECKLED * area[i]:
            found.reasons.setdefault(i, f"specks are {specks.sum() / area[i]:.1%} of it")
            part = part | ndimage.binary_dilation(specks, AROUND)
        if part.any():
            found.parts[i] = part
    return found


def find_specks(silhouette: np.ndarray) -> tuple[np.ndarray, int]:
    """Parts of an object, or of what is around it, of fewer than ``SPECK`` pixels.

    Returns:
        [height, width] bool, and how many they are
    """
    specks, found = np.zeros_like(silhouette), 0
    for part in (silhouette, ~silhouette):
        pieces, count = ndimage.label(part)
        small = np.bincount(pieces.ravel(), minlength=count + 1) < SPECK
        small[0] = False
        specks |= small[pieces]
        found += int(small.sum())
    return specks, found


def solve_jointly(
    look: Callable[[int], np.ndarray],
    silhouettes: np.ndarray,
    cameras: Cameras,
    verdict: Verdict,
    frames: np.ndarray | None = None,
    unreadable: Collection[int] = (),
    progress: Share = untold,
) -> Solved:
    """Segment again what the other views contradict, until all agree or nothing moves.

    Args:
        look: gives the photograph at a position, [height, width, 3] uint8
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        verdict: on the silhouettes; if it refuses to tell outliers, nothing is done
        frames: [views, 4] of the photographs within the images; the whole images if not given
        unreadable: positions of the views without a photograph to segment again
        progress: is told which share of the rounds is done
    """
    if verdict.refusal:
        return Solved(silhouettes)
    frames = whole_frames(silhouettes) if frames is None else frames
    new, contested = silhouettes, Contest()
    for done in range(ROUNDS):
        contest = find_contest(new, cameras, frames, verdict)
        _remember(contested, contest)
        views = [i for i in contested.views if i not in unreadable]
        if not views or len(_find_voting(new, contest)) < FEWEST:
            return Solved(new, contested.reasons, contested.views)
        before = new
        new = _segment_all(_Shown(look, cameras, frames), new, contest, contested, views)
        progress((done + 1) / ROUNDS)
        moved = (new != before).sum(axis=(1, 2)) / np.maximum(new.sum(axis=(1, 2)), 1)
        verdict = find_outliers(new, cameras, frames)
        if moved.max() < STILL:
            break
    left = find_contest(new, cameras, frames, verdict).whole | set(verdict.outliers)
    return Solved(new, contested.reasons, left)


def _remember(contested: Contest, now: Contest) -> None:
    """Add what is contradicted now to what was in the rounds before."""
    contested.whole |= now.whole
    for i, part in now.parts.items():
        contested.parts[i] = contested.parts.get(i, False) | part
    contested.reasons = now.reasons | contested.reasons


def _segment_all(
    shown: _Shown, silhouettes: np.ndarray, contest: Contest, contested: Contest, views: list[int]
) -> np.ndarray:
    """The silhouettes with these views segmented again, by those that are believed now."""
    voting = _find_voting(silhouettes, contest)
    calm = [i for i in voting if i not in contested.views] or voting
    sampled = [calm[k] for k in np.unique(np.linspace(0, len(calm) - 1, CALM).round().astype(int))]
    believed, of = silhouettes | contest.filled, [*sampled, *views]
    # Kept as bool until they are needed: as distances all views would take eight times the memory.
    allowed = iter(find_allowed(believed, shown.cameras, of, voting, shown.frames))
    depths = [_measure_depth(one) for one in islice(allowed, len(sampled))]
    hull_odds = _learn_hull(np.stack(depths), silhouettes[sampled], shown.frames[sampled])
    new = silhouettes.copy()
    for i, one in zip(views, allowed, strict=True):
        near = [shown.look(j)[_core(silhouettes[j])] for j in _nearest(shown.cameras, i, calm)]
        part = None if i in contested.whole else contested.parts[i]
        new[i] = _segment(
            shown.look(i),
            silhouettes[i],
            part,
            shown.frames[i],
            _measure_depth(one),
            hull_odds,
            near,
        )
    return new


def _segment(
    pixels: np.ndarray,
    silhouette: np.ndarray,
    part: np.ndarray | None,
    frame: np.ndarray,
    depth: np.ndarray,
    hull_odds: Callable[[np.ndarray], np.ndarray],
    near: list[np.ndarray],
) -> np.ndarray:
    """The silhouette [height, width] with a part, or all around the hull, decided anew.

    Args:
        part: [height, width] bool; None for all that is not beyond the hull
        depth: [height, width] of the pixels in the others' hull
        hull_odds: of pixels by their depth
        near: colours of the object in views nearby, each [n, 3]
    """
    inside = _inside(frame, depth.shape)
    free = inside & (depth > -OUTER if part is None else part)
    odds = hull_odds(depth)
    odds[free] += _compare_colours(pixels[free], near, pixels[inside & (depth <= -OUTER)])
    fixed = silhouette & (part is not None)
    new = settle_outline(cut(odds, pixels, free, fixed), pixels, free)
    if part is not None:
        return undo_shaving(silhouette, new, pixels)
    return keep_outline(silhouette, new) if iou(silhouette, new) >= MOSTLY_RIGHT else new


def _find_voting(silhouettes: np.ndarray, contest: Contest) -> list[int]:
    """Positions of the views that have a say: that show something and are not all contradicted."""
    return [i for i in find_shown(silhouettes).tolist() if i not in contest.whole]


def _compare_colours(
    asked: np.ndarray, around: list[np.ndarray], beyond: np.ndarray
) -> np.ndarray | float:
    """The logarithm of how much likelier colours [n, 3] are the object's than the background's.

    Args:
        around: colours of the object, as some views show it
        beyond: of the background
    """
    seen = np.concatenate(around) if around else beyond[:0]
    if not (len(seen) and len(beyond)):
        return 0.0
    odds = ColourModel(seen).log_density(asked) - ColourModel(beyond).log_density(asked)
    return np.clip(odds, -SURE, SURE)


def _measure_depth(region: np.ndarray) -> np.ndarray:
    """How deep pixels lie in a region, in 256ths of the image; negative outside: [height, width].

    Far outside, all of them, if there is no region.
    """
    if not region.any():
        return np.full(region.shape, -float(max(region.shape)))
    unit = max(1.0, max(region.shape) / 256)
    outside = ndimage.distance_transform_edt(~region)
    return (ndimage.distance_transform_edt(region) - outside) / unit


def _learn_hull(
    depths: np.ndarray, silhouettes: np.ndarray, frames: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    """From depths in the others' hull to the odds that a pixel there is the object.

    Args:
        depths, silhouettes: [views, height, width] of views that nothing contradicts
    """
    inside = np.stack([_inside(frame, depths.shape[1:]) for frame in frames])
    bins = _bin(depths)[inside]
    count = OUTER + DEEPEST + 1
    of_object = np.bincount(bins, silhouettes[inside], count)
    among = np.bincount(bins, minlength=count)
    odds = np.log((of_object + 1) / (among - of_object + 1))
    odds = np.clip(np.maximum.accumulate(odds), -SURE, SURE)  # a deeper pixel is no less likely
    return lambda depth: odds[_bin(depth)]


def _bin(depths: np.ndarray) -> np.ndarray:
    return (np.clip(np.rint(depths), -OUTER, DEEPEST) + OUTER).astype(int)


def _inside(frame: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The pixels of the photograph within its image: [height, width] bool."""
    left, top, right, bottom = frame
    inside = np.zeros(shape, bool)
    inside[top:bottom, left:right] = True
    return inside


def _core(silhouette: np.ndarray) -> np.ndarray:
    """A silhouette without its outline, whose pixels show something else as well."""
    core = ndimage.binary_erosion(silhouette)
    return core if core.any() else silhouette


def _nearest(cameras: Cameras, view: int, among: list[int]) -> list[int]:
    """The positions of the views that look from the nearest places to that of a view."""
    others = np.array([i for i in among if i != view], int)
    away = (cameras.centres[others] - cameras.centres[view]).norm(dim=1).numpy()
    return others[np.argsort(away, kind="stable")[:AROUND_VIEW]].tolist()
