"""Large steps: a parametrisation of the vertices by a Laplacian, and an Adam that suits it.

Nicolet, Jacobson and Jakob, *Large steps in inverse rendering of geometry*, 2021: in place of the
vertices x the optimiser moves u = (I + smoothing L) x with the mesh's combinatorial Laplacian L.
The gradient by u is the gradient by x times the inverse of this matrix, and a step of u becomes one
of x by the inverse again. So a step of x is smooth although the gradient is not, and vertices
without a gradient follow their neighbours.
"""

import warnings

import numpy as np
import torch
from scipy import sparse
from scipy.sparse.linalg import splu
from torch import Tensor

from silmesh.geometry.edges import link_ends, number_edges

EPS = 1e-20  # keeps a step finite where all gradients are 0
# On a GPU a mesh of more vertices is solved by a polynomial, to this accuracy.
HELD, ACCURACY = 12_000, 1e-6


class Smooth:
    """The vertices of a mesh as a function of u, and back.

    Args:
        faces: [faces, 3] of a mesh whose vertices all have neighbours
        verts: how many vertices it has
        smoothing: how far a step spreads, in squared edges; with 0 each vertex moves by itself
    """

    def __init__(self, faces: Tensor, verts: int, smoothing: float):
        ends, _ = number_edges(faces.cpu().numpy())
        adjacent = link_ends(ends, verts)
        laplacian = sparse.diags_array(adjacent.sum(axis=0)) - adjacent
        self.matrix = (sparse.eye_array(verts) + smoothing * laplacian).tocsc()
        self._solver = _make_solver(self.matrix, faces.device)

    def parameters(self, verts: Tensor) -> Tensor:
        """u of vertices [verts, 3], float64."""
        return torch.from_numpy(self.matrix @ verts.double().cpu().numpy()).to(verts.device)

    def __call__(self, u: Tensor) -> Tensor:
        """The vertices [verts, 3] float32 of u; differentiable."""
        return _Solve.apply(u, self._solver)


def _make_solver(matrix: sparse.csc_array, device: torch.device):
    """What gives the inverse times [n, columns] float64, on its device."""
    if not works_on(device):
        return _Factors(matrix)
    if matrix.shape[0] <= HELD:
        return _Inverse(torch.from_numpy(matrix.toarray()).to(device))
    return _Chebyshev(_to_device(matrix, device), float(matrix.diagonal().max()))


def works_on(device: torch.device) -> bool:
    """Whether a step stays in a device's memory: a GPU is far from the host."""
    return device.type != "cpu"


def _to_device(matrix: sparse.csc_array, device: torch.device) -> Tensor:
    rows = matrix.tocsr()
    parts = (torch.from_numpy(part) for part in (rows.indptr, rows.indices, rows.data))
    with warnings.catch_warnings():  # that torch calls such tensors new
        warnings.simplefilter("ignore")
        return torch.sparse_csr_tensor(
            *parts, size=rows.shape, device=device, check_invariants=False
        )


class _Factors:
    """A sparse factorisation: of 100,000 vertices it takes 1 s, and then 30 ms a solution.

    Vertices are shuffled before, since the search for an order takes minutes where they are
    numbered as a subdivision leaves them.
    """

    def __init__(self, matrix: sparse.csc_array):
        self._order = np.random.default_rng(0).permutation(matrix.shape[0])
        shuffled = matrix[self._order][:, self._order].tocsc()
        options = {"SymmetricMode": True}
        self._factors = splu(shuffled, permc_spec="MMD_AT_PLUS_A", options=options)

    def solve(self, right: Tensor) -> Tensor:
        """The inverse times [n, columns] float64."""
        given = right.numpy()
        x = np.empty_like(given)
        x[self._order] = self._factors.solve(given[self._order])
        return torch.from_numpy(x)


class _Inverse:
    """The inverse itself, n^2 numbers in a GPU's memory, which reads them faster than it solves."""

    def __init__(self, matrix: Tensor):
        self._inverse = torch.cholesky_inverse(torch.linalg.cholesky(matrix))

    def solve(self, right: Tensor) -> Tensor:
        """The inverse times [n, columns] float64."""
        return self._inverse @ right


class _Chebyshev:
    """An approximate inverse of I + smoothing L: a fixed polynomial of it, linear and symmetric.

    The eigenvalues lie between 1 and twice the largest entry of the diagonal (Gershgorin), so the
    error falls by (sqrt(k) - 1) / (sqrt(k) + 1) in each step, k their quotient (Saad, *Iterative
    methods for sparse linear systems*, algorithm 12.1).

    Args:
        matrix: [n, n], sparse
        largest: entry of its diagonal
    """

    def __init__(self, matrix: Tensor, largest: float):
        self._matrix, self._most = matrix, max(2 * largest - 1, 1 + 1e-9)
        root = np.sqrt(self._most)
        self._steps = int(np.ceil(np.log(2 / ACCURACY) / np.log((root + 1) / (root - 1))))

    def solve(self, right: Tensor) -> Tensor:
        """The inverse times [n, columns] float64."""
        middle, half = (self._most + 1) / 2, (self._most - 1) / 2
        rho, x, rest = half / middle, 0 * right, 1 * right
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
    def forward(ctx, u, solver):
        ctx.solver, ctx.dtype = solver, u.dtype
        return solver.solve(u.double()).float()

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, upstream):
        return ctx.solver.solve(upstream.double()).to(ctx.dtype), None


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
