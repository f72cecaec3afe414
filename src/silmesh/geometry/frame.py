"""The frame of a photograph within its working image, which may cut the object.

A frame is left, top, right and bottom in pixels. What lies beyond it was never photographed.
"""

from collections.abc import Sequence

import numpy as np


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
    """Pixels of a silhouette, [height, width] bool, on the edge of its photograph.

    Args:
        frame: of the photograph within the image
    """
    left, top, right, bottom = frame
    inside = silhouette[top:bottom, left:right]
    return int(inside.sum() - inside[1:-1, 1:-1].sum())
