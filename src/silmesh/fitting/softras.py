"""The report's fit, to the letter: every view in every step, Adam on all parameters."""

from copy import deepcopy

import torch
from torch import Tensor

from silmesh.fitting.adam import Adam
from silmesh.fitting.loop import read_finite
from silmesh.fitting.losses import Objective
from silmesh.fitting.parametrisation import OctantSigmoid
from silmesh.fitting.renderers import find_renderer
from silmesh.geometry.camera import Cameras
from silmesh.settings.fit import SoftRasFit


class SoftRas:
    """Deform a template until its soft silhouettes match the given ones.

    Args:
        template: [verts, 3] float32, at unit size (it is halved), on the device to fit on
        faces: [faces, 3] int64
        cameras: of the views, in the normalised world
        silhouettes: [views, height, width] float32, 0 or 1
        settings: of the procedure; their ``holdout`` and ``device`` are the caller's
        weights: [views] how much each view counts; all the same if not given
        known: [views, height, width], 0 or 1, the pixels of which each view says anything; all if
            not given

    Raises:
        InputError: the template does not fit the parametrisation
    """

    def __init__(
        self,
        template: Tensor,
        faces: Tensor,
        cameras: Cameras,
        silhouettes: Tensor,
        settings: SoftRasFit,
        weights: Tensor | None = None,
        known: Tensor | None = None,
    ):
        self._shape = OctantSigmoid(template)
        self._adam = Adam(self._shape.parameters(), settings.betas)
        self._cameras, self._weights, self._known = cameras.to(template.device), weights, known
        self._silhouettes = silhouettes if known is None else silhouettes * known
        self._settings, self._render = settings, find_renderer(settings.renderer)
        self._objective = Objective(faces, len(template), settings.weights)
        self._steps = 0
        self.faces, self.halvings = faces, 0

    @property
    def done(self) -> bool:
        """Whether no step is left."""
        return self._steps == self._settings.iterations

    @property
    def verts(self) -> Tensor:
        """The vertices [verts, 3]."""
        return self._shape().detach()

    def correct(self, cameras: Cameras, fitted: list[int]) -> Cameras:
        """The cameras as they are."""
        return cameras

    def step(self) -> dict[str, float]:
        """A step of Adam."""
        verts, sigma = self._shape(), self._settings.sigma
        size = tuple(self._silhouettes.shape[1:])
        alpha = self._render(self._cameras.project(verts), self.faces, size, sigma=sigma)
        losses = self._objective(verts, alpha, self._silhouettes, self._weights, self._known)
        self._shape.zero_grad()
        losses.loss.backward()
        self._adam.step(self._settings.learning_rate * 0.5**self.halvings)
        self._steps += 1
        gradients = [parameter.grad for parameter in self._shape.parameters()]
        return read_finite(losses, *gradients, *self._shape.parameters())

    def state(self) -> dict:
        """A copy of all that changes."""
        return deepcopy(
            {
                "steps": self._steps,
                "halvings": self.halvings,
                "shape": dict(self._shape.named_parameters()),
                "adam": self._adam.state(),
            }
        )

    def restore(self, state: dict) -> None:
        """Go on from a state."""
        state = deepcopy(state)
        self._steps, self.halvings = state["steps"], state["halvings"]
        with torch.no_grad():
            for name, parameter in self._shape.named_parameters():
                parameter.copy_(state["shape"][name])
        self._adam.restore(state["adam"])


PROCEDURE = SoftRas
