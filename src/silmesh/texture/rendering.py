"""Pictures of a textured mesh, without light: what its cameras would photograph."""

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from silmesh.geometry.camera import Cameras
from silmesh.texture.raster import draw, weigh_corners
from silmesh.texture.sampling import sample_all


class Textured(Protocol):
    """What is drawn: as ``bake.Texture``."""

    verts: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    image: np.ndarray


def render(texture: Textured, cameras: Cameras) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """See a textured mesh, each triangle from both sides, without antialiasing.

    Args:
        cameras: in the mesh's world
    Yields:
        for each camera the image [height, width, 3] uint8, black beside the mesh, and what the
        mesh covers of it [height, width] bool
    """
    for corners, weights, covered in _see(texture.verts, texture.faces, cameras):
        uv = np.einsum("nk,nkc->nc", weights, texture.uv[corners])
        pixels = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1) * texture.image.shape[0]
        yield _paint(sample_all(texture.image, pixels.astype(float)), covered), covered


def render_vertex_colours(
    verts: np.ndarray, faces: np.ndarray, colours: np.ndarray, cameras: Cameras
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """See a mesh with colours of its vertices [verts, 3], as ``render`` does."""
    for corners, weights, covered in _see(verts, faces, cameras):
        yield _paint(np.einsum("nk,nkc->nc", weights, colours[corners]), covered), covered


def _see(
    verts: np.ndarray, faces: np.ndarray, cameras: Cameras
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Of each pixel on the mesh the corners [n, 3] and their weights, and which these are."""
    for P, size in zip(cameras.projections.numpy(), cameras.sizes.tolist(), strict=True):
        seen = verts @ P[:, :3].T + P[:, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            points = seen[:, :2] / seen[:, 2:]
        shown = draw(points, seen[:, 2], faces, tuple(size))[0]
        rows, columns = np.nonzero(shown >= 0)
        corners = faces[shown[rows, columns]]
        pixels = np.stack([columns, rows], axis=1) + 0.5
        yield corners, weigh_corners(points, seen[:, 2], corners, pixels), shown >= 0


def _paint(colours: np.ndarray, covered: np.ndarray) -> np.ndarray:
    image = np.zeros((*covered.shape, 3), np.uint8)
    image[covered] = colours.round().clip(0, 255).astype(np.uint8)
    return image
