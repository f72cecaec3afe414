"""Soft rasterisation: silhouettes that are differentiable in the projected vertices.

``soft_silhouettes`` is the entry for fitting. Its equations are in ``silmesh.softras.reference``,
plain torch for any device and dtype; ``silmesh.softras.cpu`` and ``silmesh.softras.gpu`` hold the
fast kernels for float32 on the CPU and on a GPU, tested against it.
"""

import math
from functools import cache
from importlib.util import find_spec
from types import ModuleType

import torch
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

from silmesh.softras import cpu, reference

__all__ = ["check_arguments", "find_kernel", "has_triton", "soft_silhouettes"]


# Of faces that were checked: as they were then, and of how many points. A fit renders the same ones
# again and again, and a GPU would have to answer each time.
_KNOWN = WeakIdKeyDictionary()


def soft_silhouettes(
    points: Tensor, faces: Tensor, size: tuple[int, int], sigma: float = 1e-4
) -> Tensor:
    """Render soft silhouettes of a triangle mesh, seen as points in each view.

    Args:
        points: [views, verts, 2] pixels, x right and y down, pixel centres at integer + 0.5. A
            point that is not finite (it is behind the camera) leaves its faces out of that view.
        faces: [faces, 3] int64; either orientation
        size: height and width of the image in pixels
        sigma: how soft the edges are, in squared half-image units: distances are in pixels over
            half of the longer image side
    Returns:
        alpha [views, height, width] in [0, 1], of the dtype and on the device of ``points``;
        differentiable once with respect to ``points``
    Raises:
        ValueError: a shape, dtype, device, index or sigma that cannot be rendered
    """
    size = check_arguments(points, faces, size, sigma)
    return find_kernel(points).soft_silhouettes(points, faces, size, float(sigma))


def find_kernel(points: Tensor) -> ModuleType:
    """The fastest of the modules here that renders tensors of this dtype on this device."""
    if points.dtype == torch.float32 and points.device.type == "cpu":
        return cpu
    if points.dtype == torch.float32 and points.device.type == "cuda" and has_triton():
        from silmesh.softras import gpu  # and with it Triton, which takes a second

        return gpu
    return reference


@cache
def has_triton() -> bool:
    """Whether what compiles the kernel for a GPU is installed."""
    return find_spec("triton") is not None


def check_arguments(
    points: Tensor, faces: Tensor, size: tuple[int, int], sigma: float
) -> tuple[int, int]:
    """Height and width, if all that ``soft_silhouettes`` takes can be rendered.

    Raises:
        ValueError: it cannot
    """
    size = _check_size(size)
    _check_points(points)
    _check_faces(faces, points)
    if not (math.isfinite(sigma) and sigma > 0):
        raise ValueError(f"sigma should be a positive number, not {sigma}")
    return size


def _check_size(size: tuple[int, int]) -> tuple[int, int]:
    height, width = (int(side) for side in size)
    if height < 1 or width < 1:
        raise ValueError(f"size should be (height, width), each at least 1, not {tuple(size)}")
    return height, width


def _check_points(points: Tensor) -> None:
    if points.ndim != 3 or points.shape[2] != 2 or not points.is_floating_point():
        raise ValueError(
            f"points should be floating [views, verts, 2], not {points.dtype} {list(points.shape)}"
        )


def _check_faces(faces: Tensor, points: Tensor) -> None:
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype != torch.int64:
        raise ValueError(f"faces should be int64 [faces, 3], not {faces.dtype} {list(faces.shape)}")
    if faces.device != points.device:
        raise ValueError(f"faces are on {faces.device}, points on {points.device}")
    verts = points.shape[1]
    if not len(faces) or _KNOWN.get(faces) == (faces._version, verts):
        return
    if not (faces.min() >= 0 and faces.max() < verts):
        raise ValueError(
            f"faces should index {verts} points, from 0 to {verts - 1}, "
            f"not {int(faces.min())} to {int(faces.max())}"
        )
    _KNOWN[faces] = faces._version, verts
