"""The renderer of a fit, by its name.

A renderer is a name in ``silmesh.settings.fit`` and the module of that name in ``silmesh.softras``,
with a function ``soft_silhouettes``, or ``path/to/file.py:function`` of a person's own.
"""

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

import torch
from torch import Tensor

from silmesh.errors import InputError
from silmesh.fitting.loop import NotFinite
from silmesh.own_code import ask, load, own_file
from silmesh.settings.fit import AUTO
from silmesh.softras import check_arguments, has_triton, soft_silhouettes
from silmesh.softras.tiles import Tiles, gather_tiles, soft_tiles

Renderer = Callable[..., Tensor]  # of points, faces, size and sigma, as soft_silhouettes is


def find_renderer(name: str) -> Renderer:
    """What renders soft silhouettes, as ``soft_silhouettes`` does, under a name.

    Args:
        name: ``auto``, which is ``soft_silhouettes``; a module of ``silmesh.softras``; or
            ``path/to/file.py:function``

    Raises:
        InputError: there is no such function of a person's own, or, as it renders, it fails or
            gives something else; or what the renderer needs is not installed
        NotFinite: as it renders, a person's own function gives alpha that is not finite
    """
    if name == AUTO:
        return soft_silhouettes
    if name == "gpu" and not has_triton():
        raise InputError(
            "fit.renderer: 'gpu' needs a library that is not installed: `pip install "
            "'silmesh[gpu]'`; or should be 'auto'"
        )
    own = load(name) if own_file(name) else None
    render = own or import_module(f"silmesh.softras.{name}").soft_silhouettes

    def checked(
        points: Tensor, faces: Tensor, size: tuple[int, int], sigma: float = 1e-4
    ) -> Tensor:
        size = check_arguments(points, faces, size, sigma)
        if own is None:
            return render(points, faces, size, float(sigma))
        alpha = ask(name, own, points, faces, size, float(sigma))
        _refuse_other(name, alpha, points, size)
        if not alpha.isfinite().all():
            raise NotFinite(f"{name}: gives alpha that is not finite")
        return alpha

    return checked


def find_tile_renderer(name: str) -> Renderer:
    """What renders soft silhouettes in tiles, as ``soft_tiles`` does, under a name.

    Of a renderer that knows no tiles whole images are rendered and cut.
    """
    if name in (AUTO, "cpu"):
        return soft_tiles
    if name == "gpu":
        return import_module("silmesh.softras.gpu").soft_tiles
    return partial(_cut_tiles, find_renderer(name))


def _cut_tiles(
    render: Renderer, points: Tensor, faces: Tensor, tiles: Tiles, sigma: float
) -> Tensor:
    return gather_tiles(render(points, faces, tiles.size, sigma=sigma), tiles)


def _refuse_other(name: str, alpha: Any, points: Tensor, size: tuple[int, int]) -> None:
    """Refuse what a person's own renderer gives if it is no alpha of these points."""
    shape = (len(points), *size)
    if not isinstance(alpha, Tensor):
        gives = type(alpha).__name__
    elif (alpha.shape, alpha.dtype, alpha.device) != (shape, points.dtype, points.device):
        gives = f"{alpha.dtype} {list(alpha.shape)} on {alpha.device}"
    elif points.requires_grad and torch.is_grad_enabled() and not alpha.requires_grad:
        gives = "what has no gradient with respect to the points"
    else:
        return
    raise InputError(
        f"{name}: gives {gives}; should give alpha, {points.dtype} {list(shape)} on "
        f"{points.device}, differentiable with respect to the points"
    )
