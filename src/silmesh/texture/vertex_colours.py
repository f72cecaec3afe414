"""Colours of a mesh's vertices, blended from the photographs that see them.

A view counts for a vertex as much as it sees it squarely and far from its silhouette's edge, where
the background has mixed into the photograph:

    w = cos^SQUARE (normal, ray) (d - ERODE) / FEATHER, cut to [FAINT, 1]

d is the distance to the outline in pixels; within ERODE of it, or where the mesh hides the vertex,
w is 0. Views that disagree with the others (a highlight, a hand, a view a little astray) are
weighted down by 1 / (1 + (r / SCALE)^2), r their distance from the mean, found anew ROUNDS times.
What no view sees gets the mean of its neighbours on the mesh.
"""

from collections.abc import Sequence

import numpy as np
import torch
import trimesh
from scipy.ndimage import map_coordinates

from silmesh.ahead import ahead
from silmesh.geometry.camera import Cameras
from silmesh.geometry.depth_within import depth_within
from silmesh.geometry.edges import link_ends, number_edges

SQUARE = 3
ERODE, FEATHER = 1.0, 4.0  # pixels
FAINT = 1e-3  # so that a thin part, nowhere far from an edge, still takes its own colour
SCALE = 25.0  # of 255
ROUNDS = 5
LIFT = 1e-3  # of the mesh's size: rays start so far above the surface
GREY = 124.0  # where nothing is known


def colour_vertices(
    verts: np.ndarray,
    faces: np.ndarray,
    cameras: Cameras,
    photographs: Sequence[np.ndarray],
    silhouettes: np.ndarray,
) -> np.ndarray:
    """Colour the vertices of a mesh from photographs of it.

    Args:
        verts: [verts, 3] in the cameras' world
        faces: [faces, 3], the outside counterclockwise
        photographs: of each view, [height, width, 3] uint8, sRGB
        silhouettes: [views, height, width] bool
    Returns:
        [verts, 3] uint8, sRGB
    """
    mesh = trimesh.Trimesh(verts, faces, process=False)
    weights = np.zeros((len(cameras), len(verts)))
    colours = np.zeros((len(cameras), len(verts), 3))

    def look(i: int) -> np.ndarray:
        pixels, photograph = _project(cameras.projections[i].numpy(), verts), photographs[i]
        for channel in range(3):
            colours[i, :, channel] = _sample(photograph[..., channel], pixels)
        return _feather(_sample(_measure_depths(silhouettes[i]), pixels))

    for i, feather in enumerate(ahead(look, range(len(cameras)), torch.get_num_threads())):
        weights[i] = _see(mesh, cameras.centres[i].numpy()) ** SQUARE * feather
    blended = _blend(colours, weights)
    filled = _fill(blended, weights.sum(axis=0) > 0, faces)
    return filled.round().clip(0, 255).astype(np.uint8)


def _see(mesh: trimesh.Trimesh, eye: np.ndarray) -> np.ndarray:
    """Cosine between normal and ray of each vertex that an eye sees, 0 for the others: [verts]."""
    towards = eye - mesh.vertices
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    cosine = (mesh.vertex_normals * towards).sum(axis=1).clip(min=0)
    front = np.flatnonzero(cosine)
    starts = mesh.vertices[front] + LIFT * mesh.scale * mesh.vertex_normals[front]
    hidden = mesh.ray.intersects_any(starts, towards[front])
    cosine[front[hidden]] = 0
    return cosine


def _project(P: np.ndarray, verts: np.ndarray) -> np.ndarray:
    """[verts, 2] pixels, far outside of the image for what is not in front of the camera."""
    seen = verts @ P[:, :3].T + P[:, 3]
    in_front = seen[:, 2:] > 0
    return np.where(in_front, seen[:, :2] / np.where(in_front, seen[:, 2:], 1), -1e6)


def _sample(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """An image [height, width] at pixels [n, 2], bilinear; 0 beyond it: [n]."""
    at = pixels.T[::-1] - 0.5
    return map_coordinates(image, at, order=1, mode="grid-constant", output=np.float64)


def _measure_depths(silhouette: np.ndarray) -> np.ndarray:
    """Distance of pixels inside a silhouette to its outline, as far as it matters."""
    inside = depth_within(silhouette, int(ERODE + FEATHER) + 3)
    return inside - 0.5 * (inside > 0)


def _feather(depth: np.ndarray) -> np.ndarray:
    return np.where(depth > ERODE, ((depth - ERODE) / FEATHER).clip(FAINT, 1), 0)


def _blend(colours: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Robust mean over the views of [views, verts, 3] weighted by [views, verts]: [verts, 3]."""
    trust = weights
    for _ in range(ROUNDS + 1):
        total = np.maximum(trust.sum(axis=0), 1e-300)
        mean = np.einsum("vn,vnc->nc", trust, colours) / total[:, None]
        distance = np.linalg.norm(colours - mean, axis=2)
        trust = weights / (1 + (distance / SCALE) ** 2)
    return mean


def _fill(colours: np.ndarray, known: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Spread colours from known vertices over the edges, ring by ring, to all others."""
    beside = link_ends(number_edges(faces)[0], len(colours))
    colours, known = np.where(known[:, None], colours, 0), known.copy()
    while True:
        count = beside @ known.astype(float)
        reached = ~known & (count > 0)
        if not reached.any():
            return np.where(known[:, None], colours, GREY)
        colours[reached] = (beside @ colours)[reached] / count[reached, None]
        known |= reached
