"""Outliers: silhouettes that the other views contradict, with a table of measures of each view.

Two shares of a silhouette's area measure the contradiction. ``unexplained`` is what it shows
although more than k other views deny it, as of a plate that passes for the object. ``missing`` is
what it does not show although at most k other views deny it, as of a part that was not segmented.
A view is an outlier if a share is large beside those of the other views of the same object, since
cameras that are a little wrong raise the shares of all views.

``geometry.robust_hull`` says which views to distrust while a body is carved. It cannot take the
place of this: it looks at views only where the strict hull fails, of fewer than six it doubts none,
and it gives no shares, which the table has of every view and of views that were segmented again.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import torch
from scipy import ndimage

from silmesh.ahead import ahead
from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import count_on_frame, find_box, known_pixels, whole_frames
from silmesh.scene.votes import count_denials

FINE = 64  # rays along an image's side that the shares are measured by
# In each round, one of so many trusted views may be wrong at a point. The first rounds tolerate
# much, as outliers still vote; the last ones little, as a hull that tolerates more is larger.
TOLERANCES = (5, 6, 8, 12, 24, 24)
# The same of a round before these, if the outliers deny more than LEAST of most views.
MANY = 3
LEAST = 0.12  # a view whose shares are both smaller is no outlier
# With fewer trusted views the hull is so large that ``missing`` says nothing, and it is set to 0.
ENOUGH = 6
SLACK = 2  # pixels around a silhouette that do not count as missing
# A view is no outlier either if its shares lie within so many standard deviations of the median.
SPREAD = 5


@dataclass(frozen=True)
class Verdict:
    """What was found about the silhouettes of a scene.

    Attributes:
        rows: a table's row for each view
        reasons: why each view is an outlier; an empty string for an inlier
        refusal: why outliers cannot be told from inliers, or None
    """

    rows: list[dict[str, float]]
    reasons: list[str]
    refusal: str | None

    @property
    def outliers(self) -> list[int]:
        """Positions of the outliers."""
        return [i for i, reason in enumerate(self.reasons) if reason]

    @property
    def inliers(self) -> list[int]:
        """Positions of the inliers."""
        return [i for i, reason in enumerate(self.reasons) if not reason]

    def explain(self, known: Mapping[int, str], also: Mapping[int, str] | None = None) -> "Verdict":
        """The same verdict with other reasons, by position.

        Args:
            known: reasons that replace those that were found
            also: reasons of views for which none was found
        """
        also = also or {}
        reasons = [known.get(i) or why or also.get(i, "") for i, why in enumerate(self.reasons)]
        return replace(self, reasons=reasons)


def find_outliers(
    silhouettes: np.ndarray,
    cameras: Cameras,
    frames: np.ndarray | None = None,
    suspects: Sequence[int] = (),
) -> Verdict:
    """Find the silhouettes that the other views contradict.

    Args:
        silhouettes: [views, height, width] bool, in the order in which they were taken
        cameras: of these views, in the normalised world
        frames: [views, 4] left, top, right and bottom of the photographs within the images; the
            whole images if not given
        suspects: positions of views that something else speaks against, heard last
    """
    frames = whole_frames(silhouettes) if frames is None else frames
    shown = silhouettes.any(axis=(1, 2))
    unexplained, missing, bad = _find_contradicted(silhouettes, cameras, frames, shown, suspects)
    refusal = None
    if 2 * bad.sum() > shown.sum():
        refusal = "silhouettes and cameras contradict each other in most views"
        bad = np.zeros_like(bad)
    pairs = zip(silhouettes, frames, strict=True)
    rows = list(ahead(lambda pair: describe(*pair), pairs, torch.get_num_threads()))
    jumps = area_jumps(np.array([row["area"] for row in rows]))
    for i, row in enumerate(rows):
        row |= {"area_jump": jumps[i], "unexplained": unexplained[i], "missing": missing[i]}
    reasons = [
        "empty" if not shown[i] else _explain(unexplained[i], missing[i]) if bad[i] else ""
        for i in range(len(rows))
    ]
    return Verdict(rows, reasons, refusal)


def _find_contradicted(
    silhouettes: np.ndarray,
    cameras: Cameras,
    frames: np.ndarray,
    shown: np.ndarray,
    suspects: Sequence[int],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The two shares of each view, and whether the view is an outlier: each [views].

    This works in rounds. The views that the trusted ones contradict most are not trusted in the
    next round, and are trusted again if that round clears them.
    """
    suspected = np.isin(np.arange(len(shown)), suspects)
    trusted = np.flatnonzero(shown & ~suspected)
    unexplained, missing = disagreement(silhouettes, cameras, frames, trusted, TOLERANCES[-1])
    bad = shown & (_excess(unexplained, missing, trusted) > 0)
    tolerances = TOLERANCES if bad.any() else ()
    if trusted.size and np.median(unexplained[trusted]) > LEAST:  # many deny, and the same of all
        tolerances = (MANY, *TOLERANCES)
    for tolerance in tolerances:
        unexplained, missing = disagreement(silhouettes, cameras, frames, trusted, tolerance)
        excess = _excess(unexplained, missing, trusted)
        bad = shown & (excess > 0)
        worst = bad & (excess > excess[shown].max() / 2) if tolerance < TOLERANCES[-1] else bad
        if 2 * worst.sum() > shown.sum():
            break
        lost = worst | (bad & suspected)
        trusted = np.flatnonzero(shown & ~lost)
    return unexplained, missing, bad


