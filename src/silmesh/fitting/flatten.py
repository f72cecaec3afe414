"""The flatten term on the CPU with its gradient, edge by edge in one pass.

Plain torch, ``silmesh.fitting.losses.Flatten`` on other devices, spends most of the term's time on
gathering the corners and on adding up their gradients.
"""

import math

import numpy as np
from numba import njit
from torch import Tensor

from silmesh.fitting.beside import find_beside


def flatten_on_cpu(verts: Tensor, diamonds: Tensor, eps: float) -> Tensor:
    """Sum over the edges of (cos + 1)^2, of vertices [verts, 3] and diamonds [edges, 4].

    ``eps`` keeps lengths and sines above zero, as in ``silmesh.fitting.losses``.
    """
    return find_beside(_add_edges, verts, diamonds, eps)


@njit(nogil=True, cache=True, error_model="numpy")
def _add_edges(verts, diamonds, eps, gradient):
    """The loss; its gradient is added to ``gradient``, in the order of the edges."""
    loss = 0.0
    for i in range(diamonds.shape[0]):
        a, b, c, d = diamonds[i]
        corner = _read(verts, a)
        along = _subtract(_read(verts, b), corner)
        side_c, side_d = _subtract(_read(verts, c), corner), _subtract(_read(verts, d), corner)
        one, other = _stand(along, side_c, eps), _stand(along, side_d, eps)
        across, lengths = _dot(one[0], other[0]), one[1] * other[1] + eps
        cos = across / lengths
        loss += (cos + 1) ** 2
        by_across = 2 * (cos + 1) / lengths
        by_length = -by_across * cos
        down_c = _descend(along, side_c, eps, _scale(other[0], by_across), by_length * other[1])
        down_d = _descend(along, side_d, eps, _scale(one[0], by_across), by_length * one[1])
        down_b = _add(down_c[0], down_d[0])
        _add_to(gradient, b, down_b)
        _add_to(gradient, c, down_c[1])
        _add_to(gradient, d, down_d[1])
        _add_to(gradient, a, _scale(_add(down_b, _add(down_c[1], down_d[1])), -1.0))
    return loss


@njit(cache=True, error_model="numpy")
def _stand(along, side, eps):
    """The part of ``side`` at right angles to ``along``, and its length as ``losses`` has it."""
    dot, along2, side2 = _dot(along, side), _dot(along, along), _dot(side, side)
    cos = dot / (math.sqrt(along2 + eps) * math.sqrt(side2 + eps) + eps)
    length = math.sqrt(side2 + eps) * math.sqrt(1 - cos * cos + eps)
    return _subtract(side, _scale(along, dot / (along2 + eps))), length


@njit(cache=True, error_model="numpy")
def _descend(along, side, eps, by_part, by_length):
    """From the gradient by what ``_stand`` gives to that by ``along`` and by ``side``."""
    dot, along2, side2 = _dot(along, side), _dot(along, along), _dot(side, side)
    root, reach = math.sqrt(along2 + eps), math.sqrt(side2 + eps)
    product = root * reach + eps
    cos, share = dot / product, dot / (along2 + eps)
    sine = math.sqrt(1 - cos * cos + eps)
    by_cos = -by_length * reach * cos / sine
    by_share = -_dot(by_part, along)
    by_dot = by_share / (along2 + eps) + by_cos / product
    by_along2 = (-by_cos * cos / product * reach) / (2 * root) - by_share * share / (along2 + eps)
    by_side2 = (by_length * sine - by_cos * cos / product * root) / (2 * reach)
    by_along = _add(_scale(along, 2 * by_along2), _scale(side, by_dot))
    by_side = _add(_scale(side, 2 * by_side2), _scale(along, by_dot))
    return _subtract(by_along, _scale(by_part, share)), _add(by_side, by_part)


@njit(cache=True)
def _read(verts, i):
    return np.float64(verts[i, 0]), np.float64(verts[i, 1]), np.float64(verts[i, 2])


@njit(cache=True)
def _add_to(gradient, i, a):
    gradient[i, 0] += a[0]
    gradient[i, 1] += a[1]
    gradient[i, 2] += a[2]


@njit(cache=True)
def _add(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True)
def _subtract(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(cache=True)
def _scale(a, factor):
    return a[0] * factor, a[1] * factor, a[2] * factor


@njit(cache=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
