"""Quality of silhouettes: what each shows alone, beside its neighbours, and against all others.

A silhouette that the others contradict is doubtful. Two shares of its area say how much they do:
what it shows although more than k others deny it (a plate that passes for the object), and what
it denies although at most k others do (a part that is lacking). Both are judged against the other
views of the same object, since cameras that are a little wrong raise them in all views alike.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import count_on_frame, known_pixels, whole_frames
from silmesh.scene.votes import ROUND, count_denials

FINE = 64  # rays along an image's side: enough to judge, not to draw
# In each round, one view of so many may be wrong at a point. Much at first, when wrong silhouettes
# still speak; little at last, since a hull that bears with more is larger.
TOLERANCES = (5, 6, 8, 12, 24, 24)
LEAST = 0.12  # shares below that are no reason for doubt
ENOUGH = 6  # trusted views; fewer allow so much around the object that nothing can be lacking
SLACK = 2  # pixels that the others may see more, all around
SPREAD = 5  # nor are those within so many deviations of the median over the views


@dataclass(frozen=True)
class Verdict:
    """What was found about the silhouettes of a scene.

    Attributes:
        rows: a table's row for each view
        doubts: why each view is doubtful; empty for one that is not
        refusal: why nothing can be told of the views by each other, or None
    """

    rows: list[dict[str, float]]
    doubts: list[str]
    refusal: str | None

    @property
    def doubtful(self) -> list[int]:
        """The positions of the doubtful views."""
        return [i for i, doubt in enumerate(self.doubts) if doubt]

    @property
    def sound(self) -> list[int]:
        """The positions of the others."""
        return [i for i, doubt in enumerate(self.doubts) if not doubt]

    def explain(self, lost: Mapping[int, str]) -> "Verdict":
        """The same, where it is known why the silhouettes at these positions are empty."""
        return replace(self, doubts=[lost.get(i, doubt) for i, doubt in enumerate(self.doubts)])


def judge(silhouettes: np.ndarray, cameras: Cameras, frames: np.ndarray | None = None) -> Verdict:
    """Find the doubtful silhouettes.

    Args:
        silhouettes: [views, height, width] bool, in the order in which they were taken
        cameras: of these views, in the normalised world
        frames: [views, 4] left, top, right and bottom of the photographs within the images; the
            whole images if not given
    """
    frames = whole_frames(silhouettes) if frames is None else frames
    shown = silhouettes.any(axis=(1, 2))
    unexplained, missing, bad = _find_contradicted(silhouettes, cameras, frames, shown)
    refusal = None
    if 2 * bad.sum() > shown.sum():
        refusal = "silhouettes and cameras contradict each other in most views"
        bad = np.zeros_like(bad)
    rows = [describe(s, frame) for s, frame in zip(silhouettes, frames, strict=True)]
    jumps = area_jumps(np.array([row["area"] for row in rows]))
    for i, row in enumerate(rows):
        row |= {"area_jump": jumps[i], "unexplained": unexplained[i], "missing": missing[i]}
    doubts = [
        "empty" if not shown[i] else _explain(unexplained[i], missing[i]) if bad[i] else ""
        for i in range(len(rows))
    ]
    return Verdict(rows, doubts, refusal)


def _find_contradicted(
    silhouettes: np.ndarray, cameras: Cameras, frames: np.ndarray, shown: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The two shares of each view, and whether they are a reason for doubt: each [views].

    In rounds: those that the trusted views contradict most lose their say about the others, and
    get it back if the next round clears them.
    """
    trusted = np.flatnonzero(shown)
    unexplained, missing = disagreement(silhouettes, cameras, frames, trusted, TOLERANCES[-1])
    bad = shown & (_excess(unexplained, missing, trusted) > 0)
    for tolerance in TOLERANCES if bad.any() else ():
        unexplained, missing = disagreement(silhouettes, cameras, frames, trusted, tolerance)
        excess = _excess(unexplained, missing, trusted)
        bad = shown & (excess > 0)
        worst = bad & (excess > excess[shown].max() / 2) if tolerance < TOLERANCES[-1] else bad
        if 2 * worst.sum() > shown.sum():
            break
        trusted = np.flatnonzero(shown & ~worst)
    return unexplained, missing, bad


def _explain(unexplained: float, missing: float) -> str:
    if unexplained >= missing:
        return f"other views deny {unexplained:.0%} of it"
    return f"lacks {missing:.0%}, which other views see"


def _excess(unexplained: np.ndarray, missing: np.ndarray, trusted: Sequence[int]) -> np.ndarray:
    """By how much the worse of each view's shares passes what is usual among the trusted."""
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
    """How each view disagrees with what the trusted others allow, all but one of ``tolerance``.

    Returns:
        [views] what it shows and they deny, a share of its area, and [views] what they allow more
        than ``SLACK`` pixels from it, a share of its area or of the median area if that is more
        (a thin object seen edge on is small), 0 if fewer than ``ENOUGH`` speak; 0 for an empty
        silhouette
    """
    stride = -(-max(silhouettes.shape[1:]) // FINE)
    most = len(trusted) // tolerance
    everyone = range(len(silhouettes))
    denials = count_denials(silhouettes, cameras, everyone, trusted, most + 1, stride, frames)
    near = ndimage.binary_dilation(silhouettes, ROUND[None], iterations=SLACK)
    known = known_pixels(silhouettes, frames)
    if known is not None:  # what the others see beyond a photograph's frame is not lacking there
        near = near | ~known
    shown, near = (part[:, ::stride, ::stride] for part in (silhouettes, near))
    area = np.maximum(shown.sum(axis=(1, 2)), 1)
    usual = np.maximum(area, np.median(area[trusted]))
    unexplained = (shown & (denials > most)).sum(axis=(1, 2)) / area
    missing = (~near & (denials <= most)).sum(axis=(1, 2)) / usual
    if len(trusted) < ENOUGH:
        missing = np.zeros_like(missing)
    empty = ~silhouettes.any(axis=(1, 2))
    return np.where(empty, 0, unexplained), np.where(empty, 0, missing)


def describe(silhouette: np.ndarray, frame: np.ndarray) -> dict[str, float]:
    """What a silhouette, [height, width] bool, shows by itself.

    Args:
        frame: left, top, right and bottom of the photograph within the image
    Returns:
        ``area``: its share of the image; ``centroid_u``, ``centroid_v``: in pixels, NaN if it is
        empty; ``on_frame``: pixels on the photograph's edge; ``pieces``, ``holes``: their numbers
    """
    height, width = silhouette.shape
    rows, columns = np.nonzero(silhouette)
    _, pieces = ndimage.label(silhouette, np.ones((3, 3)))
    _, grounds = ndimage.label(np.pad(~silhouette, 1, constant_values=True))
    return {
        "area": len(rows) / (height * width),
        "centroid_u": float(columns.mean() + 0.5) if len(rows) else np.nan,
        "centroid_v": float(rows.mean() + 0.5) if len(rows) else np.nan,
        "on_frame": count_on_frame(silhouette, frame),
        "pieces": pieces,
        "holes": grounds - 1,
    }


def area_jumps(areas: np.ndarray) -> np.ndarray:
    """How far each view's area is from those of the views before and after it: [views].

    The factor to the nearer one of the two, at least 1; photographs of a turn change slowly.
    """
    logs = np.log(np.maximum(areas, 1e-9))
    steps = np.stack([np.abs(logs - np.roll(logs, shift)) for shift in (1, -1)])
    steps[0, 0], steps[1, -1] = steps[1, 0], steps[0, -1]  # the ends have one neighbour
    return np.exp(steps.min(axis=0))
