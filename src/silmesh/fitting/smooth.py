"""Large steps: a parametrisation of the vertices by a Laplacian, and an Adam that suits it.

Nicolet, Jacobson and Jakob, *Large steps in inverse rendering of geometry*, 2021: in place of the
vertices x the optimiser moves u = (I + smoothing L) x with the mesh's combinatorial Laplacian L.
The gradient by u is the gradient by x times the inverse of this matrix, and a step of u becomes one
of x by the inverse again. So a step of x is smooth although the gradient is not, and vertices
without a gradient follow their neighbours.
"""

import numpy as np
import torch
from scipy import sparse
from scipy.sparse.linalg import splu
from torch import Tensor

from silmesh.geometry.edges import number_edges

EPS = 1e-20  # keeps a step finite where all gradients are 0
# A mesh of more vertices is not factorised, which would take minutes, but solved to this accuracy.
DIRECT, ACCURACY = 12_000, 1e-6


class Smooth:
    """The vertices of a mesh as a function of u, and back.

    Args:
        faces: [faces, 3] of a mesh whose vertices all have neighbours
        verts: how many vertices it has
        smoothing: how far a step spreads, in squared edges; with 0 each vertex moves by itself
    """

    def __init__(self, faces: Tensor, verts: int, smoothing: float):
        ends, _ = number_edges(faces.cpu().numpy())
        both = np.concatenate([ends, ends[:, ::-1]])
        adjacent = sparse.csc_array((np.ones(len(both)), both.T), shape=(verts, verts))
        laplacian = sparse.diags_array(adjacent.sum(axis=0)) - adjacent
        self.matrix = (sparse.eye_array(verts) + smoothing * laplacian).tocsc()
        direct = verts <= DIRECT or not smoothing
        self._factor = _factorise(self.matrix) if direct else _Chebyshev(self.matrix)

    def parameters(self, verts: Tensor) -> Tensor:
        """u of vertices [verts, 3], float64."""
        return torch.from_numpy(self.matrix @ verts.double().cpu().numpy()).to(verts.device)

    def __call__(self, u: Tensor) -> Tensor:
        """The vertices [verts, 3] float32 of u; differentiable."""
        return _Solve.apply(u, self._factor)


def _factorise(matrix: sparse.csc_array):
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})


class _Chebyshev:
    """An approximate inverse of I + smoothing L: a fixed polynomial of it, linear and symmetric.

    The eigenvalues lie between 1 and twice the largest entry of the diagonal (Gershgorin), so the
    error falls by (sqrt(k) - 1) / (sqrt(k) + 1) in each step, k their quotient (Saad, *Iterative
    methods for sparse linear systems*, algorithm 12.1).
    """

    def __init__(self, matrix: sparse.csc_array):
        self._matrix, self._most = matrix.tocsr(), 2 * float(matrix.diagonal().max()) - 1
        root = np.sqrt(self._most)
        self._steps = int(np.ceil(np.log(2 / ACCURACY) / np.log((root + 1) / (root - 1))))

    def solve(self, right: np.ndarray) -> np.ndarray:
        """The inverse times [n, columns] float64."""
        middle, half = (self._most + 1) / 2, (self._most - 1) / 2
        rho, x, rest = half / middle, np.zeros_like(right), right.copy()
        move = rest / middle
        for _ in range(self._steps):
            x += move
            rest -= self._matrix @ move
            after = 1 / (2 * middle / half - rho)
            move = after * rho * move + 2 * after / half * rest
            rho = after
        return x


class _Solve(torch.autograd.Function):
    """x = A^-1 u for a symmetric A: the gradient is A^-1 of the gradient."""

    @staticmethod
    def forward(ctx, u, factor):
        ctx.factor, ctx.dtype = factor, u.dtype
        return _solve(factor, u).float()

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, upstream):
        return _solve(ctx.factor, upstream).to(ctx.dtype), None


def _solve(factor, right: Tensor) -> Tensor:
    return torch.from_numpy(factor.solve(right.double().cpu().numpy())).to(right.device)


class UniformAdam:
    """Adam with one second moment, the largest of all, so that it scales steps isotropically.

    Args:
        like: the parameters, of which shape, type and device are taken
        betas: decay rates of the first and the second moment
    """

    def __init__(self, like: Tensor, betas: tuple[float, float]):
        self.betas = betas
        self.first, self.second = torch.zeros_like(like), torch.zeros_like(like)
        self.steps = 0

    def direction(self, gradient: Tensor) -> Tensor:
        """The next step, about 1 at its largest."""
        beta1, beta2 = self.betas
        self.steps += 1
        self.first = beta1 * self.first + (1 - beta1) * gradient
        self.second = beta2 * self.second + (1 - beta2) * gradient.square()
        first = self.first / (1 - beta1**self.steps)
        largest = (self.second.max() / (1 - beta2**self.steps)).sqrt()
        return first / (largest + EPS)

    def state(self) -> dict:
        """All that changes."""
        return {"steps": self.steps, "first": self.first, "second": self.second}

    def restore(self, state: dict) -> None:
        """Go on from a state."""
        self.steps, self.first, self.second = state["steps"], state["first"], state["second"]
