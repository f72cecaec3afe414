"""Soft rasterisation in plain torch, on any device and in any floating dtype.

The equations are those of Soft Rasterizer (Liu et al., ICCV 2019). For a pixel centre p and a
triangle j let d_j be the Euclidean distance from p to the triangle's boundary, the nearest of its
three edges, in half-image units: pixels divided by half of the longer image side. Then

    D_j   = sigmoid(+- d_j^2 / sigma)       + inside the triangle, - outside
    alpha = 1 - prod_j (1 - D_j)

- A pixel outside j with d_j^2 > CUTOFF sigma (there D_j < 1e-4) gets nothing from j, as in SoftRas.
- Both orientations are drawn: orientation does not matter.
- A face with a point that is not finite in a view is left out of that view.
- A face whose smallest height is at most THIN sqrt(sigma) half-image units has no inside; its
  edges still have their outside. A face of no area is so drawn as the segment or point that it
  is, and of a merely thin one D changes by less than 3e-7, while which side of it a pixel lies on
  cannot hang on a rounding.

On an edge from a to b, c = a + s (b - a) is the point nearest to p, s in [0, 1], and

    d(d^2) / da = -2 (1 - s) (p - c)        d(d^2) / db = -2 s (p - c)

which autograd finds with s held fixed, since d^2 is stationary in s or s is at a bound. Edges of a
thin face may coincide; there the first in the order ab, ca, bc counts as the nearest unless another
is nearer by more than a rounding (TIE).

The image is worked through in tiles, each with the faces that reach it, so memory is bounded by
TILE^2 x FACES; the tiles are computed anew for the gradient.
"""

import math
from collections.abc import Callable, Iterator

import torch
from torch import Tensor
from torch.nn.functional import softplus
from torch.utils.checkpoint import checkpoint

CUTOFF = math.log(1e4 - 1)
THIN = 2e-3
TIE = 1 - 2**-15
TILE = 32  # pixels
FACES = 2048


def soft_silhouettes(points: Tensor, faces: Tensor, size: tuple[int, int], sigma: float) -> Tensor:
    """As ``silmesh.softras.soft_silhouettes``, without its checks, in plain torch."""
    half = max(size) / 2
    views = [_render_view(view[faces] / half, size, sigma) for view in points]
    return torch.stack(views) if views else points.new_zeros(0, *size)


def _render_view(triangles: Tensor, size: tuple[int, int], sigma: float) -> Tensor:
    """Alpha [height, width] of triangles [faces, 3, 2] in half-image units."""
    triangles = triangles[triangles.isfinite().all(dim=(1, 2))]
    radius = math.sqrt(CUTOFF * sigma)

    def render_tile(pixels: Tensor) -> Tensor:
        log_transmittance = pixels.new_zeros(pixels.shape[:2])
        near = triangles[reach(triangles.detach(), pixels, radius)]
        for chunk in near.split(FACES) if len(near) else ():
            log_transmittance = log_transmittance - checkpoint(
                _absorb, pixels, chunk, sigma, use_reentrant=False
            )
        return -torch.expm1(log_transmittance)

    return render_tiles(render_tile, size, triangles)


def render_tiles(render: Callable[[Tensor], Tensor], size: tuple[int, int], like: Tensor) -> Tensor:
    """Put an image together from its tiles.

    Args:
        render: from the pixel centres [rows, columns, 2] of a tile, in half-image units, to
            [..., rows, columns]
        size: height and width
        like: gives dtype and device of the pixels
    Returns:
        [..., height, width]
    """
    height, width = size
    ys = (torch.arange(height, dtype=like.dtype, device=like.device) + 0.5) / (max(size) / 2)
    xs = (torch.arange(width, dtype=like.dtype, device=like.device) + 0.5) / (max(size) / 2)
    bands = []
    for y in ys.split(TILE):
        grids = (torch.meshgrid(x, y, indexing="xy") for x in xs.split(TILE))
        bands.append(torch.cat([render(torch.stack(grid, dim=-1)) for grid in grids], dim=-1))
    return torch.cat(bands, dim=-2)


def reach(triangles: Tensor, pixels: Tensor, radius: float) -> Tensor:
    """Which triangles may come within a radius of a tile: bool [faces]."""
    margin = radius * 1.001
    low, high = triangles.amin(dim=1) - margin, triangles.amax(dim=1) + margin  # [faces, 2]
    return ((low <= pixels[-1, -1]) & (high >= pixels[0, 0])).all(dim=1)


def _absorb(pixels: Tensor, triangles: Tensor, sigma: float) -> Tensor:
    """Minus the logarithm of prod_j (1 - D_j): [rows, columns]."""
    distance2, inside = measure(pixels.unsqueeze(2), triangles, sigma)  # [rows, columns, faces]
    x = torch.where(inside, distance2, -distance2) / sigma
    return torch.where(x >= -CUTOFF, softplus(x), 0).sum(dim=-1)


def measure(pixels: Tensor, triangles: Tensor, sigma: float) -> tuple[Tensor, Tensor]:
    """Squared distance of pixels to the boundary of triangles, and whether they lie inside.

    Args:
        pixels: [..., 1, 2] in half-image units
        triangles: [faces, 3, 2] likewise
        sigma: squared half-image units; says which triangles are thin
    Returns:
        distance2 [..., faces], inside bool [..., faces]
    """
    distances, sides = [], []
    for a, edge in _edges(triangles):
        ap = pixels - a  # [..., faces, 2]
        length2 = (edge * edge).sum(dim=-1)
        s = (ap * edge).sum(dim=-1) / torch.where(length2 > 0, length2, 1)
        cp = ap - s.detach().clamp(0, 1).unsqueeze(-1) * edge
        distances.append((cp * cp).sum(dim=-1))
        sides.append(cross(edge, ap).detach())
    thick = is_thick(triangles.detach(), sigma)
    tie = torch.where(thick, 1.0, TIE).to(triangles)
    ab, bc, ca = distances
    others = torch.where(bc < ca * tie, bc, ca)
    distance2 = torch.where(others < ab * tie, others, ab)
    left = (sides[0] > 0) & (sides[1] > 0) & (sides[2] > 0)
    right = (sides[0] < 0) & (sides[1] < 0) & (sides[2] < 0)
    return distance2, (left | right) & thick


def is_thick(triangles: Tensor, sigma: float) -> Tensor:
    """Whether the smallest height, twice the area over the longest edge, is not thin: [faces]."""
    (_, ab), (_, bc), (_, ca) = _edges(triangles)
    longest = torch.stack([ab, bc, ca]).norm(dim=-1).amax(dim=0)
    return cross(ab, bc).abs() > THIN * math.sqrt(sigma) * longest


def _edges(triangles: Tensor) -> Iterator[tuple[Tensor, Tensor]]:
    """Start and direction, each [faces, 2], of the three edges."""
    for k in range(3):
        a = triangles[:, k]
        yield a, triangles[:, (k + 1) % 3] - a


def cross(a: Tensor, b: Tensor) -> Tensor:
    """The z of the cross product of plane vectors [..., 2]."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
