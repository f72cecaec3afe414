"""The first mesh that a configuration names."""

import numpy as np
import trimesh

from silmesh.shapes.place import align_to_box, choose_count
from silmesh.shapes.sphere import unit_sphere

SHAPES = {"sphere": unit_sphere}


def first_mesh(
    shape: str, vertices: int | str, align: str, silhouettes: np.ndarray
) -> trimesh.Trimesh:
    """Make a first mesh at unit size; the fit halves it.

    Args:
        shape: a key of ``SHAPES``
        vertices: how many, or ``auto``
        align: ``none``, or ``bbox`` for the report's scale and shift to the first silhouette
        silhouettes: [views, height, width] bool
    """
    mesh = SHAPES[shape](choose_count(silhouettes) if vertices == "auto" else int(vertices))
    if align == "bbox":
        mesh.vertices = align_to_box(mesh.vertices, silhouettes[0])
    return mesh
