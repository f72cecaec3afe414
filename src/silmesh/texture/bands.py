"""A photograph in two bands: colours that change slowly, and the detail that is left.

The slow band is a Gaussian mean of the pixels within the silhouette, so that no background enters
it. Blending the slow bands of all views and taking the detail of one gives neither seams nor
ghosts (Burt and Adelson 1983; for textures Baumberg 2002).
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

COARSE = 320  # pixels of the slow band's longer side, at most
WIDTH = 2.0  # of its Gaussian, in its own pixels


@dataclass(frozen=True)
class Slow:
    """The slow band of a photograph.

    Attributes:
        image: [height, width, 3] float32
        step: [2] pixels of the photograph a pixel of it, across and down
    """

    image: np.ndarray
    step: np.ndarray


def take_slow(photograph: np.ndarray, silhouette: np.ndarray, scale: np.ndarray) -> Slow:
    """The slow band of a photograph [height, width, 3] within a silhouette [height, width].

    Args:
        scale: [2] pixels of the photograph at its own size a pixel of this one, across and down
    """
    step = max(1, -(-max(silhouette.shape) // COARSE))
    count = average_blocks(silhouette.astype(np.float32), step)
    masked = np.where(silhouette[..., None], photograph, np.uint8(0))
    total = np.stack([average_blocks(masked[..., i], step) for i in range(3)], axis=-1)
    weight = gaussian_filter(count, WIDTH)
    image = gaussian_filter(total, (WIDTH, WIDTH, 0)) / np.maximum(weight, 1e-4)[..., None]
    return Slow(image.astype(np.float32), scale * step)


def average_blocks(image: np.ndarray, step: int) -> np.ndarray:
    """The means of blocks of step x step, an image's edge repeated: [rows, columns] float32."""
    height, width = image.shape
    padded = np.pad(image, [(0, -height % step), (0, -width % step)], mode="edge")
    rows = padded.reshape(-1, step, padded.shape[1]).sum(axis=1, dtype=np.float32)
    return rows.reshape(len(rows), -1, step).sum(axis=2) / np.float32(step**2)
