"""Colours for what no photograph shows: harmonic on the mesh between those that are known."""

import numpy as np
from scipy.sparse import eye
from scipy.sparse.linalg import spsolve

from silmesh.texture.choice import average_neighbours

GREY = 124.0  # where nothing is known
FAINT = 1e-6  # pull towards grey, so that a part without any known vertex has a solution


def fill_vertices(colours: np.ndarray, known: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Spread known colours over the rest of a mesh, each vertex the mean of its neighbours.

    Args:
        colours: [verts, 3]
        known: [verts] bool
        faces: [faces, 3]
    """
    filled = np.where(known[:, None], colours, GREY)
    if known.all() or not known.any():
        return filled
    laplacian = eye(len(known)) - average_neighbours(faces, len(known))
    rows = laplacian.tocsr()[~known]
    left = (rows[:, ~known] + FAINT * eye(int((~known).sum()))).tocsc()
    right = FAINT * GREY - rows[:, known] @ colours[known]
    filled[~known] = spsolve(left, right).reshape(-1, 3)
    return filled
