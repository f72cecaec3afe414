"""Meshes drawn in colours by the nearest face, in plain torch: what others are compared with.

For a pixel and a face j let b be the pixel's barycentric coordinates in j's projection. Depth z_j
and colour C_j are interpolated with perspective:

    1 / z_j = sum_k b_k / z_k        C_j = z_j sum_k b_k C_k / z_k

A pixel has the colour of the nearest face that it is inside of. Thin faces (see
``silmesh.softras.reference``) have no inside and are left out.
"""

import math
from collections.abc import Callable

import torch
from torch import Tensor

from silmesh.softras.reference import cross, is_thick, measure

SIGMA = 1e-4  # says which faces are thin
TILE = 8  # pixels, of a picture that is computed tile by tile


def render_colours(
    points: Tensor,
    depths: Tensor,
    faces: Tensor,
    colours: Tensor,
    size: tuple[int, int],
    background: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> Tensor:
    """Draw a mesh in colours.

    Args:
        points: [views, verts, 2] pixels, as for ``soft_silhouettes``
        depths: [views, verts] along each camera's axis; faces with a depth that is not positive
            or with a point that is not finite are left out of the view
        faces: [faces, 3] int64
        colours: [faces, 3, 3], red, green and blue of each face's corners: ``colours[faces]`` for
            colours of the vertices, ``colours[:, None].expand(-1, 3, -1)`` for those of the faces
        size: height and width in pixels
        background: red, green and blue where there is no face
    Returns:
        [views, 4, height, width]: red, green, blue and alpha, which is 0 or 1
    """
    half = max(size) / 2
    behind = colours.new_tensor(background)
    pictures = []
    for view, z in zip(points, depths, strict=True):
        corners = torch.cat([view[faces] / half, z[faces].unsqueeze(-1)], dim=-1)  # [faces, 3, 3]
        keep = corners.isfinite().all(dim=(1, 2)) & (corners[..., 2] > 0).all(dim=1)
        keep &= is_thick(corners[..., :2], SIGMA)
        pictures.append(_render_view(corners[keep], colours[keep], size, behind))
    return torch.stack(pictures)


def _render_view(corners, colours, size, behind) -> Tensor:
    """[4, height, width] of the faces with corners [faces, 3, (x, y, z)]."""
    triangles, inverse = corners[..., :2], 1 / corners[..., 2]

    def render_tile(pixels: Tensor) -> Tensor:
        near = _reach(triangles, pixels)
        if not near.any():
            clear = behind.new_zeros(1)
            return torch.cat([behind, clear])[:, None, None].expand(4, *pixels.shape[:2])
        pixels = pixels.unsqueeze(2)  # [rows, columns, 1, 2]
        _, inside = measure(pixels, triangles[near], SIGMA)
        b = _interpolate(pixels, triangles[near]) * inverse[near]  # [rows, columns, faces, 3]
        nearness = b.sum(dim=-1)  # 1 / z
        b = b / nearness.unsqueeze(-1)
        return _shade(inside, nearness, b, colours[near], behind).movedim(-1, 0)

    return render_tiles(render_tile, size, triangles)


def _interpolate(pixels: Tensor, triangles: Tensor) -> Tensor:
    """Barycentric coordinates of pixels, clipped to the triangle: [rows, columns, faces, 3]."""
    a, b, c = triangles.unbind(dim=1)  # [faces, 2]
    areas = [cross(c - b, pixels - b), cross(a - c, pixels - c), cross(b - a, pixels - a)]
    shares = torch.stack(areas, dim=-1) / cross(b - a, c - a).unsqueeze(-1)
    shares = shares.clamp(0, 1)
    return shares / shares.sum(dim=-1, keepdim=True)


def _shade(inside, nearness, b, colours, behind) -> Tensor:
    """The nearest face's colour where the pixel is inside one: [rows, columns, 4]."""
    nearness = torch.where(inside, nearness, -math.inf)
    best, face = nearness.max(dim=-1, keepdim=True)  # [rows, columns, 1]
    b = b.take_along_dim(face.unsqueeze(-1), dim=2).squeeze(2)  # [rows, columns, 3]
    colour = (b.unsqueeze(-1) * colours[face.squeeze(-1)]).sum(dim=-2)
    covered = best > -math.inf
    return torch.cat([torch.where(covered, colour, behind), covered.to(colour)], dim=-1)


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


def _reach(triangles: Tensor, pixels: Tensor) -> Tensor:
    """Which triangles may cover pixels of a tile: bool [faces]."""
    low, high = triangles.amin(dim=1), triangles.amax(dim=1)  # [faces, 2]
    return ((low <= pixels[-1, -1]) & (high >= pixels[0, 0])).all(dim=1)
