"""The preset ``fast``: a fit over an image pyramid by smooth steps, with camera refinement.

The fit goes through the levels of an image pyramid from coarse to fine. Lengths in pixels are in
those of the current level, unless stated otherwise. Each step renders one batch of views, which
are spread evenly over all views; a round is a number of steps in which each batch occurs equally
often. If a round lowers the loss by little, the steps are halved. After a given number of such
halvings the fit goes on to the next level, or ends.

Levels of images of more than 256 pixels look at a band about the outlines alone
(``silmesh.fitting.band``), and each of them gives the mesh so many more triangles that these are
as large in pixels of the next finer one as they were, up to a limit.
"""

import math
from copy import deepcopy
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import torch
from torch import Tensor

from silmesh.fitting.band import Band, BandLevel, Hinges
from silmesh.fitting.camera_refinement import Refinement, RefinementAdam
from silmesh.fitting.image_pyramid import BASE, Images, PyramidLevel, build_levels
from silmesh.fitting.loop import read_finite
from silmesh.fitting.losses import Losses, Objective
from silmesh.fitting.placement import move_to_silhouettes
from silmesh.fitting.renderers import find_renderer, find_tile_renderer
from silmesh.fitting.smooth import Smooth, UniformAdam
from silmesh.fitting.untangle import untangle
from silmesh.geometry.camera import INITIAL_SCALE, Cameras, places
from silmesh.geometry.remeshing import even_length, remesh
from silmesh.settings.fit import FastFit, FastWeights

PRIOR = 0.01  # weight of the prior of the camera corrections in the loss
CAMERA_STEP = 0.1  # learning rate of the corrections, in standard deviations of their prior
CAMERA_BETAS = (0.9, 0.99)  # of Adam on the corrections
NEAR = 0.25  # the cameras are refined once the mean loss of a round is below this
LEVELLED = 0.01  # a round that lowers the mean loss by a smaller share halves the steps
HALVINGS = 5  # halvings of the steps after which the fit on the finest level ends
COARSE_HALVINGS = 3  # halvings after which a coarser level gives way to the next finer one
BAND_LEVELLED = 0.004  # as LEVELLED, of a band: each of its many vertices gains little in a round
ROUND = 6  # least number of steps in a round
# The mesh is remeshed if the standard deviation of its edge lengths over their mean exceeds
# STRETCHED, or if their mean is less than FINER times the target length.
STRETCHED = 0.35
FINER = 0.7
SHORTEST = 1.0  # pixels of the working images: least target length of an edge
REMESH_PASSES = 3  # passes of the remeshing
# Pixels of the working images that ``untangle`` leaves between two sides of a sheet that crossed.
APART = 0.1
AHEAD = 2  # a mesh is as fine as images suit that are so many times larger than its level's
REFINE_PASSES = 2  # passes of the remeshing that makes a mesh finer for the next level


