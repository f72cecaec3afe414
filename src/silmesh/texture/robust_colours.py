"""Colours that the views agree on: means that highlights, hands and strays do not move.

A view's weight w falls with the distance r of its colour from the mean, which is found anew:

    w / (1 + (r / SCALE)^2)

It begins with the weighted median of each channel, so that one view of several cannot win by
seeing best what it alone sees so.
"""

import numpy as np

SCALE = 25.0  # of 255
ROUNDS = 5


def agree(colours: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Robust means over the views, and the weights that led to them.

    Args:
        colours: [views, points, 3]
        weights: [views, points], 0 where a view does not see a point
    Returns:
        [points, 3] and [views, points]
    """
    mean = _take_medians(colours, np.sqrt(weights))
    for _ in range(ROUNDS):
        apart = np.linalg.norm(colours - mean, axis=2)
        trust = weights / (1 + (apart / SCALE) ** 2)
        total = np.maximum(trust.sum(axis=0), 1e-12)
        mean = np.einsum("vn,vnc->nc", trust, colours) / total[:, None]
    return mean, trust


def _take_medians(colours: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted medians over the views of each channel: [points, 3]."""
    found = np.empty(colours.shape[1:])
    for channel in range(3):
        values = colours[..., channel]
        order = values.argsort(axis=0)
        below = np.take_along_axis(weights, order, axis=0).cumsum(axis=0)
        middle = (below >= below[-1] / 2).argmax(axis=0)
        at = np.take_along_axis(order, middle[None], axis=0)
        found[:, channel] = np.take_along_axis(values, at, axis=0)[0]
    return found
