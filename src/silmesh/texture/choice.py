"""Which photographs give each part of a mesh its detail: the best ones, chosen smoothly.

A mean of all would be blurred wherever the mesh or the cameras are a little astray, and one alone
has seams, and every highlight that it saw. So views share the detail by a high power of how well
they see, whose logarithm is first smoothed over the mesh, so that the choice does not flicker.
"""

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, diags

SMOOTHING = 6  # rounds in which a vertex takes the mean of its own and its neighbours' qualities
POWER = 4
FAINT = 1e-6  # quality that stands for none in the logarithm


def share_detail(qualities: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """How much of each view's detail each vertex takes: [views, verts], at most 1.

    Args:
        qualities: [views, verts], 0 where a view does not see a vertex
        faces: [faces, 3]
    """
    logs = np.log(np.maximum(qualities, FAINT))
    average = average_neighbours(faces, qualities.shape[1])
    for _ in range(SMOOTHING):
        logs = logs @ average.T
    logs = np.where(qualities > 0, logs, -np.inf)
    best = logs.max(axis=0)
    return np.exp(POWER * (logs - np.where(np.isfinite(best), best, 0)))


def average_neighbours(faces: np.ndarray, count: int) -> csr_matrix:
    """A matrix that gives each vertex the mean of itself and its neighbours: [verts, verts]."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    rows, columns = np.concatenate([pairs, pairs[:, ::-1]]).T
    beside = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count)).tocsr()
    beside.data[:] = 1
    beside = beside + diags(np.ones(count))
    return (diags(1 / np.asarray(beside.sum(axis=1)).ravel()) @ beside).tocsr()
