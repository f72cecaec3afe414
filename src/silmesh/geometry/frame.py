"""What a photograph can say of the object, from its own frame: the one notion that all share.

A frame is left, top, right and bottom of the photograph within its working image, in pixels. A
silhouette that lies whole within it says of all the rest, beyond the frame too, that it is outside.
One that the frame cuts says nothing of what lies beyond, and where it meets the frame it has no
outline: the padding of a working image is no background.

    +--working image--+
    |     |#  |       |     # the object: here its lower left leaves the photograph,
    |     |## |       |       so that what is beyond is unknown, not outside
    +-----+---+-------+
"""

from collections.abc import Sequence

import numpy as np

WHOLE = 4  # silhouettes that no frame cuts, from which on the others are not needed to see it whole


def find_shown(silhouettes: np.ndarray) -> np.ndarray:
    """Positions of the views whose silhouette is not empty; an empty one says nothing."""
    return np.flatnonzero(silhouettes.any(axis=(1, 2)))


def find_box(silhouette: np.ndarray) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of what a silhouette fills, as a frame's; all 0 if it is empty.

    Args:
        silhouette: [height, width] bool
    """
    rows, columns = (np.flatnonzero(silhouette.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return 0, 0, 0, 0
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def whole_frames(silhouettes: np.ndarray) -> np.ndarray:
    """The frames of photographs that fill their images [views, height, width]: [views, 4]."""
    count, height, width = silhouettes.shape
    return np.tile([0, 0, width, height], (count, 1))


def is_cut(silhouettes: np.ndarray, frames: Sequence[Sequence[int]] | None = None) -> np.ndarray:
    """Whether the frame cuts each silhouette, so that the object may go on beyond it: [views] bool.

    Args:
        silhouettes: [views, height, width] bool
        frames: [views, 4] of the photographs within the images; the whole images if not given
    """
    frames = whole_frames(silhouettes) if frames is None else frames
    pairs = zip(silhouettes, frames, strict=True)
    return np.array([count_on_frame(silhouette, frame) > 0 for silhouette, frame in pairs], bool)


def count_on_frame(silhouette: np.ndarray, frame: Sequence[int]) -> int:
    """Pixels of a silhouette, [height, width] bool, on the edge of its photograph, or beyond it.

    Args:
        frame: of the photograph within the image
    """
    left, top, right, bottom = frame
    within = silhouette[top + 1 : bottom - 1, left + 1 : right - 1]
    return int(np.count_nonzero(silhouette) - np.count_nonzero(within))


def open_frames(
    silhouettes: np.ndarray, frames: Sequence[Sequence[int]] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Which views are cut, [views] bool, and within what each speaks: [views, 4] int64.

    That is the frame of a view that is cut, and the whole image of one that is not.
    """
    cut = is_cut(silhouettes, frames)
    spoken = whole_frames(silhouettes)
    if frames is not None:
        spoken = np.where(cut[:, None], np.asarray(frames), spoken)
    return cut, spoken.astype(np.int64)


def known_pixels(
    silhouettes: np.ndarray, frames: Sequence[Sequence[int]] | None = None
) -> np.ndarray | None:
    """Of which pixels each view says anything: [views, height, width] bool; None if of all.

    Args:
        silhouettes: [views, height, width] bool
        frames: [views, 4] of the photographs within the images; the whole images if not given
    """
    _, spoken = open_frames(silhouettes, frames)
    if (spoken == whole_frames(silhouettes)).all():
        return None
    known = np.zeros(silhouettes.shape, bool)
    for part, (left, top, right, bottom) in zip(known, spoken, strict=True):
        part[top:bottom, left:right] = True
    return known


def bound_object(silhouettes: np.ndarray, frames: Sequence[Sequence[int]] | None = None) -> bool:
    """Whether silhouettes bound the object: no frame cuts one, or those that none cuts are enough.

    Where they do not, there are places beyond the frames that hardly any view speaks of.
    """
    cut = is_cut(silhouettes, frames)
    return not cut.any() or int((silhouettes.any(axis=(1, 2)) & ~cut).sum()) >= WHOLE


def find_whole(
    silhouettes: np.ndarray, frames: Sequence[Sequence[int]] | None = None
) -> np.ndarray:
    """Positions of the views that show the object whole, if some do not and these are enough.

    Else of all. Empty silhouettes show nothing.
    """
    cut = is_cut(silhouettes, frames)
    whole = np.flatnonzero(silhouettes.any(axis=(1, 2)) & ~cut)
    return whole if cut.any() and len(whole) >= WHOLE else np.arange(len(silhouettes))
