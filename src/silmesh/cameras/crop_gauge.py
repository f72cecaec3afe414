"""What views that were cropped one by one leave open, and where the camera is taken to look.

A crop hides where the photograph's middle was. So the principal point may lie anywhere along the
image of the turntable's axis: with a the focal length over cos(elevation), all cameras whose
principal point is a sin(elevation) beside the horizon of the table see the same outlines, of
objects that a projective map along the axis takes into each other (Jiang, Tsui and Quan, *Circular
motion geometry using minimal data*, 2004, have what a turn about one axis leaves open). The line of
sight to the object hardly changes. It is therefore taken that the camera was aimed at the object.

Nothing shows either where the object stands in the world, nor how large it is.
"""

import math

import numpy as np

from silmesh.cameras.frontier import SCALE, to_maps
from silmesh.cameras.turntable_residuals import ELEVATION, ROLL, VIEW, Turntable

STEEPEST = 0.96  # most sine of an elevation, against cameras that look straight down


def aim(
    turn: Turntable,
    own: np.ndarray,
    crops: np.ndarray,
    middles: np.ndarray,
    ratios: np.ndarray,
    lower: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """The same views by a camera that looks at the object: the turntable's parameters, and crops.

    Args:
        turn: whose camera looks at the axis
        own: its parameters
        crops: [views, 3]
        middles: [views, 2] of the outlines' boxes, in pixels; NaN where the frame cuts the object
        ratios: [views, 2] known scales of the working images
        lower: pixels before the crops by which the object is seen below the image's middle
    """
    along = _look_along(own)
    below = find_aim(turn, own, crops, middles, ratios) - lower
    half, elevation = turn.size / 2, math.radians(own[ELEVATION])
    reach = half / math.exp(own[VIEW]) / math.cos(elevation)
    sine = np.clip(math.sin(elevation) + below / reach, -STEEPEST, STEEPEST)
    below = (sine - math.sin(elevation)) * reach
    own, crops = own.copy(), crops.copy()
    own[ELEVATION] = math.degrees(math.asin(sine))
    own[VIEW] = math.log(half / reach / math.sqrt(1 - sine**2))
    crops[:, :SCALE] += to_maps(crops, ratios)[:, 0] * below * along * [1, turn.aspect]
    return own, crops


def find_aim(
    turn: Turntable, own: np.ndarray, crops: np.ndarray, middles: np.ndarray, ratios: np.ndarray
) -> float:
    """By how many pixels before the crops the object is seen below the image's middle."""
    scale, shift = to_maps(crops, ratios).swapaxes(0, 1)
    seen = (middles - shift) / scale - turn.size / 2
    return float(np.nanmean(seen / [1, turn.aspect], axis=0) @ _look_along(own))


def move_world(
    turn: Turntable, own: np.ndarray, crops: np.ndarray, ratios: np.ndarray
) -> np.ndarray:
    """How crops change with the object's place and size in the world: [views * 3, 4]."""
    K, R, t = turn.camera(own)
    scale = to_maps(crops, ratios)[:, 0]
    moves = np.zeros((*crops.shape, 4))
    moves[:, :SCALE, :3] = scale[:, :, None] * R[:, :2] * np.diag(K)[:2, None] / t[:, 2, None, None]
    moves[:, SCALE, :3] = -R[:, 2] / t[:, 2, None]
    moves[:, SCALE, 3] = 1
    return moves.reshape(-1, 4)


def _look_along(own: np.ndarray) -> np.ndarray:
    """The direction of the axis in the image, downwards: [2]."""
    roll = math.radians(own[ROLL])
    return np.array([-math.sin(roll), math.cos(roll)])
