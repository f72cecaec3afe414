"""Soft silhouettes of many views, to look at or to measure: a few at once, without gradients."""

from collections.abc import Iterator

import torch
from torch import Tensor

from silmesh.softras import soft_silhouettes

AT_ONCE = 16  # views
PIXELS = AT_ONCE * 512**2  # and fewer, where these have more pixels


def render_views(
    points: Tensor, faces: Tensor, size: tuple[int, int], sigma: float
) -> Iterator[Tensor]:
    """The alpha [height, width] of each view, one after another; see ``soft_silhouettes``.

    Args:
        points: [views, verts, 2] pixels
        faces: [faces, 3] int64
        size: height and width
        sigma: in squared half-image units
    """
    for part in points.detach().split(max(1, min(AT_ONCE, PIXELS // (size[0] * size[1])))):
        with torch.no_grad():
            rendered = soft_silhouettes(part, faces, size, sigma=sigma)
        yield from rendered
