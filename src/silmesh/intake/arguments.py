"""Arguments of the Python API: what is of another kind than its annotation is refused by name."""

import inspect
from collections.abc import Callable, Collection, Mapping
from functools import wraps
from numbers import Integral
from types import NoneType, UnionType
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin

import numpy as np
import torch
import trimesh

from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras

P, R = ParamSpec("P"), TypeVar("R")
GIVERS = {  # the stage that gives what a later one takes
    "Photographs": "read_photographs",
    "Silhouettes": "find_silhouettes",
    "Scene": "find_cameras",
    "Initial": "initial_mesh",
    "Fitted": "fit",
}


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """A function that first refuses arguments of other kinds than its annotations.

    Raises:
        InputError: as it is called; names the argument, its type and what would be right
    """
    parameters = inspect.signature(function)
    kinds = {
        name: parameter.annotation
        for name, parameter in parameters.parameters.items()
        if parameter.kind is not parameter.VAR_KEYWORD and parameter.annotation is not Any
    }

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        for name, value in parameters.bind(*args, **kwargs).arguments.items():
            kind = kinds.get(name, parameters.empty)
            if kind is not parameters.empty and not _suits(value, kind):
                raise InputError(f"{name}: should be {_say(kind)}, not {_name(value)}")
        return function(*args, **kwargs)

    return call


def _suits(value: Any, kind: Any) -> bool:
    """Whether a value is of an annotation's kind; any collection does for a sequence."""
    origin, inside = get_origin(kind), get_args(kind)
    if kind is Any:
        return True
    if origin in (Union, UnionType):
        return any(_suits(value, one) for one in inside)
    if origin is Callable:
        return callable(value)
    if origin is None:
        return isinstance(value, Integral if kind is int else kind)
    if issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(
            _suits(part, one)
            for item in value.items()
            for part, one in zip(item, inside, strict=True)
        )
    several = isinstance(value, Collection) and not isinstance(value, str | bytes | Mapping)
    return several and all(_suits(part, inside[0]) for part in value)


def _say(kind: Any) -> str:
    """An annotation in words."""
    origin, inside = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return " or ".join(map(_say, inside))
    if origin is Callable:
        return "a function"
    if origin is not None and issubclass(origin, Mapping):
        return "a dictionary" + " of dictionaries" * (get_origin(inside[1]) is Mapping)
    if origin is not None:
        return f"several of {_say(inside[0])}"
    name = "None" if kind is NoneType else kind.__name__
    return f"{name}, as silmesh.{GIVERS[name]} gives" if name in GIVERS else name


def _name(value: Any) -> str:
    """The type of a value; of a list, which has several, also that of its first item."""
    several = isinstance(value, list | tuple) and len(value)
    return type(value).__name__ + (f" of {type(value[0]).__name__}" if several else "")


def refuse_cameras(cameras: Cameras) -> None:
    """Refuse cameras in memory whose parts do not belong together or are no numbers.

    Raises:
        InputError: it is so; names the part
    """
    views = len(cameras)
    shapes = {"sizes": (views, 2), "K": (views, 3, 3), "R": (views, 3, 3), "t": (views, 3)}
    for name, shape in shapes.items():
        part = getattr(cameras, name)
        if not isinstance(part, torch.Tensor) or tuple(part.shape) != shape:
            has = list(np.shape(part))
            raise InputError(
                f"cameras: {name}: should be a tensor {list(shape)}, of the {views} views, not "
                f"{type(part).__name__} {has}"
            )
        if not part.isfinite().all():
            raise InputError(f"cameras: {name}: should be finite")
    if len(cameras.lenses) != views:
        raise InputError(f"cameras: lenses: should be {views}, not {len(cameras.lenses)}")
    if not (cameras.K[:, [0, 1], [0, 1]] > 0).all():
        raise InputError("cameras: K: should have positive focal lengths")
    turned = cameras.R.double()
    if not torch.allclose(turned @ turned.mT, torch.eye(3).double(), atol=1e-3):
        raise InputError("cameras: R: should be rotations, from the world to the camera")


def refuse_array(name: str, found: Any, shape: tuple[int, ...], of: str) -> None:
    """Refuse what is no array of bool of this shape; ``of`` says what it should show."""
    if not isinstance(found, np.ndarray) or found.dtype != bool or found.shape != shape:
        gives = f"{found.dtype} {list(found.shape)}" if hasattr(found, "dtype") else type(found)
        raise InputError(f"{name}: should be bool {list(shape)}, {of}, not {gives}")


def refuse_empty_mesh(name: str, mesh: trimesh.Trimesh) -> None:
    """Refuse a mesh without faces, or with vertices that are no points."""
    if not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
        raise InputError(f"{name}: should be a mesh with faces, and finite vertices")
