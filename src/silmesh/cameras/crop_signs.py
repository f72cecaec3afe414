"""What photographs show of having been cropped one by one, before any camera is known."""

from collections import Counter

import numpy as np

from silmesh.geometry.frame import find_box, whole_frames

MOST = 0.8  # of the views: so many have to show it
CENTRED = 0.02  # of the photograph's longer side by which opposite margins may differ, and 1 pixel
ALIKE = 0.93  # mean IoU of silhouettes with what most of them share, from which they are alike
SAMPLES = 32  # along each side of a silhouette's box, to compare it with others
SIZES = 0.2  # of the views: of more sizes than that photographs were not taken by one camera


def see_crops(
    silhouettes: np.ndarray,
    frames: np.ndarray | None = None,
    scales: np.ndarray | None = None,
) -> str:
    """Why views seem to have been cropped to the object one by one; "" if nothing shows it.

    Args:
        silhouettes: [views, height, width] bool, none empty
        frames: [views, 4] of the photographs within the images; the whole images if not given
        scales: [views, 2] pixels of the working image for one of the photograph; sizes tell
            nothing if not given
    """
    frames = whole_frames(silhouettes) if frames is None else np.asarray(frames)
    sides = frames[:, 2:] - frames[:, :2]
    if scales is not None:
        sizes = Counter(map(tuple, np.round(sides / scales, 0).astype(int).tolist()))
        if are_many_sizes(len(sizes), len(silhouettes)):
            return f"they have {len(sizes)} different sizes"
    margins = find_margins(silhouettes, frames)
    apart = np.abs(margins[:, :2] - margins[:, 2:]).max(axis=1)
    if (apart <= CENTRED * sides.max(axis=1) + 1).mean() >= MOST:
        return "the object is in the middle of nearly all of them"
    return ""


def are_many_sizes(sizes: int, views: int) -> bool:
    """Whether photographs of so many sizes were cropped one by one, and not of two cameras."""
    return sizes > max(SIZES * views, 3)


def find_margins(silhouettes: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Pixels between each silhouette and its photograph's left, top, right and bottom: [views, 4].

    Args:
        silhouettes: [views, height, width] bool, none empty
        frames: [views, 4] of the photographs within the images
    """
    inside = np.array([find_box(silhouette) for silhouette in silhouettes]) - frames
    return inside * [1, 1, -1, -1]


def are_tight(silhouettes: np.ndarray, frames: np.ndarray | None) -> bool:
    """Whether nearly all silhouettes touch opposite sides of their photographs.

    So does what is cropped to the object's box, which the frame then does not cut.
    """
    frames = whole_frames(silhouettes) if frames is None else np.asarray(frames)
    touch = find_margins(silhouettes, frames) <= 0
    return bool(((touch[:, 0] & touch[:, 2]) | (touch[:, 1] & touch[:, 3])).mean() >= MOST)


def measure_contact(silhouettes: np.ndarray, frames: np.ndarray | None) -> np.ndarray:
    """Over which share of two opposite sides of its photograph each silhouette lies: [views].

    The lesser of both sides, at whichever pair of sides it is more. A box about a rounded object
    touches it at points; a crop that cuts it, along lines.
    """
    frames = whole_frames(silhouettes) if frames is None else np.asarray(frames)
    found = []
    for silhouette, (left, top, right, bottom) in zip(silhouettes, frames, strict=True):
        inside = silhouette[top:bottom, left:right]
        sides = [(inside[:, 0], inside[:, -1]), (inside[0], inside[-1])]
        found.append(max(min(one.mean(), other.mean()) for one, other in sides))
    return np.array(found)


def are_alike(silhouettes: np.ndarray) -> bool:
    """Whether all silhouettes are the same but for their place and size.

    Crops put those of any turntable, and pictures of nothing that turned, where they please.

    Args:
        silhouettes: [views, height, width] bool, none empty
    """
    boxed = np.stack([_sample_box(silhouette) for silhouette in silhouettes])
    most = boxed.mean(axis=0) > 0.5
    shared, either = (boxed & most).sum(axis=(1, 2)), (boxed | most).sum(axis=(1, 2))
    return bool((shared / either).mean() >= ALIKE)


def _sample_box(silhouette: np.ndarray) -> np.ndarray:
    """What is in a silhouette's box, at even samples: [SAMPLES, SAMPLES] bool."""
    left, top, right, bottom = find_box(silhouette)
    at = (np.arange(SAMPLES) + 0.5) / SAMPLES
    v, u = np.floor([top + at * (bottom - top), left + at * (right - left)]).astype(int)
    return silhouette[np.ix_(v, u)]
