"""The surface of a field, and what each of its vertices stands on."""

import igl
import numpy as np
import torch
import trimesh
from scipy.ndimage import map_coordinates
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from skimage.measure import marching_cubes

from silmesh.geometry.camera import Cameras
from silmesh.geometry.depth_within import depth_within
from silmesh.relief.free_space import Grid

OUTLINE, PHOTOGRAPHS, GUESS = 0, 1, 2  # what a vertex stands on
STANDINGS = ("outline", "photographs", "guess")  # their names, in this order
BELIEVED = 1.0  # weight of views close by from which a vertex stands on photographs
ON_OUTLINE = 2.0  # pixels of the working image


def extract(field: np.ndarray, grid: Grid) -> trimesh.Trimesh:
    """The closed surface of a field's largest piece, the walls of hollows inside it included."""
    low = -np.abs(field).max() - 1
    verts, faces, _, _ = marching_cubes(
        np.pad(field, 1, constant_values=low), 0.0, gradient_direction="ascent"
    )
    edges = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_array((np.ones(len(edges)), edges.T), shape=(len(verts), len(verts)))
    _, piece = connected_components(graph, directed=False)
    a, b, c = (verts[faces[:, i]] for i in range(3))
    volume = np.bincount(piece[faces[:, 0]], (a * np.cross(b, c)).sum(axis=1) / 6)
    kept = faces[piece[faces[:, 0]] == volume.argmax()]
    used, numbered = np.unique(kept, return_inverse=True)
    world = grid.origin + (verts[used] - 1) * grid.spacing
    return trimesh.Trimesh(world, numbered.reshape(-1, 3), process=False)


def simplify(mesh: trimesh.Trimesh, vertices: int) -> trimesh.Trimesh:
    """The same surface with about so many vertices, by quadric errors (Garland, Heckbert 1997)."""
    faces = 2 * (vertices - mesh.euler_number)  # V - E + F = chi and 3 F = 2 E
    if faces >= len(mesh.faces):
        return mesh
    given = np.array(mesh.vertices, order="F"), np.array(mesh.faces, np.int32, order="F")
    verts, kept, _, _ = igl.qslim(*given, faces)
    return trimesh.Trimesh(verts, kept, process=False)


def judge_standing(
    verts: np.ndarray,
    close: np.ndarray,
    grid: Grid,
    silhouettes: np.ndarray,
    cameras: Cameras,
) -> np.ndarray:
    """What vertices stand on: photographs that found a surface there, an outline, or neither.

    Args:
        verts: [verts, 3] in the world
        close: [grid], weight of the views that found a surface close by
        silhouettes: [views, height, width] bool, of the working images
    Returns:
        [verts] uint8
    """
    index = (verts - grid.origin) / grid.spacing
    seen = map_coordinates(close, index.T, order=1, mode="nearest") >= BELIEVED
    rim = np.zeros(len(verts), bool)
    pixels = cameras.project(torch.from_numpy(np.float64(verts))).numpy()
    for silhouette, at in zip(silhouettes, pixels, strict=True):
        inside = depth_within(silhouette, int(ON_OUTLINE) + 1)
        height, width = silhouette.shape
        known = np.isfinite(at).all(axis=1)
        column, row = np.where(known[:, None], at, -1).astype(int).T
        known &= (column >= 0) & (column < width) & (row >= 0) & (row < height)
        rim[known] |= inside[row[known], column[known]] <= ON_OUTLINE
    return np.where(seen, PHOTOGRAPHS, np.where(rim, OUTLINE, GUESS)).astype(np.uint8)
