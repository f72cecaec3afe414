"""Our own fit: from coarse to fine, by smooth steps, with the cameras refined alongside.

What is counted in pixels is so in those of the level that is fitted, whose images are 1/2^k of the
working images. A step sees one batch of views, spread evenly; a round is some of each batch. When
a round's loss is hardly lower than that of the one before, steps are halved; when they have been
halved often enough, the level is done.
"""

import math
from copy import deepcopy
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import torch
from torch import Tensor

from silmesh.fitting.camera_refinement import Refinement, RefinementAdam
from silmesh.fitting.image_pyramid import Level, levels_of
from silmesh.fitting.loop import refuse_not_finite
from silmesh.fitting.losses import Objective
from silmesh.fitting.placement import place
from silmesh.fitting.smooth import Smooth, UniformAdam
from silmesh.fitting.untangle import untangle
from silmesh.geometry.camera import FIRST_SCALE, Cameras
from silmesh.geometry.remeshing import even_length, remesh
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


@dataclass
class State:
    """All of a fit that changes from step to step, which is what a checkpoint keeps.

    Attributes:
        faces: [faces, 3] int64
        u: [verts, 3] float64, the parameters of the vertices, as ``Smooth`` has them
        mover: what moves them
        corrections: of the cameras, as ``Refinement`` has them
        adam: what moves these
        steps: how many were taken
        halvings: how many times steps were halved because a number was not finite
        near: whether the mesh is near enough to tell something about the cameras
        level: the one that is fitted; their number when the last is done
        slowed: how many times the level's steps were halved because its loss had levelled
        before: mean loss of the round before
        losses: of this round's steps so far
    """

    faces: Tensor
    u: Tensor
    mover: UniformAdam
    corrections: Tensor
    adam: RefinementAdam
    steps: int = 0
    halvings: int = 0
    near: bool = False
    level: int = 0
    slowed: int = 0
    before: float = math.inf
    losses: list[float] = field(default_factory=list)


