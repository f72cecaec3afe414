"""The procedure of each preset.

A preset is a model in ``silmesh.settings.fit`` and the module of its name in this package, or
``path/to/file.py:function`` of a person's own, which is told ``silmesh.settings.fit.OwnFit``.
"""

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

from torch import Tensor, int64

from silmesh.errors import InputError
from silmesh.fitting.loop import Procedure
from silmesh.geometry.camera import Cameras
from silmesh.own_code import ask, call, own_file

PARTS = ("verts", "faces", "done", "halvings", "step", "correct", "state", "restore")


def find_procedure(preset: str) -> Callable[..., Procedure]:
    """The class that a preset's module names as its ``PROCEDURE``; only this module is loaded.

    It is called with an initial mesh's vertices and faces, cameras, silhouettes, the preset's
    settings, the views' weights or None and, where some pixels do not count, which do.
    So is a person's own function, or class, without the latter.

    Raises:
        InputError: as it is called, a person's own function fails or gives something else
    """
    if own_file(preset):
        return partial(_make_own, preset)
    return import_module(f"silmesh.fitting.{preset}").PROCEDURE


def _make_own(preset: str, *parts: Any) -> Procedure:
    made = call(preset, *parts)
    lacking = [name for name in PARTS if not ask(preset, hasattr, made, name)]
    if lacking:
        raise InputError(
            f"{preset}: gives {type(made).__name__}, which lacks {', '.join(lacking)}; should give "
            "a silmesh.fitting.loop.Procedure"
        )
    _refuse_mesh(preset, made)
    return made


def refuse_result(preset: str, fit: Procedure, steps: int, corrected: Any, views: int) -> None:
    """Refuse what a person's own procedure ends with if that is no fit.

    Args:
        preset: passes if it is one of ours
        fit: that has ended
        steps: that it took
        corrected: what its ``correct`` gave for the cameras of so many views

    Raises:
        InputError: it is so
    """
    if own_file(preset) is None:
        return
    if not steps:
        raise InputError(f"{preset}: is done before a step; should take one or more")
    _refuse_mesh(preset, fit)
    count = len(corrected) if isinstance(corrected, Cameras) else None
    if count != views:
        gives = type(corrected).__name__ if count is None else f"{count} cameras"
        raise InputError(
            f"{preset}: its correct gives {gives}; should give Cameras of all {views} views"
        )


def _refuse_mesh(preset: str, fit: Procedure) -> None:
    """Refuse vertices or faces that make no mesh."""
    verts = _read(preset, fit, "verts", "float [verts, 3]")
    faces = _read(preset, fit, "faces", "int64 [faces, 3]")
    if not verts.is_floating_point() or verts.requires_grad or not verts.isfinite().all():
        raise InputError(
            f"{preset}: has verts, {verts.dtype}{', with a gradient' * verts.requires_grad}; "
            "should have finite floats, detached"
        )
    if faces.dtype != int64 or not len(faces) or faces.min() < 0 or faces.max() >= len(verts):
        raise InputError(
            f"{preset}: has {len(faces)} faces, {faces.dtype}; should have one or more, int64, "
            f"which number vertices from 0 to {len(verts) - 1}"
        )


def _read(preset: str, fit: Procedure, name: str, shape: str) -> Tensor:
    """The vertices or faces, if they are a tensor of rows of three."""
    found = ask(preset, getattr, fit, name)
    if not isinstance(found, Tensor) or found.ndim != 2 or found.shape[1] != 3:
        gives = list(found.shape) if isinstance(found, Tensor) else type(found).__name__
        raise InputError(f"{preset}: has {gives}; should have {name}, {shape}, a tensor")
    return found
