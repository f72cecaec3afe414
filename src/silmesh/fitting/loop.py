"""The loop around any fitting procedure: records, checkpoints, and undone steps."""

import math
import time
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from functools import partial
from numbers import Real
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from silmesh.errors import InputError, shorten
from silmesh.fitting.checkpoint import Checkpoint
from silmesh.geometry.camera import Cameras

TRIES = 6  # halvings of the steps after which a fit that meets infinite numbers fails
LABELS = {"iou_loss": "IoU loss", "laplacian": "Laplacian"}  # names of losses in messages
STRANGE = "a gradient or a vertex is not finite"
ADVICE = "A smaller learning_rate or a larger sigma may help"


@dataclass(frozen=True)
class Record:
    """The losses before a step, a row of ``loss.csv``; ``seconds`` since the fit began."""

    iteration: int
    loss: float
    iou_loss: float
    laplacian: float
    flatten: float
    seconds: float


LOSSES = {field.name for field in fields(Record)} - {"iteration", "seconds"}


class NotFinite(Exception):  # noqa: N818
    """A loss, a gradient or a vertex of a step is not finite; says which."""


class Procedure(Protocol):
    """A fit, a step at a time.

    Attributes:
        verts, faces: the mesh as it is, in the normalised world
        done: whether no step is left
        halvings: how many times its steps were halved
    """

    verts: Tensor
    faces: Tensor
    done: bool
    halvings: int

    def step(self) -> dict[str, float]:
        """Take a step; return the losses before it, as a record names them, or raise NotFinite."""

    def correct(self, cameras: Cameras, fitted: list[int]) -> Cameras:
        """Cameras of all views, those at the positions ``fitted`` fitted, as the mesh has them."""

    def state(self) -> dict:
        """A copy of all that changes, and the number of ``steps`` that were taken."""

    def restore(self, state: dict) -> None:
        """Go on from a state."""


def run(
    fit: Procedure,
    watch: Callable[[Record], None] = lambda record: None,
    checkpoint: Checkpoint | None = None,
) -> list[Record]:
    """Take all steps of a fit, from its checkpoint on if there is one.

    A step that meets a number that is not finite is taken back, with the one before, which led
    there; from then on steps are half as long.

    Returns:
        one record a step

    Raises:
        InputError: it meets such numbers although its steps were halved again and again
    """
    records = _go_on(fit, checkpoint)
    start = time.perf_counter() - (records[-1].seconds if records else 0)
    good = here = fit.state()
    while not fit.done:
        try:
            losses = fit.step()
        except NotFinite as error:
            _go_back(fit, good, f"step {len(records)} of the fit: {error}")
            del records[good["steps"] :]
            here = good
            continue
        _refuse_other(losses)
        seconds = time.perf_counter() - start
        records.append(Record(iteration=len(records), seconds=seconds, **losses))
        watch(records[-1])
        good, here = here, fit.state()
        if checkpoint:
            checkpoint.offer(partial(_gather, here, records))
    return records


def _refuse_other(losses: dict[str, float]) -> None:
    """Refuse other losses than a record has, as a procedure of a person's own may give."""
    if not isinstance(losses, dict) or losses.keys() != LOSSES:
        gives = ", ".join(losses) if isinstance(losses, dict) else type(losses).__name__
        raise InputError(
            f"fit.preset: a step gives {gives or 'nothing'}; should give "
            f"{', '.join(sorted(LOSSES))}"
        )
    for name, loss in losses.items():
        if not isinstance(loss, Real) or not math.isfinite(loss):
            raise InputError(
                f"fit.preset: a step gives {name} {shorten(loss)}; should give a finite number, or "
                "raise silmesh.fitting.loop.NotFinite"
            )


def _go_on(fit: Procedure, checkpoint: Checkpoint | None) -> list[Record]:
    """Resume from a checkpoint and return its records; an unusable one is ignored."""
    if not checkpoint or not (kept := checkpoint.read()):
        return []
    fresh = fit.state()
    try:
        fit.restore(kept["fit"])
        return [Record(*row) for row in kept["records"]]
    except Exception:  # of whatever kind: what lacks a part is as none
        fit.restore(fresh)
        return []


def _gather(state: dict, records: list[Record]) -> dict:
    """What a checkpoint keeps."""
    return {"fit": state, "records": [astuple(record) for record in records]}


def _go_back(fit: Procedure, good: dict, what: str) -> None:
    halvings = fit.halvings + 1
    if halvings > TRIES:
        raise InputError(f"{what}, although the steps were halved {TRIES} times. {ADVICE}")
    fit.restore(good)
    fit.halvings = halvings


def read_finite(losses: NamedTuple, *tensors: Tensor) -> dict[str, float]:
    """The values of the losses, by name, if they and all tensors are finite.

    All that has to be known of a step is asked of a GPU at once, which then works on meanwhile.

    Raises:
        NotFinite: they are not
    """
    finite = torch.stack([tensor.isfinite().all() for tensor in tensors]).all()
    *values, finite = torch.stack([*losses, finite.to(losses[0])]).tolist()
    refuse_not_finite(values := dict(zip(losses._fields, values, strict=True)))
    if not finite:
        raise NotFinite(STRANGE)
    return values


def refuse_not_finite(losses: dict[str, float], *tensors: Tensor) -> dict[str, float]:
    """The losses, by name, if they and all tensors are finite.

    Raises:
        NotFinite: they are not
    """
    if not all(map(math.isfinite, losses.values())):
        listed = ", ".join(f"{LABELS.get(name, name)} {value:g}" for name, value in losses.items())
        raise NotFinite(f"{listed}; a loss is not finite")
    if not all(tensor.isfinite().all() for tensor in tensors):
        raise NotFinite(STRANGE)
    return losses
