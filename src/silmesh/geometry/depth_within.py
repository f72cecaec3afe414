"""How far inside a silhouette its pixels lie, where that is near the outline."""

import numpy as np
from scipy.ndimage import distance_transform_edt

TILE = 128  # pixels a side of what is looked at together


def depth_within(silhouette: np.ndarray, reach: int) -> np.ndarray:
    """Distance of each pixel to the nearest one outside; the image's border is no outline.

    Only tiles near an outline are measured, so that the time of a large image grows with the
    outline's length.

    Args:
        silhouette: [height, width] bool
        reach: pixels; what lies deeper has this depth
    Returns:
        [height, width] float32, 0 outside
    """
    padded = np.pad(silhouette, reach, mode="edge")
    found = np.where(silhouette, np.float32(reach), np.float32(0))
    height, width = silhouette.shape
    for top in range(0, height, TILE):
        for left in range(0, width, TILE):
            window = padded[top : top + TILE + 2 * reach, left : left + TILE + 2 * reach]
            if window.any() and not window.all():
                depth = distance_transform_edt(window)[reach:-reach, reach:-reach]
                found[top : top + TILE, left : left + TILE] = np.minimum(depth, reach)
    return found