def _explain(unexplained: float, missing: float) -> str:
    if unexplained >= missing:
        return f"other views deny {unexplained:.0%} of it"
    return f"lacks {missing:.0%}, which other views see"


def _excess(unexplained: np.ndarray, missing: np.ndarray, trusted: Sequence[int]) -> np.ndarray:
    """By how much the larger excess of each view's shares passes its threshold: [views]."""
    over = []
    for shares in (unexplained, missing):
        usual = np.median(shares[trusted])
        deviation = 1.4826 * np.median(np.abs(shares[trusted] - usual))
        over.append(shares - max(LEAST, usual + LEAST / 2, usual + SPREAD * deviation))
    return np.maximum(*over)


def disagreement(
    silhouettes: np.ndarray,
    cameras: Cameras,
    frames: np.ndarray,
    trusted: Sequence[int],
    tolerance: int,
) -> tuple[np.ndarray, np.ndarray]:
    """How each view disagrees with the hull of the trusted others, of which 1 / tolerance may err.

    Returns:
        ``unexplained`` [views], what a view shows and the others deny, as a share of its area; and
        ``missing`` [views], what the others allow more than ``SLACK`` pixels from it, as a share of
        its area or of the median area if that is larger (a thin object is small edge on). Both are
        0 for an empty silhouette, and ``missing`` is if fewer than ``ENOUGH`` views are trusted
    """
    stride = -(-max(silhouettes.shape[1:]) // FINE)
    most = len(trusted) // tolerance
    everyone = range(len(silhouettes))
    denials = count_denials(silhouettes, cameras, everyone, trusted, most + 1, stride, frames)
    shown, near = silhouettes[:, ::stride, ::stride], _see_near(silhouettes, stride)
    known = known_pixels(silhouettes, frames)
    if known is not None:  # what the others see beyond a photograph's frame is not lacking there
        near = near | ~known[:, ::stride, ::stride]
    area = np.maximum(shown.sum(axis=(1, 2)), 1)
    usual = np.maximum(area, np.median(area[trusted]))
    unexplained = (shown & (denials > most)).sum(axis=(1, 2)) / area
    missing = (~near & (denials <= most)).sum(axis=(1, 2)) / usual
    if len(trusted) < ENOUGH:
        missing = np.zeros_like(missing)
    empty = ~silhouettes.any(axis=(1, 2))
    return np.where(empty, 0, unexplained), np.where(empty, 0, missing)


def _see_near(silhouettes: np.ndarray, stride: int) -> np.ndarray:
    """Which of every ``stride``-th pixels lie within ``SLACK`` steps of their silhouettes."""
    rows, columns = (np.arange(0, side, stride) for side in silhouettes.shape[1:])
    bottom, right = (side - 1 for side in silhouettes.shape[1:])
    near = np.zeros((len(silhouettes), len(rows), len(columns)), bool)
    steps = range(-SLACK, SLACK + 1)
    for down, across in product(steps, steps):
        if abs(down) + abs(across) <= SLACK:  # what lies beyond the border is moved back, so nearer
            row, column = (rows + down).clip(0, bottom), (columns + across).clip(0, right)
            near |= silhouettes[:, row[:, None], column]
    return near


def describe(silhouette: np.ndarray, frame: np.ndarray) -> dict[str, float]:
    """Measure a silhouette, [height, width] bool, by itself.

    Args:
        frame: left, top, right and bottom of the photograph within the image
    Returns:
        ``area``: its share of the image; ``centroid_u``, ``centroid_v``: in pixels, NaN if it is
        empty; ``on_frame``: pixels on the photograph's edge; ``pieces``, ``holes``: their numbers
    """
    height, width = silhouette.shape
    left, top, right, bottom = find_box(silhouette)
    inside = silhouette[top:bottom, left:right]
    rows, columns = np.nonzero(inside)
    _, pieces = ndimage.label(inside, np.ones((3, 3)))
    _, grounds = ndimage.label(np.pad(~inside, 1, constant_values=True))
    return {
        "area": len(rows) / (height * width),
        "centroid_u": float(columns.mean() + left + 0.5) if len(rows) else np.nan,
        "centroid_v": float(rows.mean() + top + 0.5) if len(rows) else np.nan,
        "on_frame": count_on_frame(silhouette, frame),
        "pieces": pieces,
        "holes": grounds - 1,
    }


def area_jumps(areas: np.ndarray) -> np.ndarray:
    """The factor, at least 1, between each view's area and the nearer of its neighbours': [views].

    Photographs of a turn change slowly, so a large factor is suspicious.
    """
    logs = np.log(np.maximum(areas, 1e-9))
    steps = np.stack([np.abs(logs - np.roll(logs, shift)) for shift in (1, -1)])
    steps[0, 0], steps[1, -1] = steps[1, 0], steps[0, -1]  # the ends have one neighbour
    return np.exp(steps.min(axis=0))
