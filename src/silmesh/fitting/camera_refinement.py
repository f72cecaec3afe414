"""Cameras refined alongside the mesh: corrections that all share, and small ones of each view.

A correction turns a camera about the world's origin and shifts it, both in the camera's own frame:

    R' = exp([w]x) R,    t' = t + v,    then f' = f exp(s) and t_z' = t_z exp(s)

A longer lens goes with a greater distance, so that s changes the perspective alone: seen from afar
it could hardly be told from the size of the mesh.

w and v are the sum of those that all cameras share (of a turntable: elevation, roll, the axis's
place, distance) and of the view's own; the focal length is shared. Each is counted in standard
deviations of what is to be expected, and half the sum of their squares is the prior.

A similarity of the world (R -> R exp(-[a]x), t -> t + R b, t -> c t) shows in no silhouette, so its
directions are taken out of the corrections, and the shared ones out of the views' own. So the whole
does not drift, and the shared correction is right for a view that is not fitted.
"""

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from silmesh.fitting.adam import Adam
from silmesh.geometry.camera import Cameras

OWN_SD = (0.009, 0.009, 0.009, 0.006, 0.006, 0.006)  # of w (radians) and v (world units) of a view
SHARED_SD = (0.05, 0.05, 0.05, 0.05, 0.05, 0.2, 0.1)  # of w, v and s of all
SHARED = 0.1  # weight of the shared corrections' prior: that of a tenth of all views
PERSPECTIVE = 6  # its place among the shared corrections
SAME = 0.999  # cosine from which on a shared correction is a similarity of the world


class Refinement:
    """Corrected cameras as functions of parameters: 7 shared, then 6 of each view, zero at first.

    Args:
        cameras: in the normalised world
    """

    def __init__(self, cameras: Cameras):
        count = len(cameras)
        own_sd, shared_sd = (torch.tensor(sd, dtype=torch.float64) for sd in (OWN_SD, SHARED_SD))
        shared = torch.diag(shared_sd[:6] / own_sd).repeat(count, 1)
        gauge = _similarities(cameras) / own_sd.repeat(count).unsqueeze(1)
        self.cameras = cameras
        self._own_sd, self._shared_sd = own_sd, shared_sd
        self._allowed = _without(shared, gauge)
        self._taken = _span(torch.cat([gauge, shared], dim=1))

    def start(self) -> Tensor:
        """The parameters of no correction."""
        return torch.zeros(7 + 6 * len(self.cameras), dtype=torch.float64)

    def corrections(self, parameters: Tensor) -> tuple[Tensor, Tensor]:
        """In standard deviations: the shared ones [7] and the views' own [views, 6]."""
        shared = torch.cat([self._allowed @ parameters[:6], parameters[6:7]])
        own = parameters[7:] - self._taken @ (self._taken.mT @ parameters[7:])
        return shared, own.reshape(-1, 6)

    def __call__(self, parameters: Tensor, index: Sequence[int]) -> Cameras:
        """The corrected cameras at these positions; differentiable."""
        shared, own = self.corrections(parameters)
        shared, own = shared * self._shared_sd, own[list(index)] * self._own_sd
        return _correct(self.cameras.select(index), own + shared[:6], shared[6])

    def all_of(self, parameters: Tensor, cameras: Cameras, fitted: list[int]) -> Cameras:
        """The cameras of all views, of which these are fitted; the others are corrected as all."""
        shared, own = self.corrections(parameters)
        shared = shared * self._shared_sd
        every = shared[:6].repeat(len(cameras), 1)
        every[fitted] += own * self._own_sd
        return _correct(cameras, every, shared[6])

    def prior(self, parameters: Tensor) -> Tensor:
        """Half the squares of the corrections: the mean of the views' own, and the shared ones."""
        shared, own = self.corrections(parameters)
        return own.square().sum() / (2 * len(own)) + SHARED * shared.square().sum() / 2


class RefinementAdam(Adam):
    """Adam on a refinement's parameters, in which the perspective does not drift.

    Silhouettes hardly tell the perspective, so its gradient is small and its sign changes with
    rounding. Adam would scale it up to steps as long as any: cameras that were right ended 1 % away
    in the mean, up to 2.5 %. Scaled by the largest of the shared corrections' gradients, the
    perspective moves as far as the silhouettes ask for it beside the others.
    """

    def scale(self, second: Tensor) -> Tensor:
        """The squared gradients [7 + 6 views], the perspective's replaced by the largest shared."""
        scaled = second.clone()
        scaled[PERSPECTIVE] = second[: PERSPECTIVE + 1].max()
        return scaled


def _correct(cameras: Cameras, own: Tensor, log_focal: Tensor) -> Cameras:
    """Turn and shift cameras by [views, 6], and lengthen lens and distance."""
    turn = torch.linalg.matrix_exp(_cross(own[:, :3]))
    one = torch.ones_like(log_focal)
    scale = torch.stack([log_focal.exp(), log_focal.exp(), one])
    deepen = torch.stack([one, one, log_focal.exp()])
    t = (cameras.t + own[:, 3:]) * deepen
    return replace(cameras, K=cameras.K * scale, R=turn @ cameras.R, t=t)


def _cross(w: Tensor) -> Tensor:
    """[w]x of [..., 3]: [..., 3, 3], with [w]x v = w x v."""
    x, y, z = w.unbind(-1)
    zero = torch.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return torch.stack(rows, dim=-1).reshape(*w.shape, 3)


def _similarities(cameras: Cameras) -> Tensor:
    """What turning, shifting and scaling the world does to w and v of each view: [6 views, 7]."""
    count = len(cameras)
    turn = torch.cat([-cameras.R, torch.zeros_like(cameras.R)], dim=1)
    shift = torch.cat([torch.zeros_like(cameras.R), cameras.R], dim=1)
    scale = torch.cat([torch.zeros_like(cameras.t), cameras.t], dim=1).unsqueeze(2)
    return torch.cat([turn, shift, scale], dim=2).reshape(6 * count, 7)


def _without(directions: Tensor, others: Tensor) -> Tensor:
    """What makes combinations of directions [n, k] orthogonal to those that lie in ``others``."""
    basis, coordinates = torch.linalg.qr(directions)
    u, cosines, _ = torch.linalg.svd(basis.mT @ _span(others))
    same = u[:, : len(cosines)][:, cosines > SAME]
    kept = torch.eye(len(u), dtype=u.dtype) - same @ same.mT
    return torch.linalg.solve(coordinates, kept @ coordinates)


def _span(directions: Tensor) -> Tensor:
    """An orthonormal basis of what directions [n, k] span: [n, their rank]."""
    u, singular, _ = torch.linalg.svd(directions, full_matrices=False)
    return u[:, singular > 1e-6 * singular[0]]
