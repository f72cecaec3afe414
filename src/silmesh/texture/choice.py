"""Which photograph gives each part of a mesh its detail: the best one, chosen smoothly."""

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, diags

SMOOTHING = 6  # rounds in which a vertex takes the mean of its own and its neighbours' qualities


def choose_views(qualities: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """How much of each view's detail each vertex takes: [views, verts], columns sum to 1 or 0.

    Args:
        qualities: [views, verts], 0 where a view does not see a vertex
        faces: [faces, 3]
    """
    logs = np.log(np.maximum(qualities, 1e-6))
    average = average_neighbours(faces, qualities.shape[1])
    for _ in range(SMOOTHING):
        logs = logs @ average.T
    best = np.where(qualities > 0, logs, -np.inf).argmax(axis=0)
    shares = np.zeros_like(qualities)
    shares[best, np.arange(len(best))] = 1
    return shares * (qualities > 0).any(axis=0)


def average_neighbours(faces: np.ndarray, count: int) -> csr_matrix:
    """A matrix that gives each vertex the mean of itself and its neighbours: [verts, verts]."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    rows, columns = np.concatenate([pairs, pairs[:, ::-1]]).T
    beside = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count)).tocsr()
    beside.data[:] = 1
    beside = beside + diags(np.ones(count))
    return (diags(1 / np.asarray(beside.sum(axis=1)).ravel()) @ beside).tocsr()
