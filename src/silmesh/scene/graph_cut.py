"""The cheapest labelling of an image's pixels as object and background, by a minimum cut.

Each pixel has odds that it is the object, and each two neighbours pay for being told apart, the
less the more their colours differ (Boykov and Jolly 2001):

    cost = sum over pixels of [background] odds  +  sum over neighbours of [apart] w
    w = SMOOTH / distance * exp(-|difference of colours|^2 / (2 * its mean over the image))

The minimum over all labellings is a minimum cut of the graph whose arcs have these capacities.
"""

import numpy as np

from silmesh.geometry.minimum_cut import cut_graph

SMOOTH = 2.0  # nats that two neighbours of one colour pay for being told apart
# Half of a pixel's eight neighbours; the others have it among theirs.
NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


def cut(odds: np.ndarray, pixels: np.ndarray, free: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Label the pixels of an image: [height, width] bool, true on the object.

    Args:
        odds: [height, width] float, the logarithm of how much likelier each pixel is the object
        pixels: [height, width, 3] uint8
        free: [height, width] bool, the pixels that are to be labelled
        fixed: [height, width] bool, the labels of the others
    """
    if not free.any():
        return fixed.copy()
    index = np.full(free.shape, -1)
    index[free] = np.arange(free.sum())
    near, far, weights = _weigh_neighbours(pixels, free)
    odds = odds + _pull(near, far, weights, free, fixed)
    both = free.flat[near] & free.flat[far]
    near, far = index.flat[near[both]], index.flat[far[both]]
    labels = cut_graph(odds[free], near, far, weights[both])
    out = fixed.copy()
    out[free] = labels
    return out


def _weigh_neighbours(
    pixels: np.ndarray, free: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Neighbours of which at least one is free: both positions in the image, and their weights."""
    height, width = free.shape
    at = np.arange(free.size).reshape(free.shape)
    colours = pixels.astype(np.float32)
    parts, squares = [], []
    for down, across in NEIGHBOURS:
        left, right = max(0, -across), width - max(0, across)
        a = np.s_[: height - down, left:right]
        b = np.s_[down:, left + across : right + across]
        square = ((colours[a] - colours[b]) ** 2).sum(axis=-1)
        squares.append(square.mean())
        some = free[a] | free[b]
        parts.append((at[a][some], at[b][some], square[some], np.hypot(down, across)))
    mean = max(float(np.mean(squares)), 1e-6)
    near, far = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    weights = [SMOOTH / apart * np.exp(-square / (2 * mean)) for _, _, square, apart in parts]
    return near, far, np.concatenate(weights)


def _pull(
    near: np.ndarray, far: np.ndarray, weights: np.ndarray, free: np.ndarray, fixed: np.ndarray
) -> np.ndarray:
    """How much the fixed neighbours of pixels add to their odds: [height, width]."""
    pull = np.zeros(free.size)
    for one, other in ((near, far), (far, near)):
        held = free.flat[one] & ~free.flat[other]
        sign = np.where(fixed.flat[other[held]], 1, -1)
        pull += np.bincount(one[held], sign * weights[held], free.size)
    return pull.reshape(free.shape)
