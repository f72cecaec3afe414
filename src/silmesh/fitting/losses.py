"""What the fit minimises: the soft IoU's complement, the Laplacian and the flatten term.

Vertices are gathered by ``index_select``, whose gradient adds up in one order. That of ``verts[i]``
adds atomically from 32,768 numbers on, in an order that changes from run to run.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from silmesh.fitting.flatten import flatten_on_cpu
from silmesh.fitting.laplacian import laplacian_on_cpu
from silmesh.geometry.edges import number_edges
from silmesh.settings.fit import FastWeights, Weights

EPS = 1e-6


class Losses(NamedTuple):
    """The loss of a step and the terms that it is the weighted sum of: numbers."""

    loss: Tensor
    iou_loss: Tensor
    laplacian: Tensor
    flatten: Tensor


class Objective:
    """The loss of both presets: the IoU loss, and the two smoothness terms times their weights.

    Args:
        faces: [faces, 3], as ``Laplacian`` and ``Flatten`` take them
        verts: how many vertices they have
        weights: of the two terms
    """

    def __init__(self, faces: Tensor, verts: int, weights: Weights | FastWeights):
        self._laplacian, self._flatten = Laplacian(faces, verts), Flatten(faces)
        self._weights = weights

    def __call__(
        self,
        verts: Tensor,
        alpha: Tensor,
        silhouettes: Tensor,
        weights: Tensor | None = None,
        known: Tensor | None = None,
    ) -> Losses:
        """The losses of vertices [verts, 3] and their rendering; see ``iou_loss``.

        Args:
            known: [views, height, width], 0 to 1, how much of each pixel its photograph shows, as
                silhouettes have to be multiplied by already; all of it if not given
        """
        alpha = alpha if known is None else alpha * known
        return self.sum(verts, iou_loss(alpha, silhouettes, weights))

    def sum(self, verts: Tensor, iou: Tensor) -> Losses:
        """The losses of vertices [verts, 3] whose IoU loss is known."""
        laplacian, flatten = self._laplacian(verts), self._flatten(verts)
        loss = iou + self._weights.laplacian * laplacian + self._weights.flatten * flatten
        return Losses(loss, iou, laplacian, flatten)


def iou_loss(alpha: Tensor, silhouettes: Tensor, weights: Tensor | None = None) -> Tensor:
    """1 - mean over the views of sum(p t) / (sum(p + t - p t) + 1e-6).

    Args:
        alpha: [views, height, width], rendered
        silhouettes: [views, height, width], 0 to 1; no gradient reaches them
        weights: [views] how much each view counts in the mean; all the same if not given
    """
    p, t = alpha.flatten(1), silhouettes.flatten(1)
    both, rendered = _Sums.apply(p, t)
    return complement(both, rendered, t.sum(1), weights)


def complement(
    both: Tensor, rendered: Tensor, shown: Tensor, weights: Tensor | None = None
) -> Tensor:
    """1 - mean over the views of the IoU, of what is rendered and shown, and both: [views]."""
    either = rendered + shown - both
    iou = both / (either + EPS)
    if weights is None:
        return 1 - iou.mean()
    return 1 - torch.linalg.vecdot(weights, iou) / (weights.sum() + EPS)


class _Sums(torch.autograd.Function):
    """sum(p t) and sum(p) of each row, with a gradient for p alone, written into one buffer."""

    @staticmethod
    def forward(ctx, p, t):
        ctx.save_for_backward(t)
        return torch.linalg.vecdot(p, t), p.sum(1)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, both, rendered):
        (t,) = ctx.saved_tensors
        return t.mul(both.unsqueeze(1)).add_(rendered.unsqueeze(1)), None


class Laplacian:
    """Sum over the vertices of |v - mean of v's neighbours|^2.

    Args:
        faces: [faces, 3] of a mesh in which every vertex has a neighbour
        verts: how many vertices it has
    """

    def __init__(self, faces: Tensor, verts: int):
        edges, _ = _number_edges(faces)
        both_ways = torch.cat([edges, edges.flip(1)])
        both_ways = both_ways[both_ways[:, 0].argsort(stable=True)]
        degree = torch.bincount(both_ways[:, 0], minlength=verts)
        self._from, self._to = both_ways.T.contiguous()
        self._starts = torch.cat([degree.new_zeros(1), degree.cumsum(0)])
        self._weight = (1 / degree.double())[self._from].unsqueeze(1)

    def __call__(self, verts: Tensor) -> Tensor:
        """The loss of vertices [verts, 3]."""
        if verts.device.type == "cpu":
            return laplacian_on_cpu(verts, self._starts, self._to)
        return self.in_torch(verts)

    def in_torch(self, verts: Tensor) -> Tensor:
        """The same in plain torch, on any device."""
        neighbours = verts.index_select(0, self._to) * self._weight.to(verts)
        mean = torch.zeros_like(verts).index_add(0, self._from, neighbours)
        return (verts - mean).square().sum()


class Flatten:
    """Sum over the edges of (cos + 1)^2, with the angle between the faces about the edge.

    For the edge ab of the triangles abc and abd, the angle is that between c and d seen along
    the edge, so a flat pair has cos = -1 and no loss (SoftRas's flatten loss):

          c
         / \\
        a---b
         \\ /
          d

    Args:
        faces: [faces, 3] of a mesh whose edges each have two faces; others are left out
    """

    def __init__(self, faces: Tensor):
        self._diamonds = edge_diamonds(faces)
        self._corners = self._diamonds.T.flatten()

    def __call__(self, verts: Tensor) -> Tensor:
        """The loss of vertices [verts, 3]."""
        if verts.device.type == "cpu":
            return flatten_on_cpu(verts, self._diamonds, EPS)
        return self.in_torch(verts)

    def in_torch(self, verts: Tensor) -> Tensor:
        """The same in plain torch, on any device."""
        corners = verts.index_select(0, self._corners).reshape(4, -1, 3)
        (a, b), opposite = corners[:2], corners[2:]
        across, length = _across(b - a, opposite - a)
        cos = torch.linalg.vecdot(*across) / (length[0] * length[1] + EPS)
        return (cos + 1).square().sum()


def _across(along: Tensor, side: Tensor) -> tuple[Tensor, Tensor]:
    """The part of each ``side`` [2, edges, 3] at right angles to ``along`` [edges, 3].

    Its length, [2, edges], comes second: |side| sin(angle) with SoftRas's small terms, which keep
    the gradient of a collapsed triangle finite.
    """
    dot = torch.linalg.vecdot(along, side)
    along2, side2 = along.square().sum(-1), side.square().sum(-1)
    cos = dot / ((along2 + EPS).sqrt() * (side2 + EPS).sqrt() + EPS)
    length = (side2 + EPS).sqrt() * (1 - cos.square() + EPS).sqrt()
    return side - along * (dot / (along2 + EPS)).unsqueeze(-1), length


def edge_diamonds(faces: Tensor) -> Tensor:
    """The four corners a, b, c, d about every edge ab that two triangles abc and abd share.

    Args:
        faces: [faces, 3]
    Returns:
        [edges, 4]
    """
    around = torch.cat([faces, faces.roll(-1, dims=1), faces.roll(-2, dims=1)])  # a, b, opposite
    edges, of_face = _number_edges(faces)
    which = of_face.T.flatten()
    count = which.bincount()
    order = which.argsort(stable=True)
    first = count.cumsum(0) - count
    shared = count == 2
    c, d = (around[order[first[shared] + i], 2] for i in (0, 1))
    return torch.cat([edges[shared], c.unsqueeze(1), d.unsqueeze(1)], dim=1)


def _number_edges(faces: Tensor) -> tuple[Tensor, Tensor]:
    """``number_edges`` on the device of the faces."""
    edges, of_face = number_edges(faces.cpu().numpy())
    return torch.from_numpy(edges).to(faces.device), torch.from_numpy(of_face).to(faces.device)
