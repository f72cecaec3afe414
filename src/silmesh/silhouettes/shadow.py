"""The shadow that an object casts on a plain ground: of the ground's colour, darker, and soft.

A shadow scales the ground's colour and leaves its chromaticity, so a pixel is told by the ratio of
its channels to the ground's: brightness distortion and colour distortion in Horprasert, Harwood and
Davis 1999, *A statistical approach for real-time robust background subtraction and shadow
detection*. A grey object on grey paper scales it as well. What tells that apart is the outline: an
object's is a step, a contact shadow's a slope, wider than the window that it is looked at through.
"""

import numpy as np
from scipy import ndimage

DARK = 60  # grey levels: on a darker ground no shadow is looked for
LEAST = 0.35  # least brightness of a contact shadow over that of the ground
# The ratios of the three channels to the ground's may differ by COLOUR[0], for noise, and COLOUR[1]
# times their mean.
COLOUR = (0.015, 0.03)
STEP = 4.5  # pixels: a rise in brightness over no more than this is a step
FLAT = 0.012  # of the ground's brightness a pixel: smaller slopes are no step
WINDOW = 9  # pixels: side of the window in which the whole rise is measured
GAP = 3  # pixels: steps block this much around them, which closes gaps of twice that in outlines
HARD = 0.2  # greatest share of a shadow's edge to the ground that is a step, as beside the object
ABOVE = 0.1  # greatest share of a shadow above the middle of what casts it
REST = 0.25  # least share of the silhouette that must remain without its shadow
SHARE = 0.01  # of the silhouette: a smaller shadow is ignored


def may_have_shadow(pixels: np.ndarray, ground: np.ndarray, silhouette: np.ndarray) -> bool:
    """Whether enough of a silhouette has the ground's colour, only darker; as ``find_shadow``."""
    if not (ground.mean(axis=-1) > DARK).any():
        return False
    alike, _ = _darken(pixels, ground)
    return bool((alike & silhouette).sum() > SHARE * silhouette.sum())


def find_shadow(pixels: np.ndarray, ground: np.ndarray, silhouette: np.ndarray) -> np.ndarray:
    """The part of a silhouette that is a shadow on the ground: [height, width] bool.

    It is reached from the ground without a step and without another colour, and each piece of it
    goes over into the ground without steps and lies lower in the photograph than the middle of the
    rest. Nothing where the rest would be too little.

    Args:
        pixels: [height, width, 3] uint8
        ground: [height, width, 3], the background's colour at each pixel
        silhouette: [height, width] bool, of the object with its shadow
    """
    nothing = np.zeros_like(silhouette)
    alike, ratio = _darken(pixels, ground)
    outside, steps = ~silhouette, _steps(ratio)
    open_ = outside | (alike & ~steps)
    walls = ndimage.binary_dilation(~open_, iterations=GAP)
    reached = ndimage.binary_propagation(outside & ~walls, mask=outside | ~walls)
    reached = ndimage.binary_dilation(reached, iterations=GAP + 1, mask=open_)
    found = ndimage.binary_closing(reached | outside, iterations=1) & silhouette & alike
    pieces, count = ndimage.label(found, np.ones((3, 3)))
    for i in range(1, count + 1):
        piece = pieces == i
        found[piece] = _is_soft(piece, outside, steps) and _lies_below(piece, silhouette & ~piece)
    rest = silhouette & ~found
    small = found.sum() <= SHARE * silhouette.sum() or rest.sum() < REST * silhouette.sum()
    return nothing if small else found


def _darken(pixels: np.ndarray, ground: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where pixels have the ground's colour but darker, and by which factor: [height, width]."""
    factors = np.stack(
        [
            ndimage.gaussian_filter(pixels[..., c].astype(np.float32), 0.7)
            / np.maximum(ground[..., c], 1)
            for c in range(3)
        ]
    )
    ratio = factors.mean(axis=0)
    off = np.abs(factors - ratio).max(axis=0)
    lit = ground.mean(axis=-1) > DARK
    return lit & (ratio > LEAST) & (ratio < 1) & (off < COLOUR[0] + COLOUR[1] * ratio), ratio


def _steps(ratio: np.ndarray) -> np.ndarray:
    """Where the brightness rises in a step: [height, width] bool."""
    slope = ndimage.gaussian_gradient_magnitude(ratio, 1)
    smooth = ndimage.gaussian_filter(ratio, 1)
    rise = ndimage.maximum_filter(smooth, WINDOW) - ndimage.minimum_filter(smooth, WINDOW)
    return (slope > FLAT) & (rise < STEP * slope)


def _is_soft(shadow: np.ndarray, outside: np.ndarray, steps: np.ndarray) -> bool:
    """Whether a shadow goes over into the ground outside without steps, nearly all around."""
    edge = shadow & ndimage.binary_dilation(outside, iterations=2)
    hard = edge & ndimage.binary_dilation(steps, iterations=2)
    return bool(hard.sum() <= HARD * edge.sum())


def _lies_below(shadow: np.ndarray, rest: np.ndarray) -> bool:
    """Whether nearly all of a shadow lies lower in the photograph than the middle of the rest."""
    rows = np.nonzero(shadow)[0]
    return rest.any() and bool(np.percentile(rows, 100 * ABOVE) > np.median(np.nonzero(rest)[0]))
