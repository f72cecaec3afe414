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
        self._factor = splu(
            self.matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
        )

    def parameters(self, verts: Tensor) -> Tensor:
        """u of vertices [verts, 3], float64."""
        return torch.from_numpy(self.matrix @ verts.double().cpu().numpy()).to(verts.device)

    def __call__(self, u: Tensor) -> Tensor:
        """The vertices [verts, 3] float32 of u; differentiable."""
        return _Solve.apply(u, self._factor)


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
