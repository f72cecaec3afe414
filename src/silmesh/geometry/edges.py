"""The edges of a triangle mesh, each once however many faces share it."""

import numpy as np
from scipy import sparse


def number_edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number the edges of faces [faces, 3] int64.

    Returns:
        [edges, 2] the ends of every edge, the lower index first, in rising order; and
        [faces, 3] which of these are ab, bc and ca of each face abc
    """
    after = np.roll(faces, -1, axis=1)
    stride = int(faces.max()) + 1
    keys = np.minimum(faces, after) * stride + np.maximum(faces, after)
    keys, of_face = np.unique(keys, return_inverse=True)
    return np.stack(np.divmod(keys, stride), axis=1), of_face.reshape(-1, 3)


def link_ends(edges: np.ndarray, count: int) -> sparse.csr_array:
    """Which of so many vertices are joined by edges [edges, 2]: [verts, verts], 0 or 1."""
    both = np.concatenate([edges, edges[:, ::-1]])
    return sparse.csr_array((np.ones(len(both)), both.T), shape=(count, count))
