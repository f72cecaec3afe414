"""What surrounds an object in made-up photographs: a textured turntable, a still textured wall.

On the textured turntable everything that shows turns with the object, which is what structure from
motion wants. Before a still wall most of what shows does not turn, which is its classic trap.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from silmesh.geometry.camera import OBJECT_RADIUS, Cameras
from silmesh.softras import soft_silhouettes
from silmesh.synthetic.paints import Array, speckle
from silmesh.synthetic.photograph import Paint, photograph

Picture = tuple[NDArray[np.uint8], NDArray[np.bool_]]
SAMPLES = 600_000  # of a texture, spread over the surface
TABLE_RADIUS, TABLE_DEPTH = 0.75, 0.02  # in world units, in which the object has about size 1
GRAINS = (0.08, 0.035, 0.018)  # lengths over which a pattern changes, in world units


def stand_upright(scan: trimesh.Trimesh, up: int = 1) -> trimesh.Trimesh:
    """A copy that fits the sphere of radius 0.5 about the origin, its axis ``up`` turned to y."""
    mesh = scan.copy()
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    mesh.apply_scale(OBJECT_RADIUS / np.linalg.norm(mesh.vertices, axis=1).max())
    order = np.roll([0, 1, 2], 1 - up)  # a cyclic change of the axes is a rotation
    mesh.apply_transform(np.eye(4)[[*order, 3]])
    return mesh


def texture_paint(mesh: trimesh.Trimesh) -> Paint:
    """A paint with the colours of a mesh's texture: that of the nearest of many points."""
    points, faces = trimesh.sample.sample_surface(mesh, SAMPLES, seed=0)
    corners = mesh.triangles[faces]
    weights = trimesh.triangles.points_to_barycentric(corners, points)
    uv = np.einsum("nc,ncd->nd", weights, mesh.visual.uv[mesh.faces[faces]])
    colours = np.asarray(mesh.visual.material.to_color(uv))[:, :3].astype(np.float32) / 255
    near = cKDTree(points)

    def paint(at: Array) -> Array:
        skin = colours[near.query(at)[1]]
        return np.column_stack([skin, np.full(len(skin), 0.1, np.float32)])

    return paint


def pattern(points: Array, seed: int = 0) -> Array:
    """A random pattern with detail at several lengths, as of printed paper: [n, 3] in 0..1."""
    values = [
        sum(speckle(points, grain, seed + 7 * channel + i) for i, grain in enumerate(GRAINS))
        for channel in range(3)
    ]
    common = sum(values) / 3
    return np.clip(0.5 + 0.35 * common[:, None] + 0.12 * np.stack(values, axis=1), 0.02, 0.98)


def photograph_on_table(
    mesh: trimesh.Trimesh, cameras: Cameras, paint: Paint, seed: int = 0
) -> Iterator[Picture]:
    """Photograph an object on a round patterned table that turns with it.

    Returns:
        as ``photograph``; the masks are of the object alone, and the room is black
    """
    floor = float(mesh.bounds[0, 1])
    table = trimesh.creation.cylinder(TABLE_RADIUS, TABLE_DEPTH, sections=96)
    table = table.subdivide_to_size(0.08)
    table.apply_transform(np.eye(4)[[1, 2, 0, 3]])  # its axis z to y
    table.apply_translation([0, floor - TABLE_DEPTH / 2, 0])
    both = trimesh.util.concatenate(
        [trimesh.Trimesh(m.vertices, m.faces, process=False) for m in (mesh, table)]
    )

    def skins(at: Array) -> Array:
        skin = np.column_stack([pattern(at, seed), np.zeros(len(at))]).astype(np.float32)
        above = at[:, 1] > floor + 1e-4
        skin[above] = paint(at[above])
        return skin

    masks = silhouettes(mesh, cameras)
    for (image, _), mask in zip(photograph(both, cameras, skins, seed), masks, strict=True):
        yield image, mask


def photograph_before_wall(
    mesh: trimesh.Trimesh, cameras: Cameras, paint: Paint, seed: int = 0
) -> Iterator[Picture]:
    """Photograph an object that turns before a patterned wall, which stands still.

    Returns:
        as ``photograph``
    """
    width, height = cameras.sizes[0].tolist()
    v, u = np.mgrid[:height, :width]
    across = np.stack([u, v, np.zeros_like(u)], axis=-1).reshape(-1, 3) * (1.6 / max(width, height))
    wall = 255 * pattern(across.astype(np.float32), seed + 1).reshape(height, width, 3)
    for view, (image, mask) in enumerate(photograph(mesh, cameras, paint, seed)):
        noise = np.random.default_rng([seed, view, 1]).normal(0, 1.6, image.shape)
        behind = np.clip(np.rint(wall + noise), 0, 255).astype(np.uint8)
        yield np.where(mask[..., None], image, behind), mask


def silhouettes(mesh: trimesh.Trimesh, cameras: Cameras) -> NDArray[np.bool_]:
    """Which pixels' centres see the mesh, nothing standing before it: [views, height, width]."""
    points = cameras.project(torch.tensor(np.asarray(mesh.vertices))).float()
    faces = torch.tensor(np.asarray(mesh.faces), dtype=torch.int64)
    width, height = cameras.sizes[0].tolist()
    return (soft_silhouettes(points, faces, (height, width), sigma=1e-8) > 0.5).numpy()


def read_scan(path: Path) -> trimesh.Trimesh:
    """The one textured mesh of a scan's file."""
    return trimesh.load(path, force="mesh", process=False)
