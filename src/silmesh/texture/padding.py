"""What lies between charts: colours of what is near, so that no smaller picture shows a gap.

A picture is halved until one texel is left, each the mean of the known of four (pull); from there
back, what is unknown takes the colour of the coarser picture (push). Gortler et al. 1996.
"""

import numpy as np


def fill_gaps(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Give texels that are unknown the colours of the known ones near them.

    Args:
        image: [height, width, 3] float32
        known: [height, width] bool
    Returns:
        [height, width, 3] float32; the known ones unchanged
    """
    if known.all() or not known.any():
        return image
    height, width = known.shape
    even = [(0, height % 2), (0, width % 2)]
    weights = np.pad(known.astype(np.float32), even)
    colours = np.pad(image * known[..., None], [*even, (0, 0)])
    count, total = _add_blocks(weights), _add_blocks(colours)
    coarse = fill_gaps(total / np.maximum(count, 1)[..., None], count > 0)
    spread = coarse.repeat(2, axis=0).repeat(2, axis=1)[:height, :width]
    return np.where(known[..., None], image, spread)


def _add_blocks(array: np.ndarray) -> np.ndarray:
    """The sums of blocks of 2 x 2."""
    rows = array[::2] + array[1::2]
    return rows[:, ::2] + rows[:, 1::2]
