"""How exactly a turntable and the crops of its views are known: standard deviations.

They are those of the derivatives of the residuals at the fit. Where the photographs' middles were,
no outline shows (``silmesh.cameras.crop_gauge``): the deviations are of cameras that were aimed at
the object to within AIM.
"""

from collections.abc import Sequence

import numpy as np

from silmesh.cameras.crop_gauge import aim, find_aim, move_world
from silmesh.cameras.crops import Cropped
from silmesh.cameras.frontier import NUDGE
from silmesh.cameras.turntable_residuals import AXIS, ELEVATION, INDEPENDENT

AIM = 0.04  # standard deviation, in sizes of the image, of where the camera was aimed


def find_deviations(
    cropped: Cropped, x: np.ndarray, agrees: np.ndarray, noise: float, known: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations of the turntable's parameters, and of the crops [views, 3].

    Those of the crops are against each other: what moves all with the object in the world does not
    count.

    Args:
        x: the parameters at the fit, as ``Cropped`` has them
        agrees: [views] bool, whose residuals count
        noise: of these, in pixels
        known: positions of the turntable's parameters that were given
    Returns:
        in the units of x: of the crops pixels, pixels, and the logarithm of the scale
    """
    own, crops = cropped.split(x)
    shared = [i for i in range(cropped.turn.shared) if i not in (*known, AXIS)]
    free = np.r_[shared, cropped.own_crops(len(own))].astype(int)
    precision, open_way = _weigh(cropped, x, agrees, noise), np.zeros((len(x), 1))
    if ELEVATION not in known:
        open_way, across = _find_open_way(cropped, x), _find_aim_slopes(cropped, x)
        keep = np.eye(len(x)) - open_way @ across
        precision = keep.T @ precision @ keep
        precision += across.T @ across / (AIM * cropped.turn.size) ** 2
    prior = np.r_[cropped.turn.prior()[1], cropped.spread()][free]
    covariance = np.zeros((len(x), len(x)))
    own_part = np.linalg.pinv(precision[np.ix_(free, free)] + np.diag(prior**-2.0))
    covariance[np.ix_(free, free)] = own_part
    still = np.eye(len(x))
    moves = move_world(cropped.turn, own, crops, cropped.ratios)
    still[len(own) :, len(own) :] -= moves @ np.linalg.pinv(moves)
    sd = np.sqrt(np.diag(still @ covariance @ still.T).clip(0))
    return sd[: len(own)], sd[len(own) :].reshape(len(agrees), -1)


def _weigh(cropped: Cropped, x: np.ndarray, agrees: np.ndarray, noise: float) -> np.ndarray:
    """The inverse of the parameters' covariance by the outlines alone: [parameters, parameters]."""
    part = cropped.select(np.arange(len(agrees)), 2)
    slopes = part.slopes(x, part.misses(x))
    slopes[~agrees] = 0
    data = slopes.reshape(-1, len(x))
    return INDEPENDENT / slopes.shape[1] / noise**2 * data.T @ data


def _find_open_way(cropped: Cropped, x: np.ndarray) -> np.ndarray:
    """How the parameters change with where the camera was aimed, which no outline shows.

    Returns:
        [parameters, 1], for a pixel
    """
    own, crops = cropped.split(x)
    ends = [
        aim(cropped.turn, own, crops, cropped.middles(), cropped.ratios, y) for y in (0.5, -0.5)
    ]
    up, down = (np.r_[own, crops.ravel()] for own, crops in ends)
    return (up - down)[:, None]


def _find_aim_slopes(cropped: Cropped, x: np.ndarray) -> np.ndarray:
    """How the place where the camera was aimed changes with the parameters: [1, parameters]."""
    own, crops = cropped.split(x)
    slopes = np.zeros(len(x))
    for i, nudge in enumerate(np.tile(NUDGE, len(crops))):
        step = nudge * np.eye(crops.size)[i].reshape(crops.shape)
        up, down = (
            find_aim(cropped.turn, own, crops + d, cropped.middles(), cropped.ratios)
            for d in (step, -step)
        )
        slopes[len(own) + i] = (up - down) / (2 * nudge)
    return slopes[None]
