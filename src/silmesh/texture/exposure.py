"""The photographs' exposure and white balance, evened out: one gain a channel and view.

A point that several views see has one colour a, which view v shows as a e^g_v. With weights w of
how well it is seen, gains and colours minimise

    sum over views and points of  w (log c - log a - g)^2  +  RIDGE <w> sum over views of g^2

of which the colours are eliminated, so that a system of the size of the views is left. Points that
do not agree (highlights, shadows) are weighted down and it is solved again (robust least squares).
"""

import numpy as np

RIDGE = 0.05  # of a view's mean weight: a turntable's light moves over the object, which is no gain
SPREAD = 0.15  # in the logarithm, of what agrees
ROUNDS = 4
DARKEST = 8.0  # of 255: darker than this, the logarithm is noise


def find_gains(colours: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """What the views' colours are to be multiplied by to agree: [views, 3], about 1.

    Args:
        colours: [views, points, 3] of 0..255
        weights: [views, points], 0 where a view does not see a point
    """
    return np.stack([_find_gains(colours[..., i], weights) for i in range(3)], axis=1)


def _find_gains(colours: np.ndarray, weights: np.ndarray) -> np.ndarray:
    logs = np.log(np.maximum(colours, DARKEST))
    usable = weights * ((colours > DARKEST) & (colours < 250))
    trust, gains = usable, np.zeros(len(colours))
    for _ in range(ROUNDS):
        gains = _solve(logs, trust)
        apart = logs - gains[:, None] - _average(logs - gains[:, None], trust)
        trust = usable / (1 + (apart / SPREAD) ** 2)
    return np.exp(-gains)


def _average(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return (weights * values).sum(axis=0) / np.maximum(weights.sum(axis=0), 1e-12)


def _solve(logs: np.ndarray, weights: np.ndarray) -> np.ndarray:
    total = np.maximum(weights.sum(axis=0), 1e-12)
    own = weights.sum(axis=1)
    left = np.diag(own) - (weights / total) @ weights.T
    right = (weights * (logs - _average(logs, weights))).sum(axis=1)
    ridge = RIDGE * max(own.mean(), 1e-12)
    gains = np.linalg.solve(left + ridge * np.eye(len(own)), right)
    return gains - gains.mean()
