"""Our own fit: from coarse to fine, by smooth steps, with the cameras refined alongside.

What is counted in pixels is so in those of the level that is fitted, whose images are 1/2^k of the
working images. A step sees one batch of views, spread evenly; a round is some of each batch. When
a round's loss is hardly lower than that of the one before, steps are halved; when they have been
halved often enough, the level is done.
"""

import math
from copy import deepcopy

import numpy as np
import torch
from torch import Tensor

from silmesh.cameras.camera import FIRST_SCALE, Cameras
from silmesh.fitting.cameras import Refinement, RefinementAdam
from silmesh.fitting.levels import Level, levels_of
from silmesh.fitting.loop import refuse_not_finite
from silmesh.fitting.losses import Flatten, Laplacian, iou_loss
from silmesh.fitting.place import place
from silmesh.fitting.smooth import Smooth, UniformAdam
from silmesh.fitting.untangle import untangle
from silmesh.remesh import even_length, remesh
from silmesh.settings.fit import FastFit
from silmesh.softras import soft_silhouettes

PRIOR = 0.01  # weight of the cameras' prior
CAMERA_STEP = 0.1  # of Adam's first steps, in the prior's standard deviations
CAMERA_BETAS = (0.9, 0.99)
NEAR = 0.25  # loss of a round from which on the mesh tells something about the cameras
LEVELLED = 0.01  # a round that lowers the loss by a smaller share than this halves the steps
HALVINGS = 5  # of the steps: with the last the finest level is done
COARSE_HALVINGS = 3  # the same of the others, which the finer ones improve on
ROUND = 6  # steps of a round at least
STRETCHED = 0.35  # standard deviation of the edges' lengths over their mean that asks for new edges
FINER = 0.7  # mean of the edges over their wished length that does so, too
SHORTEST = 1.0  # pixels of the working images: no edge is wished shorter
REMESH_PASSES = 3
APART = 0.1  # pixels of the working images between two sides that had passed through each other


