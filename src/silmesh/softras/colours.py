"""Colour pictures of meshes in plain torch: SoftRas's aggregation, or the nearest face.

For a pixel and a face j let b be the pixel's barycentric coordinates in j's projection, clipped
to [0, 1] and normalised when the pixel is outside. Depth z_j and colour C_j are interpolated with
perspective:

    1 / z_j = sum_k b_k / z_k        C_j = z_j sum_k b_k C_k / z_k

hard    the colour of the nearest face that the pixel is inside of; alpha is 0 or 1
soft    SoftRas (Liu et al., ICCV 2019): with n_j the inverse depth, 0 at the farthest vertex of
        the view and 1 at the nearest, and D_j and alpha as in ``silmesh.softras.reference``,

            C = (sum_j D_j exp(n_j / gamma) C_j + exp(EPSILON / gamma) C_background)
                / (sum_j D_j exp(n_j / gamma) + exp(EPSILON / gamma))

Thin faces (see ``silmesh.softras.reference``) have no inside and are left out here.
"""

import math
from functools import partial

import torch
from torch import Tensor

from silmesh.softras.reference import CUTOFF, cross, is_thick, measure, reach, render_tiles

EPSILON = 1e-3  # SoftRas's: the normalised inverse depth of the background


def render_colours(
    points: Tensor,
    depths: Tensor,
    faces: Tensor,
    colours: Tensor,
    size: tuple[int, int],
    *,
    sigma: float = 1e-4,
    gamma: float | None = None,
    background: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> Tensor:
    """Render colour pictures of a mesh.

    Args:
        points: [views, verts, 2] pixels, as for ``soft_silhouettes``
        depths: [views, verts] along each camera's axis; faces with a depth that is not positive
            or with a point that is not finite are left out of the view
        faces: [faces, 3] int64
        colours: [faces, 3, 3], red, green and blue of each face's corners: ``colours[faces]`` for
            colours of the vertices, ``colours[:, None].expand(-1, 3, -1)`` for those of the faces
        size: height and width in pixels
        sigma: softness of the edges, in squared half-image units (soft)
        gamma: softness of the order in depth; None for hard
        background: red, green and blue where there is no face
    Returns:
        [views, 4, height, width]: red, green, blue (the background mixed in) and alpha
    """
    half = max(size) / 2
    shade = _shade_hard if gamma is None else partial(_shade_soft, gamma=gamma)
    radius = 0.0 if gamma is None else math.sqrt(CUTOFF * sigma)
    behind = colours.new_tensor(background)
    pictures = []
    for view, z in zip(points, depths, strict=True):
        corners = torch.cat([view[faces] / half, z[faces].unsqueeze(-1)], dim=-1)  # [faces, 3, 3]
        keep = corners.isfinite().all(dim=(1, 2)) & (corners[..., 2] > 0).all(dim=1)
        keep &= is_thick(corners[..., :2], sigma)
        picture = _render_view(corners[keep], colours[keep], size, sigma, radius, shade, behind)
        pictures.append(picture)
    return torch.stack(pictures)


def _render_view(corners, colours, size, sigma, radius, shade, behind) -> Tensor:
    """[4, height, width] of the faces with corners [faces, 3, (x, y, z)]."""
    triangles, inverse = corners[..., :2], 1 / corners[..., 2]
    bounds = (inverse.min(), inverse.max()) if len(inverse) else (0, 1)

    def render_tile(pixels: Tensor) -> Tensor:
        near = reach(triangles, pixels, radius)
        if not near.any():
            clear = behind.new_zeros(1)
            return torch.cat([behind, clear])[:, None, None].expand(4, *pixels.shape[:2])
        pixels = pixels.unsqueeze(2)  # [rows, columns, 1, 2]
        distance2, inside = measure(pixels, triangles[near], sigma)
        b = _interpolate(pixels, triangles[near]) * inverse[near]  # [rows, columns, faces, 3]
        nearness = b.sum(dim=-1)  # 1 / z
        b = b / nearness.unsqueeze(-1)
        nearness = (nearness - bounds[0]) / (bounds[1] - bounds[0]).clamp(min=1e-12)
        x = torch.where(inside, distance2, -distance2) / sigma
        return shade(x, nearness, b, colours[near], behind).movedim(-1, 0)

    return render_tiles(render_tile, size, triangles)


def _interpolate(pixels: Tensor, triangles: Tensor) -> Tensor:
    """Barycentric coordinates of pixels, clipped to the triangle: [rows, columns, faces, 3]."""
    a, b, c = triangles.unbind(dim=1)  # [faces, 2]
    areas = [cross(c - b, pixels - b), cross(a - c, pixels - c), cross(b - a, pixels - a)]
    shares = torch.stack(areas, dim=-1) / cross(b - a, c - a).unsqueeze(-1)
    shares = shares.clamp(0, 1)
    return shares / shares.sum(dim=-1, keepdim=True)


def _shade_hard(x, nearness, b, colours, behind) -> Tensor:
    """The nearest face's colour where the pixel is inside one: [rows, columns, 4]."""
    nearness = torch.where(x > 0, nearness, -math.inf)
    best, face = nearness.max(dim=-1, keepdim=True)  # [rows, columns, 1]
    b = b.take_along_dim(face.unsqueeze(-1), dim=2).squeeze(2)  # [rows, columns, 3]
    colour = (b.unsqueeze(-1) * colours[face.squeeze(-1)]).sum(dim=-2)
    covered = best > -math.inf
    return torch.cat([torch.where(covered, colour, behind), covered.to(colour)], dim=-1)


def _shade_soft(x, nearness, b, colours, behind, *, gamma) -> Tensor:
    """SoftRas's mixture of the faces within the cutoff and the background: [rows, columns, 4]."""
    D = torch.where(x >= -CUTOFF, torch.sigmoid(x), 0)
    nearness = torch.where(D > 0, nearness, 0)
    highest = nearness.amax(dim=-1, keepdim=True).clamp(min=EPSILON)  # keeps exp within range
    weights = D * torch.exp((nearness - highest) / gamma)  # [rows, columns, faces]
    rest = torch.exp((EPSILON - highest) / gamma)
    mixed = torch.einsum("yxf,yxfk,fkc->yxc", weights, b, colours) + rest * behind
    colour = mixed / (weights.sum(dim=-1, keepdim=True) + rest)
    alpha = 1 - (1 - D).prod(dim=-1, keepdim=True)
    return torch.cat([colour, alpha], dim=-1)
