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

All views are worked through together: each face is paired with every bin of BIN x BIN pixels that
it may reach, and PAIRS pairs are computed at a time, and anew for the gradient. So memory is that
of PAIRS x BIN^2 numbers and the images, and a GPU has much to do at once. On a GPU what the faces
of a bin take away is summed in no fixed order, unless torch is told to be deterministic.
"""

import math
from collections.abc import Iterator

import torch
from torch import Tensor
from torch.nn.functional import softplus
from torch.utils.checkpoint import checkpoint

CUTOFF = math.log(1e4 - 1)
THIN = 2e-3
TIE = 1 - 2**-15
BIN = 8  # pixels
PAIRS = 2**14


def soft_silhouettes(points: Tensor, faces: Tensor, size: tuple[int, int], sigma: float) -> Tensor:
    """As ``silmesh.softras.soft_silhouettes``, without its checks, in plain torch."""
    triangles = (points[:, faces] / (max(size) / 2)).flatten(0, 1)  # [views * faces, 3, 2]
    rows, columns = (-(-side // BIN) for side in size)
    low, counts = _find_bins(triangles.detach(), size, math.sqrt(CUTOFF * sigma))
    log_transmittance = points.new_zeros(len(points) * rows * columns, BIN * BIN)
    for part in _chunk(counts.prod(dim=1)):
        face, bin_ = _pair(part, low, counts)  # [pairs], [pairs, 2]
        absorbed = checkpoint(
            _absorb, triangles, face, bin_, max(size) / 2, sigma, use_reentrant=False
        )
        view = face // max(len(faces), 1)
        into = (view * rows + bin_[:, 1]) * columns + bin_[:, 0]
        log_transmittance.index_add_(0, into, absorbed, alpha=-1)
    image = log_transmittance.reshape(-1, rows, columns, BIN, BIN).transpose(2, 3)
    image = image.reshape(-1, rows * BIN, columns * BIN)[:, : size[0], : size[1]]
    return -torch.expm1(image)


def _find_bins(triangles: Tensor, size: tuple[int, int], radius: float) -> tuple[Tensor, Tensor]:
    """First column and row of the bins that each triangle may reach, and their number: [faces, 2].

    A triangle with a corner that is not finite reaches none.
    """
    scale = max(size) / 2 / BIN  # bins in a half-image unit
    last = torch.tensor([size[1] - 1, size[0] - 1], device=triangles.device) // BIN
    low = (triangles.amin(dim=1) - 1.001 * radius) * scale
    high = (triangles.amax(dim=1) + 1.001 * radius) * scale
    finite = triangles.isfinite().all(dim=2).all(dim=1, keepdim=True)
    low = torch.where(finite, low, 0).floor().clamp(min=0).minimum(last + 1)
    high = torch.where(finite, high, -1).floor().clamp(min=-1).minimum(last)
    return low.long(), (high - low + 1).clamp(min=0).long()


def _chunk(counts: Tensor) -> Iterator[Tensor]:
    """Faces [faces] that have bins, in order, so many at a time that they have about PAIRS bins."""
    some = counts.nonzero().squeeze(1)
    ends = counts[some].cumsum(dim=0) // PAIRS
    sizes = ends.unique_consecutive(return_counts=True)[1].tolist()
    yield from some.split(sizes) if sizes else ()


def _pair(part: Tensor, low: Tensor, counts: Tensor) -> tuple[Tensor, Tensor]:
    """Each face of a part with each of its bins: faces [pairs], columns and rows [pairs, 2]."""
    number = counts[part].prod(dim=1)
    face = part.repeat_interleave(number)
    first = (number.cumsum(dim=0) - number).repeat_interleave(number)
    k = torch.arange(len(face), device=face.device) - first  # which of its face's bins
    across = counts[face, 0]
    return face, low[face] + torch.stack([k % across, k // across], dim=1)


def _absorb(triangles: Tensor, face: Tensor, bin_: Tensor, half: float, sigma: float) -> Tensor:
    """Minus log (1 - D) of each pair in the bin's pixels: [pairs, BIN^2]."""
    along = torch.arange(BIN, device=face.device)
    within = torch.stack(torch.meshgrid(along, along, indexing="xy"), dim=-1).reshape(-1, 1, 2)
    pixels = ((bin_ * BIN + within).to(triangles) + 0.5) / half  # [BIN^2, pairs, 2]
    distance2, inside = measure(pixels, triangles[face], sigma)
    x = torch.where(inside, distance2, -distance2) / sigma
    return torch.where(x >= -CUTOFF, softplus(x), 0).T


def measure(pixels: Tensor, triangles: Tensor, sigma: float) -> tuple[Tensor, Tensor]:
    """Squared distance of pixels to the boundary of triangles, and whether they lie inside.

    Args:
        pixels: [..., faces or 1, 2] in half-image units
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
