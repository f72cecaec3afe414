"""What lies between charts: colours of what is near, so that no smaller picture shows a gap.

Beside a chart a texel takes the mean of the known ones about it, so that what is looked up at the
chart's very edge is as sharp as within. The rest is filled from a pyramid: a picture is halved
until one texel is left, each the mean of the known of four (pull); from there back, what is unknown
takes the colour of the coarser picture (push). Gortler et al. 1996.
"""

import numpy as np
from scipy.ndimage import binary_dilation

RINGS = 2  # texels beside a chart that are filled from it alone
AROUND = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)


def fill_gaps(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Give texels that are unknown the colours of the known ones near them.

    Args:
        image: [height, width, 3] float32
        known: [height, width] bool
    Returns:
        [height, width, 3] float32; the known ones unchanged
    """
    image = image.copy()
    for _ in range(RINGS):
        known = _grow(image, known)
    return _pull_and_push(image, known)


def _grow(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Give texels beside known ones the means of those about them: what is known then."""
    grown = binary_dilation(known, np.ones((3, 3), bool))
    rows, columns = np.nonzero(grown & ~known)
    total, count = np.zeros((len(rows), 3), np.float32), np.zeros((len(rows), 1), np.float32)
    for down, across in AROUND:
        at = (
            np.clip(rows + down, 0, len(known) - 1),
            np.clip(columns + across, 0, known.shape[1] - 1),
        )
        weight = (known[at] / (down**2 + across**2)).astype(np.float32)[:, None]
        total += weight * image[at]
        count += weight
    image[rows, columns] = total / count
    return grown


def _pull_and_push(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    if known.all() or not known.any():
        return image
    height, width = known.shape
    even = [(0, height % 2), (0, width % 2)]
    weights = np.pad(known.astype(np.float32), even)
    colours = np.pad(image * known[..., None], [*even, (0, 0)])
    count, total = _add_blocks(weights), _add_blocks(colours)
    coarse = _pull_and_push(total / np.maximum(count, 1)[..., None], count > 0)
    spread = coarse.repeat(2, axis=0).repeat(2, axis=1)[:height, :width]
    return np.where(known[..., None], image, spread)


def _add_blocks(array: np.ndarray) -> np.ndarray:
    """The sums of blocks of 2 x 2."""
    rows = array[::2] + array[1::2]
    return rows[:, ::2] + rows[:, 1::2]
