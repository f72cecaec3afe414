"""Camera refinement: corrections that all cameras share, and small ones of each view.

A correction rotates a camera about the world's origin and shifts it, both in the camera's frame:

    R' = exp([w]x) R,    t' = t + v,    then f' = f exp(s) and t_z' = t_z exp(s)

The distance grows with the focal length, so that s changes the perspective alone; a change of the
focal length alone could hardly be distinguished from a change of the mesh's size.

w and v are each the sum of a correction that all cameras share (for a turntable: elevation, roll,
position of the axis, distance) and of one of the view's own. The focal length is shared. All are
parametrised in standard deviations of their prior, which is half the sum of their squares.

A similarity of the world (R -> R exp(-[a]x), t -> t + R b, t -> c t) changes no silhouette. So its
directions are projected out of all corrections, and the directions of the shared corrections out of
those of the views. The scene then cannot drift, and the shared correction also suits a view that
was not fitted.
"""

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from silmesh.fitting.adam import Adam
from silmesh.geometry.camera import Cameras, places

# Standard deviations of the prior: of w (radians) and v (world units) of one view, and of w, v and
# s of all views together.
OWN_SD = (0.009, 0.009, 0.009, 0.006, 0.006, 0.006)
SHARED_SD = (0.05, 0.05, 0.05, 0.05, 0.05, 0.2, 0.1)
SHARED = 0.1  # weight of the shared corrections' prior, beside 1 for the mean of the views' priors
PERSPECTIVE = 6  # index of s among the shared corrections
TINY = 1e-30  # squared radians: keeps the gradient of a rotation by nothing finite
SAME = 0.999  # cosine from which a shared correction counts as a similarity of the world


class Refinement:
    """Corrected cameras as functions of parameters: 7 shared, then 6 of each view, zero at first.

    Args:
        cameras: in the normalised world
        device: to correct them on
    """

    def __init__(self, cameras: Cameras, device: torch.device | str = "cpu"):
        count = len(cameras)
        own_sd, shared_sd = (torch.tensor(sd, dtype=torch.float64) for sd in (OWN_SD, SHARED_SD))
        shared = torch.diag(shared_sd[:6] / own_sd).repeat(count, 1)
        gauge = _similarities(cameras) / own_sd.repeat(count).unsqueeze(1)
        self.cameras = cameras.to(device)
        self._own_sd, self._shared_sd = own_sd.to(device), shared_sd.to(device)
        self._allowed = _without(shared, gauge).to(device)
        self._taken = _span(torch.cat([gauge, shared], dim=1)).to(device)

    def start(self) -> Tensor:
        """The parameters that correct nothing."""
        return self._own_sd.new_zeros(7 + 6 * len(self.cameras))

    def corrections(self, parameters: Tensor) -> tuple[Tensor, Tensor]:
        """The shared corrections [7] and those of the views [views, 6], in standard deviations."""
        shared = torch.cat([self._allowed @ parameters[:6], parameters[6:7]])
        own = parameters[7:] - self._taken @ (self._taken.mT @ parameters[7:])
        return shared, own.reshape(-1, 6)

    def __call__(self, parameters: Tensor, index: Sequence[int]) -> Cameras:
        """The corrected cameras at these positions; differentiable."""
        shared, own = self.corrections(parameters)
        shared, own = shared * self._shared_sd, own[places(index)] * self._own_sd
        return _correct(self.cameras.select(index), own + shared[:6], shared[6])

    def all_of(self, parameters: Tensor, cameras: Cameras, fitted: list[int]) -> Cameras:
        """The corrected cameras of all views; those not fitted get the shared correction alone."""
        shared, own = self.corrections(parameters)
        shared, own = (shared * self._shared_sd).cpu(), (own * self._own_sd).cpu()
        every = shared[:6].repeat(len(cameras), 1)
        every[fitted] += own
        return _correct(cameras, every, shared[6])

    def prior(self, parameters: Tensor) -> Tensor:
        """The negative logarithm of the prior: the mean over the views, and the shared part."""
        shared, own = self.corrections(parameters)
        return own.square().sum() / (2 * len(own)) + SHARED * shared.square().sum() / 2


class RefinementAdam(Adam):
    """Adam on the parameters of a refinement, without a drift of the perspective.

    Silhouettes hardly depend on the perspective, so its gradient is small and its sign random.
    Plain Adam scales it up to full steps, and correct cameras ended 1 % away in the mean, up to
    2.5 %. Here the perspective's gradient is scaled by the largest second moment of the shared
    corrections, so that it moves in proportion to them.
    """

    def scale(self, second: Tensor) -> Tensor:
        """The squared gradients [7 + 6 views], the perspective's replaced by the largest shared."""
        scaled = second.clone()
        scaled[PERSPECTIVE] = second[: PERSPECTIVE + 1].max()
        return scaled


def _correct(cameras: Cameras, own: Tensor, log_focal: Tensor) -> Cameras:
    """Rotate and shift cameras by [views, 6], and scale focal length and distance."""
    turn = _rotate(own[:, :3])
    one = torch.ones_like(log_focal)
    scale = torch.stack([log_focal.exp(), log_focal.exp(), one])
    deepen = torch.stack([one, one, log_focal.exp()])
    t = (cameras.t + own[:, 3:]) * deepen
    return replace(cameras, K=cameras.K * scale, R=turn @ cameras.R, t=t)


def _rotate(w: Tensor) -> Tensor:
    """exp([w]x) of rotation vectors [..., 3] by Rodrigues' formula: [..., 3, 3].

    torch's own ``matrix_exp`` waits for a GPU's answers; and takes longer on the CPU.
    """
    angle = (w.square().sum(-1) + TINY).sqrt()[..., None, None]
    cross, half = _cross(w), angle / 2
    first, second = angle.sin() / angle, (half.sin() / half).square() / 2
    return torch.eye(3, dtype=w.dtype, device=w.device) + first * cross + second * cross @ cross


def _cross(w: Tensor) -> Tensor:
    """[w]x of [..., 3]: [..., 3, 3], with [w]x v = w x v."""
    x, y, z = w.unbind(-1)
    zero = torch.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return torch.stack(rows, dim=-1).reshape(*w.shape, 3)


def _similarities(cameras: Cameras) -> Tensor:
    """Derivatives of w and v of each view by a similarity of the world: [6 views, 7]."""
    count = len(cameras)
    turn = torch.cat([-cameras.R, torch.zeros_like(cameras.R)], dim=1)
    shift = torch.cat([torch.zeros_like(cameras.R), cameras.R], dim=1)
    scale = torch.cat([torch.zeros_like(cameras.t), cameras.t], dim=1).unsqueeze(2)
    return torch.cat([turn, shift, scale], dim=2).reshape(6 * count, 7)


def _without(directions: Tensor, others: Tensor) -> Tensor:
    """The matrix [k, k] that removes from combinations of directions [n, k] those in ``others``."""
    basis, coordinates = torch.linalg.qr(directions)
    u, cosines, _ = torch.linalg.svd(basis.mT @ _span(others))
    same = u[:, : len(cosines)][:, cosines > SAME]
    kept = torch.eye(len(u), dtype=u.dtype) - same @ same.mT
    return torch.linalg.solve(coordinates, kept @ coordinates)


def _span(directions: Tensor) -> Tensor:
    """An orthonormal basis [n, rank] of the span of directions [n, k]."""
    u, singular, _ = torch.linalg.svd(directions, full_matrices=False)
    return u[:, singular > 1e-6 * singular[0]]
