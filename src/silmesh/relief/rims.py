"""The rims of a refined surface, moved to where the outlines of the fitted one were.

A grid rounds what stands out, and depths near an outline are a little off. Vertices at which a view
sees the surface end are moved along their normals by as much as its outline there has moved, in
the mean over such views; their neighbours follow a little.
"""

import numpy as np
import torch
import trimesh

from silmesh.geometry.camera import Cameras
from silmesh.geometry.edges import link_ends, number_edges
from silmesh.geometry.signed_distance import signed_distance
from silmesh.shapes.downsample import render

ROUNDS = 3
FAR = 4.0  # pixels: most that an outline is taken to have moved
AT_RIM = 1.5  # pixels from the outline
GLANCING = 0.4  # cosine between normal and ray: the surface turns away
HOLD = 0.3  # weight of a vertex that is on no rim among its neighbours, where it stays
SPREAD = 4  # rounds in which neighbours follow


def match_rims(
    mesh: trimesh.Trimesh, bound: trimesh.Trimesh, cameras: Cameras, size: tuple[int, int]
) -> trimesh.Trimesh:
    """Move vertices until the mesh's silhouettes are those of the bound again.

    Args:
        size: height and width of the images in which they are compared
    """
    wanted = [signed_distance(shown, FAR, 0) for shown in render(bound, cameras, size)]
    neighbours = link_ends(number_edges(np.asarray(mesh.faces))[0], len(mesh.vertices))
    for _ in range(ROUNDS):
        push, count = _measure(mesh, wanted, cameras, size)
        weight = count + HOLD * (count == 0)
        move = push / np.maximum(count, 1)
        for _ in range(SPREAD):
            around = neighbours @ (weight * move) / np.maximum(neighbours @ weight, 1e-9)
            move = np.where(count > 0, (move + around) / 2, around / 2)
        verts = mesh.vertices + mesh.vertex_normals * move[:, None]
        mesh = trimesh.Trimesh(verts, mesh.faces, process=False)
    return mesh


def _measure(
    mesh: trimesh.Trimesh, wanted: list[np.ndarray], cameras: Cameras, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """The sum of moves in the world that views ask of each vertex, and how many ask: [verts]."""
    verts = torch.from_numpy(np.array(mesh.vertices))
    pixels, depths = cameras.project(verts).numpy(), cameras.depths(verts).numpy()
    shown = render(mesh, cameras, size)
    push, count = np.zeros(len(verts)), np.zeros(len(verts))
    for i, (at, depth) in enumerate(zip(pixels, depths, strict=True)):
        ray = mesh.vertices - cameras.centres[i].numpy()
        cosine = (ray * mesh.vertex_normals).sum(axis=1) / np.linalg.norm(ray, axis=1)
        column, row = np.where(np.isfinite(at), at, -1).astype(int).T
        inside = (column >= 0) & (column < size[1]) & (row >= 0) & (row < size[0])
        asked = np.flatnonzero(inside & (np.abs(cosine) < GLANCING))
        place = row[asked], column[asked]
        now = signed_distance(shown[i], FAR, 0)[place]
        rim = np.abs(now) < AT_RIM
        asked, moved = asked[rim], (wanted[i][place] - now)[rim]
        push[asked] += moved * depth[asked] / float(cameras.K[i, 0, 0])
        count[asked] += 1
    return push, count
