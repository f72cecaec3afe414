"""From a made-up object's distance function to a watertight mesh with colours."""

from collections.abc import Callable
from types import ModuleType

import numpy as np
import trimesh
from numpy.typing import NDArray
from skimage.measure import marching_cubes

from silmesh.errors import InputError
from silmesh.synthetic.objects import apricot, bear, bottle, plane, pot, tube

Array = NDArray[np.floating]

_MODULES = {
    "apricot": apricot,
    "bear": bear,
    "bottle": bottle,
    "plane": plane,
    "pot": pot,
    "tube": tube,
}


def make_object(name: str) -> trimesh.Trimesh:
    """Make the true mesh of a made-up object, in the world of its photographs.

    Returns:
        a watertight mesh, oriented outwards, with a colour at each vertex; within the sphere of
        radius 0.52 about the origin, y up
    Raises:
        InputError: there is no object of this name
    """
    module = _find_module(name)
    mesh = mesh_solid(module.distance, *module.BOX, module.VOXEL)
    colours = module.paint(mesh.vertices.astype(np.float32))[:, :3]
    mesh.visual = trimesh.visual.ColorVisuals(
        mesh, vertex_colors=np.round(np.clip(colours, 0, 1) * 255).astype(np.uint8)
    )
    return mesh


def find_paint(name: str) -> Callable[[Array], Array]:
    """The paint of a made-up object, for points anywhere on it and not at vertices only."""
    return _find_module(name).paint


def mesh_solid(
    distance: Callable[[Array], Array],
    low: tuple[float, float, float],
    high: tuple[float, float, float],
    voxel: float,
) -> trimesh.Trimesh:
    """Mesh the solid where a distance function is negative, by marching cubes.

    Args:
        distance: from points [n, 3] float32 to signed distances [n]
        low, high: corners of a box that holds the solid with a voxel to spare
        voxel: side of the cubes, in world units; about the length of the mesh's edges
    """
    axes = [
        np.arange(a, b + voxel, voxel, dtype=np.float32) for a, b in zip(low, high, strict=True)
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    values = np.stack([distance(layer.reshape(-1, 3)) for layer in grid]).reshape(grid.shape[:3])
    # A grid point right on the surface would make triangles without area.
    values[np.abs(values) < 1e-4 * voxel] = 1e-4 * voxel
    verts, faces, *_ = marching_cubes(values, level=0.0, spacing=(voxel,) * 3)
    verts = _pull_to_surface(verts + np.float32(low), distance, voxel)
    mesh = trimesh.Trimesh(verts, faces, process=False)
    if mesh.volume < 0:
        mesh.invert()
    return mesh


def _pull_to_surface(
    verts: Array, distance: Callable[[Array], Array], voxel: float, times: int = 2
) -> Array:
    """Newton steps onto the surface: marching cubes is only linear between its grid points."""
    reach = 0.25 * voxel
    for _ in range(times):
        slope = np.stack(
            [
                distance(verts + step) - distance(verts - step)
                for step in reach * np.eye(3, dtype="f4")
            ],
            axis=1,
        ) / (2 * reach)
        slope2 = np.maximum((slope**2).sum(axis=1), 0.1)
        length = np.clip(distance(verts) / slope2, -voxel / 2, voxel / 2)
        verts = verts - (length[:, None] * slope).astype(np.float32)
    return verts


def _find_module(name: str) -> ModuleType:
    if name not in _MODULES:
        raise InputError(f"{name!r} is no made-up object; there are {', '.join(_MODULES)}")
    return _MODULES[name]
