"""How well a texture shows photographs that it was not made from, inside the object.

Compared are the pixels that the silhouette and the mesh both cover: what else the outline misses is
what the IoU says.

    PSNR = 10 log10 (255^2 / mean squared error of the three channels)

SSIM is that of Wang, Bovik, Sheikh and Simoncelli (2004), of grey levels, its map's mean over the
same pixels. Both are means over the views.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from skimage.metrics import structural_similarity

from silmesh.geometry.originals import Originals
from silmesh.texture.rendering import Textured, render

LONGEST = 1000  # pixels of the longer side at which photographs are compared
GREY = np.array([0.2126, 0.7152, 0.0722])  # of sRGB's primaries (ITU-R BT.709)


def measure_appearance(
    texture: Textured, originals: Originals, silhouettes: np.ndarray, views: Sequence[int]
) -> dict[str, Any]:
    """Compare a texture with photographs.

    Args:
        texture: in the cameras' world
        originals: all photographs, at the size at which they are compared
        silhouettes: [views, size, size] bool, of the working images
        views: positions of those that are compared
    Returns:
        ``psnr`` in dB and ``ssim``, None if there is nothing to compare; ``views`` that were

    Raises:
        InputError: a photograph can no longer be read
    """
    found = {}
    for i in views:
        ((image, covered),) = render(texture, originals.cameras.select([i]))
        inside = covered & originals.enlarge(i, silhouettes[i])
        if inside.any():
            found[originals.cameras.views[i]] = compare(image, originals.read(i), inside)
    psnr, ssim = np.array(list(found.values())).reshape(-1, 2).T
    return {
        "psnr": float(psnr.mean()) if found else None,
        "ssim": float(ssim.mean()) if found else None,
        "views": {view: round(psnr, 2) for view, (psnr, _) in found.items()},
    }


def compare(image: np.ndarray, photograph: np.ndarray, inside: np.ndarray) -> tuple[float, float]:
    """PSNR in dB, and SSIM, of an image within a mask.

    Args:
        image, photograph: [height, width, 3] uint8, sRGB
        inside: [height, width] bool, not empty
    """
    rows, columns = (slice(at.min(), at.max() + 1) for at in np.nonzero(inside))
    near, inside = photograph[rows, columns], inside[rows, columns]
    shown = np.where(inside[..., None], image[rows, columns], near)  # equal beside the mask
    error = np.mean((shown[inside].astype(float) - near[inside]) ** 2)
    psnr = float(10 * np.log10(255**2 / max(error, 1e-10)))
    least = min(inside.shape)
    window = min(7, least - (least % 2 == 0))
    if window < 3:
        return psnr, float(error == 0)
    _, similar = structural_similarity(
        shown @ GREY, near @ GREY, win_size=window, data_range=255, full=True
    )
    return psnr, float(similar[inside].mean())