class Fast:
    """Deform a mesh until its silhouettes match the given ones.

    Args:
        template: [verts, 3] float32, a first mesh at unit size (it is halved)
        faces: [faces, 3] int64, closed
        cameras: of the views, in the normalised world
        silhouettes: [views, height, width] float32, 0 or 1
        settings: of the procedure; their ``holdout`` and ``device`` are the caller's
        weights: [views] how much each view counts; all the same if not given
    """

    def __init__(
        self,
        template: Tensor,
        faces: Tensor,
        cameras: Cameras,
        silhouettes: Tensor,
        settings: FastFit,
        weights: Tensor | None = None,
    ):
        self._told, self._weights = settings, weights
        sigma = settings.sigma_at(silhouettes.shape[-1])
        self._levels = levels_of(cameras, silhouettes, sigma, settings.coarse_to_fine)
        self._batches = math.ceil(len(cameras) / (settings.batch or len(cameras)))
        self._round = self._batches * math.ceil(ROUND / self._batches)
        self._refinement = Refinement(cameras)
        self._corrections = self._refinement.start().requires_grad_()
        self._adam = RefinementAdam([self._corrections], CAMERA_BETAS)
        self._count = len(faces)
        self._steps, self.halvings, self._near = 0, 0, False
        self._take_mesh(place(template / FIRST_SCALE, cameras, silhouettes.cpu()), faces)
        self._enter(0)
        self._even_out()

    @property
    def done(self) -> bool:
        """Whether the last level is done, or no step is left."""
        return self._level == len(self._levels) or self._steps == self._told.iterations

    @property
    def verts(self) -> Tensor:
        """The vertices [verts, 3]."""
        return self._smooth(self._u).detach()

    def correct(self, cameras: Cameras, fitted: list[int]) -> Cameras:
        """Cameras of all views, those at the positions ``fitted`` fitted, as the mesh has them."""
        if not self._told.refine_cameras:
            return cameras
        return self._refinement.all_of(self._corrections.detach(), cameras, fitted)

    def step(self) -> list[float]:
        """A step on a batch of views."""
        told, level = self._told, self._levels[self._level]
        index, verts = self._choose(), self._smooth(self._u)
        cameras = level.see(self._cameras(index))
        seen = level.silhouettes[index]
        alpha = soft_silhouettes(
            cameras.project(verts), self.faces, tuple(seen.shape[1:]), sigma=level.sigma
        )
        weights = None if self._weights is None else self._weights[index]
        terms = [
            iou_loss(alpha, seen, weights),
            *(term(verts) for term in self._smoothness),
        ]
        loss = terms[0] + told.weights.laplacian * terms[1] + told.weights.flatten * terms[2]
        losses = refuse_not_finite(torch.stack([loss, *terms]).tolist())
        self._move(loss, level)
        self._count_round(losses[0])
        if self.done and told.untangle:
            self._untangle()
        return losses

    def _cameras(self, index: list[int]) -> Cameras:
        if self._near:
            return self._refinement(self._corrections, index)
        return self._refinement.cameras.select(index)

    def _choose(self) -> list[int]:
        """The views of this step: every n-th, in an order of the rounds' own."""
        number, place = divmod(self._steps, self._batches)
        order = np.random.default_rng([self._told.seed, number]).permutation(self._batches)
        return list(range(order[place], len(self._refinement.cameras), self._batches))

    def _move(self, loss: Tensor, level: Level) -> None:
        """A step of the vertices and the cameras."""
        share = 0.5 ** (self.halvings + self._slowed)
        self._u.grad = self._corrections.grad = None
        (loss + PRIOR * self._refinement.prior(self._corrections)).backward()
        refuse_not_finite([], self._u.grad, self._corrections.grad)
        length = self._told.learning_rate * level.pixel * share
        with torch.no_grad():
            self._u -= length * self._mover.direction(self._u.grad)
        if self._near:
            self._adam.step(CAMERA_STEP * share)
        refuse_not_finite([], self._u, self._corrections)
        self._steps += 1

    def _count_round(self, loss: float) -> None:
        """At a round's end: new edges if they are stretched, shorter steps if it has levelled."""
        self._losses.append(loss)
        if len(self._losses) < self._round:
            return
        mean, self._losses = sum(self._losses) / self._round, []
        if mean > self._before * (1 - LEVELLED):  # a loss that falls after a jump has not levelled
            self._slowed += 1
        self._before = mean
        self._near |= self._told.refine_cameras and mean < NEAR
        finest = self._level == len(self._levels) - 1
        if self._slowed >= (HALVINGS if finest else COARSE_HALVINGS):
            self._enter(self._level + 1)
        self._even_out()

    def _enter(self, level: int) -> None:
        self._level, self._slowed, self._before, self._losses = level, 0, math.inf, []

    def _even_out(self) -> None:
        """Give the mesh new edges if they have become uneven."""
        if not self._told.remesh or self.done:
            return
        verts = self.verts
        edges = (verts[self.faces] - verts[self.faces.roll(-1, 1)]).norm(dim=2)
        old = verts.double().cpu().numpy(), self.faces.cpu().numpy()
        length = max(even_length(*old, self._count), SHORTEST * self._levels[-1].pixel)
        if edges.std() > STRETCHED * edges.mean() or edges.mean() < FINER * length:
            new = remesh(*old, length, REMESH_PASSES)
            verts, faces = (torch.from_numpy(part).to(self.faces.device) for part in new)
            self._take_mesh(verts.float(), faces)

    def _untangle(self) -> None:
        old = self.verts.double().cpu().numpy()
        new = untangle(old, self.faces.cpu().numpy(), APART * self._levels[-1].pixel)
        if new is not old:
            self._take_mesh(torch.from_numpy(new).float().to(self.faces.device), self.faces)

    def _take_mesh(self, verts: Tensor, faces: Tensor) -> None:
        self._take_faces(faces, len(verts))
        self._u = self._smooth.parameters(verts).requires_grad_()
        self._mover = UniformAdam(self._u.detach(), self._told.betas)

    def _take_faces(self, faces: Tensor, count: int) -> None:
        self.faces = faces
        self._smooth = Smooth(faces, count, self._told.smoothing)
        self._smoothness = Laplacian(faces, count), Flatten(faces)

    def state(self) -> dict:
        """A copy of all that changes, and the number of ``steps`` that were taken."""
        return deepcopy(
            {
                "steps": self._steps,
                "halvings": self.halvings,
                "level": [self._level, self._slowed, self._before, self._losses],
                "near": self._near,
                "u": self._u.detach(),
                "faces": self.faces,
                "mover": self._mover.state(),
                "corrections": self._corrections.detach(),
                "adam": self._adam.state(),
            }
        )

    def restore(self, state: dict) -> None:
        """Go on from a state."""
        state = deepcopy(state)
        self._steps, self.halvings = state["steps"], state["halvings"]
        self._level, self._slowed, self._before, self._losses = state["level"]
        self._near = state["near"]
        if not torch.equal(self.faces, state["faces"]):
            self._take_faces(state["faces"], len(state["u"]))
        self._u = state["u"].requires_grad_()
        self._mover.restore(state["mover"])
        with torch.no_grad():
            self._corrections.copy_(state["corrections"])
        self._adam.restore(state["adam"])


PROCEDURE = Fast
