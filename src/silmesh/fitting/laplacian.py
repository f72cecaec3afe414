"""The Laplacian term on the CPU with its gradient, vertex by vertex in two passes.

Plain torch, ``silmesh.fitting.losses.Laplacian`` on other devices, adds up the neighbours' rows one
by one at many times the cost of their arithmetic, forward and backward.
"""

import numpy as np
from numba import njit
from torch import Tensor

from silmesh.fitting.beside import find_beside


def laplacian_on_cpu(verts: Tensor, starts: Tensor, neighbours: Tensor) -> Tensor:
    """Sum over the vertices of |v - mean of v's neighbours|^2, of vertices [verts, 3].

    Args:
        starts: [verts + 1], where the neighbours of each vertex begin
        neighbours: [2 edges], those of the first vertex, then of the second, ...
    """
    return find_beside(_add_vertices, verts, starts, neighbours)


@njit(nogil=True, cache=True, error_model="numpy")
def _add_vertices(verts, starts, neighbours, gradient):
    """The loss; its gradient is written to ``gradient``.

    A vertex's own difference from its neighbours' mean, and its share in those of its neighbours:
    of v - sum_u u / degree(v) the derivative by u is -1 / degree(v).
    """
    count = verts.shape[0]
    apart, loss = np.empty((count, 3)), 0.0
    for v in range(count):
        x = y = z = 0.0
        for i in range(starts[v], starts[v + 1]):
            u = neighbours[i]
            x, y, z = x + verts[u, 0], y + verts[u, 1], z + verts[u, 2]
        degree = starts[v + 1] - starts[v]
        x, y, z = verts[v, 0] - x / degree, verts[v, 1] - y / degree, verts[v, 2] - z / degree
        loss += x * x + y * y + z * z
        apart[v, 0], apart[v, 1], apart[v, 2] = x, y, z
    for v in range(count):
        x, y, z = apart[v, 0], apart[v, 1], apart[v, 2]
        for i in range(starts[v], starts[v + 1]):
            u = neighbours[i]
            degree = starts[u + 1] - starts[u]
            x -= apart[u, 0] / degree
            y -= apart[u, 1] / degree
            z -= apart[u, 2] / degree
        gradient[v, 0], gradient[v, 1], gradient[v, 2] = 2 * x, 2 * y, 2 * z
    return loss
