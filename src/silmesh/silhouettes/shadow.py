"""The shadow that an object casts on a plain ground: of the ground's colour, darker, and soft.

A shadow scales the ground's colour and leaves its chromaticity, so a pixel is told by the ratio of
its channels to the ground's: brightness distortion and colour distortion in Horprasert, Harwood and
Davis 1999, *A statistical approach for real-time robust background subtraction and shadow
detection*. A grey object on grey paper scales it as well. What tells that apart is the outline: an
object's is a step, a contact shadow's a slope, wider than the window that it is looked at through.
"""

import numpy as np
from scipy import ndimage

DARK = 60  # grey levels of the ground; on a darker one no shadow stands out
LEAST = 0.35  # of the ground's brightness: a contact shadow is no darker
COLOUR = (0.015, 0.03)  # by which the ratios of channels differ: noise, and a part of the ratio
STEP = 4.5  # pixels over which a step rises at most, as the filters below see it
FLAT = 0.012  # of the ground's brightness a pixel: no slope to be judged
WINDOW = 9  # pixels: how far around a pixel its slope is compared to what it rises in all
GAP = 3  # pixels: so near a step nothing passes, through an outline with gaps of twice that
HARD = 0.2  # of a shadow's edge to the ground that may be near a step, as beside the object
ABOVE = 0.1  # of a shadow that may lie higher than the middle of what casts it
REST = 0.25  # of the silhouette: an object that less is left of is not told from its shadow
SHARE = 0.01  # of the silhouette: a shadow of less is none


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
