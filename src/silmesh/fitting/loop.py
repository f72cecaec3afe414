"""The report's fit, to the letter: every view in every step, Adam on all parameters."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from silmesh.cameras.camera import Cameras
from silmesh.errors import InputError
from silmesh.fitting.losses import Flatten, Laplacian, iou_loss
from silmesh.fitting.parametrisation import OctantSigmoid
from silmesh.softras import soft_silhouettes

ADVICE = "A smaller learning_rate or a larger sigma may help"


@dataclass(frozen=True)
class Settings:
    """What a fit is told.

    Attributes:
        iterations: steps of Adam
        learning_rate, betas: Adam's
        sigma: softness of the silhouettes, in squared half-image units
        laplacian, flatten: weights of the two smoothness terms
    """

    iterations: int
    learning_rate: float
    betas: tuple[float, float]
    sigma: float
    laplacian: float
    flatten: float


@dataclass(frozen=True)
class Record:
    """The losses before a step, a row of ``loss.csv``; ``seconds`` since the fit began."""

    iteration: int
    loss: float
    iou_loss: float
    laplacian: float
    flatten: float
    seconds: float


def fit(
    template: Tensor,
    faces: Tensor,
    cameras: Cameras,
    silhouettes: Tensor,
    settings: Settings,
    watch: Callable[[Record], None] = lambda record: None,
) -> tuple[Tensor, list[Record]]:
    """Deform a template until its soft silhouettes match the given ones.

    Args:
        template: [verts, 3] float32, at unit size (it is halved), on the device to fit on
        faces: [faces, 3] int64
        cameras: of the views, in the normalised world
        silhouettes: [views, height, width] float32, 0 or 1
        watch: called with the record of each step
    Returns:
        vertices [verts, 3] after the last step, and one record a step

    Raises:
        InputError: the template does not fit the parametrisation, or a loss or the last step's
            vertices are not finite
    """
    shape = OctantSigmoid(template)
    adam = torch.optim.Adam(shape.parameters(), settings.learning_rate, settings.betas)
    size = tuple(silhouettes.shape[1:])
    smoothness = Laplacian(faces, len(template)), Flatten(faces)
    records = []
    start = time.perf_counter()
    for i in range(settings.iterations):
        verts = shape()
        alpha = soft_silhouettes(cameras.project(verts), faces, size, sigma=settings.sigma)
        terms = [iou_loss(alpha, silhouettes), *(term(verts) for term in smoothness)]
        loss = terms[0] + settings.laplacian * terms[1] + settings.flatten * terms[2]
        values = torch.stack([loss, *terms]).tolist()
        _refuse_non_finite(values, i)
        records.append(Record(i, *values, time.perf_counter() - start))
        watch(records[-1])
        adam.zero_grad()
        loss.backward()
        adam.step()
    verts = shape().detach()
    if not verts.isfinite().all():
        raise InputError(f"step {settings.iterations} of the fit: a vertex is not finite. {ADVICE}")
    return verts, records


def _refuse_non_finite(values: list[float], iteration: int) -> None:
    if not all(math.isfinite(value) for value in values):
        named = zip(("loss", "IoU loss", "Laplacian", "flatten"), values, strict=True)
        raise InputError(
            f"step {iteration} of the fit: "
            + ", ".join(f"{name} {value:g}" for name, value in named)
            + f"; a loss is not finite. {ADVICE}"
        )
