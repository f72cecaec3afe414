"""The procedure of each preset.

A preset is a model in ``silmesh.settings.fit`` and the module of its name in this package, or
``path/to/file.py:function`` of a person's own, which is told ``silmesh.settings.fit.OwnFit``.
"""

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

from torch import Tensor

from silmesh.errors import InputError
from silmesh.fitting.loop import Procedure
from silmesh.own_code import ask, call, own_file

PARTS = ("verts", "faces", "done", "halvings", "step", "correct", "state", "restore")


def find_procedure(preset: str) -> Callable[..., Procedure]:
    """The class that a preset's module names as its ``PROCEDURE``; only this module is loaded.

    It is called with an initial mesh's vertices and faces, cameras, silhouettes, the preset's
    settings, the views' weights or None and, where frames cut silhouettes, the pixels that count.
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
    for name, shape in {"verts": "float [verts, 3]", "faces": "int64 [faces, 3]"}.items():
        _refuse_other(preset, f"{name}, {shape}", ask(preset, getattr, made, name))
    return made


def _refuse_other(preset: str, should: str, found: Any) -> None:
    """Refuse vertices or faces that are no tensor of rows of three."""
    if not isinstance(found, Tensor) or found.ndim != 2 or found.shape[1] != 3:
        gives = list(found.shape) if isinstance(found, Tensor) else type(found).__name__
        raise InputError(f"{preset}: has {gives}; should have {should}, a tensor")
