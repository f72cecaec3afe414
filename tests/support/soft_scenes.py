"""Faces as points in images: what the kernels are compared on with the plain renderer."""

import math

import numpy as np
import torch
from drawing import render_tiles
from scipy.spatial import ConvexHull

from silmesh.softras import reference
from silmesh.softras.reference import CUTOFF


def make_sphere(count, size, distance=2.732, angle=15.0):
    """Points [1, count, 2] and faces of a sphere of radius 0.5 in the middle of the image."""
    i = np.arange(count) + 0.5
    polar, turn = np.arccos(1 - 2 * i / count), math.pi * (1 + math.sqrt(5)) * i
    verts = np.stack(
        [np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1
    )
    faces = torch.tensor(ConvexHull(verts).simplices, dtype=torch.int64)
    verts = 0.5 * torch.tensor(verts, dtype=torch.float32)
    focal = max(size) / 2 / math.tan(math.radians(angle))
    middle = torch.tensor([size[1] / 2, size[0] / 2])
    return (focal * verts[:, :2] / (verts[:, 2:] + distance) + middle)[None], faces


def make_soup(size, huge, seed=0):
    """Huge, middling, tiny, off-screen and collapsed faces, and some that are not finite."""
    generator = torch.Generator().manual_seed(seed)
    centres = torch.rand(2, 120, 1, 2, generator=generator) * max(size) * 1.4 - max(size) * 0.2
    extents = 10 ** (torch.rand(1, 120, 1, 1, generator=generator) * 3.5 - 2)  # 0.01 to 30 pixels
    shapes = torch.rand(2, 120, 3, 2, generator=generator) - 0.5
    extents[:, 25:29] = 3.0 * max(
        size
    )  # with a corner near the image, so that they do not cover it
    shapes[:, 25:29] -= shapes[:, 25:29, :1].clone()
    corners = centres + extents * shapes
    corners[:, 0:10, 2] = corners[:, 0:10, 1]
    corners[:, 10:15] = corners[:, 10:15, :1]
    corners[:, 15:20, 2] = (corners[:, 15:20, 0] + corners[:, 15:20, 1]) / 2
    corners[0, 20:23, 1, 0] = math.nan
    corners[1, 22:25, 0, 1] = -math.inf
    return corners.reshape(2, 360, 2), torch.arange(360).reshape(120, 3)


SCENES = {
    "sphere": lambda: (*make_sphere(200, (64, 64)), (64, 64), 1e-4),
    "soft sphere": lambda: (*make_sphere(100, (40, 64)), (40, 64), 1e-2),
    "soup": lambda: (*make_soup((120, 90), 1000.0), (120, 90), 1e-4),
    "sharp soup": lambda: (*make_soup((61, 83), 80.0, seed=1), (61, 83), 1e-5),
    "large image": lambda: (*make_soup((60, 1024), 3000.0, seed=2), (60, 1024), 1e-5),
}


def find_outlier_views(points, faces, size, sigma):
    """Pixels whose distance to a face lies within rounding of the cutoff: [views, h, w]."""
    radius2 = CUTOFF * sigma
    doubtful = []
    for view in points.double():
        triangles = view[faces] / (max(size) / 2)
        triangles = triangles[triangles.isfinite().all(dim=(1, 2))]

        def near_cutoff(pixels, triangles=triangles):
            distance2, inside = reference.measure(pixels.unsqueeze(2), triangles, sigma)
            return (((distance2 / radius2 - 1).abs() < 1e-4) & ~inside).any(dim=-1)

        doubtful.append(render_tiles(near_cutoff, size, triangles))
    return torch.stack(doubtful)


def check_gradient(gradient: torch.Tensor, true: torch.Tensor) -> None:
    """Fail if a kernel's gradient is farther from the reference's than float32 explains."""
    error = (gradient - true).abs()
    assert (error <= 1e-4 * true.abs() + 5e-5 * true.abs().max()).all()
    assert error.norm() < 1e-4 * true.norm()