class Fast:
    """Deform a mesh until its silhouettes match the given ones.

    Args:
        template: [verts, 3] float32, an initial mesh at unit size (it is halved)
        faces: [faces, 3] int64, closed
        cameras: of the views, in the normalised world
        silhouettes: [views, height, width] float32, 0 or 1
        settings: of the procedure; their ``holdout`` and ``device`` are the caller's
        weights: [views] how much each view counts; all the same if not given
        known: [views, height, width], 0 or 1, the pixels of which each view says anything; all if
            not given
    """

    def __init__(
        self,
        template: Tensor,
        faces: Tensor,
        cameras: Cameras,
        silhouettes: Tensor,
        settings: FastFit,
        weights: Tensor | None = None,
        known: Tensor | None = None,
    ):
        self._told, self._weights = settings, weights
        sigma = settings.sigma_at(silhouettes.shape[-1])
        self._levels = levels_of(cameras, silhouettes, sigma, settings.coarse_to_fine, known)
        self._batches = math.ceil(len(cameras) / (settings.batch or len(cameras)))
        self._round = self._batches * math.ceil(ROUND / self._batches)
        self._refinement = Refinement(cameras)
        self._count = len(faces)
        self._take_faces(faces, len(template))
        spoken = None if known is None else known.cpu()
        placed = place(template / FIRST_SCALE, cameras, silhouettes.cpu(), spoken)
        self._state = self._start(placed, faces)
        self._even_out()

    def _start(self, verts: Tensor, faces: Tensor) -> State:
        u, corrections = self._smooth.parameters(verts), self._refinement.start().requires_grad_()
        mover, adam = self._new_mover(u), RefinementAdam([corrections], CAMERA_BETAS)
        return State(faces, u.requires_grad_(), mover, corrections, adam)

    @property
    def faces(self) -> Tensor:
        """The faces [faces, 3]."""
        return self._state.faces

    @property
    def halvings(self) -> int:
        """How many times steps were halved because a number was not finite."""
        return self._state.halvings

    @halvings.setter
    def halvings(self, count: int) -> None:
        self._state.halvings = count

    @property
    def done(self) -> bool:
        """Whether the last level is done, or no step is left."""
        state = self._state
        return state.level == len(self._levels) or state.steps == self._told.iterations

    @property
    def verts(self) -> Tensor:
        """The vertices [verts, 3]."""
        return self._smooth(self._state.u).detach()

    def correct(self, cameras: Cameras, fitted: list[int]) -> Cameras:
        """Cameras of all views, those at the positions ``fitted`` fitted, as the mesh has them."""
        if not self._told.refine_cameras:
            return cameras
        return self._refinement.all_of(self._state.corrections.detach(), cameras, fitted)

    def step(self) -> dict[str, float]:
        """A step on a batch of views."""
        level = self._levels[self._state.level]
        index, verts = self._choose(), self._smooth(self._state.u)
        cameras = level.see(self._cameras(index))
        seen = level.silhouettes[index]
        alpha = soft_silhouettes(
            cameras.project(verts), self.faces, tuple(seen.shape[1:]), sigma=level.sigma
        )
        weights = None if self._weights is None else self._weights[index]
        known = None if level.known is None else level.known[index]
        losses = self._objective(verts, alpha, seen, weights, known)
        values = refuse_not_finite(losses.read())
        self._move(losses.loss, level)
        self._count_round(values["loss"])
        if self.done and self._told.untangle:
            self._untangle()
        return values

    def _cameras(self, index: list[int]) -> Cameras:
        if self._state.near:
            return self._refinement(self._state.corrections, index)
        return self._refinement.cameras.select(index)

    def _choose(self) -> list[int]:
        """The views of this step: every n-th, in an order of the rounds' own."""
        number, place = divmod(self._state.steps, self._batches)
        order = np.random.default_rng([self._told.seed, number]).permutation(self._batches)
        return list(range(order[place], len(self._refinement.cameras), self._batches))

    def _move(self, loss: Tensor, level: Level) -> None:
        """A step of the vertices and the cameras."""
        state = self._state
        share = 0.5 ** (state.halvings + state.slowed)
        state.u.grad = state.corrections.grad = None
        (loss + PRIOR * self._refinement.prior(state.corrections)).backward()
        refuse_not_finite({}, state.u.grad, state.corrections.grad)
        length = self._told.learning_rate * level.pixel * share
        with torch.no_grad():
            state.u -= length * state.mover.direction(state.u.grad)
        if state.near:
            state.adam.step(CAMERA_STEP * share)
        refuse_not_finite({}, state.u, state.corrections)
        state.steps += 1

    def _count_round(self, loss: float) -> None:
        """At a round's end: new edges if they are stretched, shorter steps if it has levelled."""
        state = self._state
        state.losses.append(loss)
        if len(state.losses) < self._round:
            return
        mean, state.losses = sum(state.losses) / self._round, []
        if mean > state.before * (1 - LEVELLED):  # a loss that falls after a jump has not levelled
            state.slowed += 1
        state.before = mean
        state.near |= self._told.refine_cameras and mean < NEAR
        finest = state.level == len(self._levels) - 1
        if state.slowed >= (HALVINGS if finest else COARSE_HALVINGS):
            state.level, state.slowed, state.before = state.level + 1, 0, math.inf
        self._even_out()

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
        state, u = self._state, self._smooth.parameters(verts)
        state.faces, state.u, state.mover = faces, u.requires_grad_(), self._new_mover(u)

    def _take_faces(self, faces: Tensor, count: int) -> None:
        """What follows from the faces alone."""
        told = self._told
        self._smooth = Smooth(faces, count, told.smoothing)
        self._objective = Objective(faces, count, told.weights)

    def _new_mover(self, u: Tensor) -> UniformAdam:
        return UniformAdam(u.detach(), self._told.betas)

    def state(self) -> dict:
        """A copy of all that changes, each field of ``State``, as what a file can hold."""
        return deepcopy({f.name: _pack(getattr(self._state, f.name)) for f in fields(State)})

    def restore(self, state: dict) -> None:
        """Go on from a state."""
        kept = deepcopy(state)
        if not torch.equal(self.faces, kept["faces"]):
            self._take_faces(kept["faces"], len(kept["u"]))
        for f in fields(State):
            here = getattr(self._state, f.name)
            setattr(self._state, f.name, _unpack(here, kept[f.name]))


def _pack(value: Any) -> Any:
    """What a checkpoint holds of a field."""
    if isinstance(value, Tensor):
        return value.detach()
    return value.state() if hasattr(value, "state") else value


def _unpack(here: Any, kept: Any) -> Any:
    """A field as it was; an optimiser and what it moves stay the objects that they are."""
    if hasattr(here, "restore"):
        here.restore(kept)
        return here
    if not isinstance(here, Tensor) or not here.requires_grad:
        return kept
    if here.shape != kept.shape:
        return kept.requires_grad_()
    here.detach().copy_(kept)
    return here


PROCEDURE = Fast