@dataclass
class State:
    """Everything that changes from step to step, which is what a checkpoint holds.

    Attributes:
        faces: [faces, 3] int64
        u: [verts, 3] float64, the parameters of the vertices, as ``Smooth`` has them
        mover: the optimiser of ``u``
        corrections: parameters of the cameras, as ``Refinement`` takes them
        adam: the optimiser of ``corrections``
        steps: number of steps so far
        halvings: how many times the steps were halved because a number was not finite
        near: whether the mesh fits well enough for the cameras to be refined
        level: index of the current level of the pyramid; the number of levels at the end
        slowed: how many times the steps of this level were halved because its loss had levelled
        before: mean loss of the previous round
        losses: losses of the steps of this round so far
        seen: [verts, 3], the vertices about which the band of this level was found, if it was
        seen_by: the corrections of the cameras then
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
    seen: Tensor | None = None
    seen_by: Tensor | None = None


class Fast:
    """Deform a mesh until its silhouettes match the given ones.

    Args:
        template: [verts, 3] float32, an initial mesh at unit size (it is halved)
        faces: [faces, 3] int64, closed
        cameras: of the views, in the normalised world
        silhouettes: [views, height, width] float32, 0 or 1; or bool, if larger than 256 pixels
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
        self._settings, self._weights = settings, weights
        self._render = find_renderer(settings.renderer)
        self._render_tiles = find_tile_renderer(settings.renderer)
        images = Images(cameras, silhouettes, known)
        small = images.shrink(template.device)
        sigmas = tuple(settings.sigma_at(i.silhouettes.shape[-1]) for i in (images, small))
        self._levels = build_levels(images, small, sigmas, settings.coarse_to_fine)
        self._batches = math.ceil(len(cameras) / (settings.batch or len(cameras)))
        self._round = self._batches * math.ceil(ROUND / self._batches)
        self._refinement = Refinement(cameras, template.device)
        self._count, self._band = len(faces), None
        self._take_faces(faces, len(template))
        spoken = None if small.known is None else small.known.cpu()
        placed = move_to_silhouettes(
            template.cpu() / INITIAL_SCALE, small.cameras, small.silhouettes.cpu(), spoken
        )
        self._state = self._start(placed.to(template.device), faces)
        self._enter_level()
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
        """Whether the finest level is done, or all steps are taken."""
        state = self._state
        return state.level == len(self._levels) or state.steps == self._settings.iterations

    @property
    def verts(self) -> Tensor:
        """The vertices [verts, 3]."""
        return self._smooth(self._state.u).detach()

    def correct(self, cameras: Cameras, fitted: list[int]) -> Cameras:
        """The refined cameras of all views, of which those at positions ``fitted`` were fitted."""
        if not self._settings.refine_cameras:
            return cameras
        return self._refinement.all_of(self._state.corrections.detach(), cameras, fitted)

    def step(self) -> dict[str, float]:
        """Take a step on a batch of views."""
        level = self._levels[self._state.level]
        index, verts = self._choose(), self._smooth(self._state.u)
        points = level.scale_cameras(self._cameras(index)).project(verts)
        weights = None if self._weights is None else self._weights[places(index)]
        compare = self._compare_band if isinstance(level, BandLevel) else self._compare
        losses = compare(level, verts, points, index, weights)
        self._move(losses.loss, level)
        values = read_finite(losses, self._state.u.grad, self._state.u, self._state.corrections)
        self._count_round(values["loss"])
        if self.done and self._settings.untangle:
            self._untangle()
        return values

    def _compare(
        self,
        level: PyramidLevel,
        verts: Tensor,
        points: Tensor,
        index: range,
        weights: Tensor | None,
    ) -> Losses:
        """The losses by the whole images of the views at ``index``."""
        silhouettes = level.silhouettes[places(index)]
        alpha = self._render(points, self.faces, tuple(silhouettes.shape[1:]), sigma=level.sigma)
        known = None if level.known is None else level.known[places(index)]
        return self._objective(verts, alpha, silhouettes, weights, known)

    def _compare_band(
        self,
        level: BandLevel,
        verts: Tensor,
        points: Tensor,
        index: range,
        weights: Tensor | None,
    ) -> Losses:
        """The losses by the band about the outlines of the views at ``index``."""
        state = self._state
        if self._band is None and state.seen is not None:  # of a fit that was resumed
            self._band = self._find_band(level)
        if self._band is None or not self._band.holds(points.detach(), index):
            state.seen, state.seen_by = verts.detach(), state.corrections.detach().clone()
            self._band = self._find_band(level)
        alpha = self._render_tiles(points, self.faces, self._band.select(index), level.sigma)
        return self._objective.sum(verts, self._band.iou_loss(alpha, index, weights))

    def _find_band(self, level: BandLevel) -> Band:
        """The band about the mesh as it was last looked for, and the silhouettes."""
        state, every = self._state, list(range(len(self._refinement.cameras)))
        cameras = self._refinement.cameras
        cameras = self._refinement(state.seen_by, every) if state.near else cameras
        self._hinges = self._hinges or Hinges.of(self.faces)
        return Band(level, level.scale_cameras(cameras).project(state.seen), self._hinges)

    def _forget_band(self) -> None:
        self._band = self._state.seen = self._state.seen_by = None

    def _cameras(self, index: range) -> Cameras:
        if self._state.near:
            return self._refinement(self._state.corrections, index)
        return self._refinement.cameras.select(index)

    def _choose(self) -> range:
        """Positions of the views of this step: every n-th view, n batches in a random order."""
        number, position = divmod(self._state.steps, self._batches)
        order = np.random.default_rng([self._settings.seed, number]).permutation(self._batches)
        return range(order[position], len(self._refinement.cameras), self._batches)

    def _move(self, loss: Tensor, level: PyramidLevel) -> None:
        """Move the vertices and the cameras."""
        state = self._state
        share = 0.5 ** (state.halvings + state.slowed)
        state.u.grad = state.corrections.grad = None
        (loss + PRIOR * self._refinement.prior(state.corrections)).backward()
        length = self._settings.learning_rate * level.pixel * share
        with torch.no_grad():
            state.u -= length * state.mover.direction(state.u.grad)
        if state.near:
            state.adam.step(CAMERA_STEP * share)
        state.steps += 1

    def _count_round(self, loss: float) -> None:
        """At the end of a round, halve the steps if the loss has levelled, and remesh if needed."""
        state = self._state
        state.losses.append(loss)
        if len(state.losses) < self._round:
            return
        mean, state.losses = sum(state.losses) / self._round, []
        level = self._levels[state.level]
        levelled = BAND_LEVELLED if isinstance(level, BandLevel) else LEVELLED
        if mean > state.before * (1 - levelled):  # a loss that falls after a jump has not levelled
            state.slowed += 1
        state.before = mean
        state.near |= self._settings.refine_cameras and mean < NEAR
        finest = state.level == len(self._levels) - 1
        if state.slowed >= (HALVINGS if finest else COARSE_HALVINGS):
            state.level, state.slowed, state.before = state.level + 1, 0, math.inf
            self._enter_level()
        self._even_out()

    def _enter_level(self) -> None:
        """Make the mesh as fine as a level's band asks for."""
        if self.done or not isinstance(self._levels[self._state.level], BandLevel):
            return
        self._forget_band()
        old = self.verts.double().cpu().numpy(), self.faces.cpu().numpy()
        wanted = self._count_faces()
        if self._settings.remesh and wanted > len(self.faces):
            self._remesh(old, even_length(*old, wanted), REFINE_PASSES)
        else:
            self._take_faces(self.faces, len(old[0]))

    def _count_faces(self) -> int:
        """How many faces the mesh should have on this level: that suit the next finer one.

        Faces are then as large in its pixels as they were on the dense levels.
        """
        level = self._levels[self._state.level]
        if not isinstance(level, BandLevel):
            return self._count
        finer = (min(AHEAD * max(level.size), max(self._levels[-1].size)) / BASE) ** 2
        most = self._settings.vertices
        return max(self._count, int(min(self._count * finer, 2 * most)))

    def _remesh(self, old: tuple[np.ndarray, np.ndarray], length: float, passes: int) -> None:
        new = remesh(*old, length, passes)
        verts, faces = (torch.from_numpy(part).to(self.faces.device) for part in new)
        self._take_mesh(verts.float(), faces)

    def _even_out(self) -> None:
        """Remesh if the edges have become uneven or too short."""
        if not self._settings.remesh or self.done:
            return
        verts = self.verts
        edges = (verts[self.faces] - verts[self.faces.roll(-1, 1)]).norm(dim=2)
        old = verts.double().cpu().numpy(), self.faces.cpu().numpy()
        shortest = SHORTEST * min(self._levels[-1].pixel, self._levels[self._state.level].pixel)
        length = max(even_length(*old, self._count_faces()), shortest)
        if edges.std() > STRETCHED * edges.mean() or edges.mean() < FINER * length:
            self._remesh(old, length, REMESH_PASSES)

    def _untangle(self) -> None:
        old = self.verts.double().cpu().numpy()
        new = untangle(old, self.faces.cpu().numpy(), APART * self._levels[-1].pixel)
        if new is not old:
            self._take_mesh(torch.from_numpy(new).float().to(self.faces.device), self.faces)

    def _take_mesh(self, verts: Tensor, faces: Tensor) -> None:
        self._take_faces(faces, len(verts))
        self._forget_band()
        state, u = self._state, self._smooth.parameters(verts)
        state.faces, state.u, state.mover = faces, u.requires_grad_(), self._new_mover(u)

    def _take_faces(self, faces: Tensor, count: int) -> None:
        """Prepare what depends on the faces alone."""
        settings, self._hinges = self._settings, None  # of the faces, where a band is found
        self._smooth = Smooth(faces, count, settings.smoothing)
        self._objective = Objective(faces, count, self._weigh())

    def _weigh(self) -> FastWeights:
        """The weights of the smoothness terms on this level.

        The IoU loss of a pixel falls with the square of the images' size, and so does the Laplacian
        term of what is as large in pixels; the flatten term, of angles, does not, and is scaled.
        """
        weights, state = self._settings.weights, getattr(self, "_state", None)
        level = self._levels[min(state.level, len(self._levels) - 1) if state else 0]
        if not isinstance(level, BandLevel):
            return weights
        scale = (BASE / max(level.size)) ** 2
        return weights.model_copy(update={"flatten": weights.flatten * scale})

    def _new_mover(self, u: Tensor) -> UniformAdam:
        return UniformAdam(u.detach(), self._settings.betas)

    def state(self) -> dict:
        """A copy of each field of ``State``, in a form that a file can hold."""
        return deepcopy({f.name: _pack(getattr(self._state, f.name)) for f in fields(State)})

    def restore(self, state: dict) -> None:
        """Go on from a state."""
        kept = deepcopy(state)
        other = not torch.equal(self.faces, kept["faces"]) or self._state.level != kept["level"]
        for f in fields(State):
            here = getattr(self._state, f.name)
            setattr(self._state, f.name, _unpack(here, kept[f.name]))
        if other:  # what depends on faces and level
            self._take_faces(self.faces, len(self._state.u))
        self._band = None


def _pack(value: Any) -> Any:
    """A field in the form in which a checkpoint holds it."""
    if isinstance(value, Tensor):
        return value.detach()
    return value.state() if hasattr(value, "state") else value


def _unpack(here: Any, kept: Any) -> Any:
    """Restore a field; an optimiser and the tensors that it moves stay the same objects."""
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
