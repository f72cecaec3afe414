"""What readers of camera files share: checked numbers, rotations, pixel centres."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from silmesh.errors import InputError, explain, shorten
from silmesh.geometry.camera import LARGEST, WIDEST, Cameras
from silmesh.geometry.lens import Lens
from silmesh.reading import read_text

SLOPPY = 0.02  # by which R R^T of a file may differ from 1: two decimals
SKEW = 0.5  # pixels at the image's edge up to which a skew is left out of what is written
UNSAID = (0, 0)  # width and height, where a file gives none: its pixels are the photograph's


@dataclass(frozen=True)
class Camera:
    """One camera as a file gives it, in our convention.

    Attributes:
        name: of its image, as the file writes it
        size: width and height that its pixels are of, or ``UNSAID``
        K: [3, 3], pixel centres at integer + 0.5
        R: [3, 3], from world to camera; a reflection where the file's world is left-handed
        t: [3]
        lens: beyond K
    """

    name: str
    size: tuple[int, int]
    K: np.ndarray
    R: np.ndarray
    t: np.ndarray
    lens: Lens | None = None


def gather(cameras: Sequence[Camera]) -> Cameras:
    """Cameras in the file's order, named as it names them."""

    def stack(name: str) -> torch.Tensor:
        return torch.tensor(np.stack([getattr(c, name) for c in cameras]), dtype=torch.float64)

    return Cameras(
        tuple(c.name for c in cameras),
        torch.tensor([c.size for c in cameras]),
        stack("K"),
        stack("R"),
        stack("t"),
        tuple(c.lens for c in cameras),
    )


def intrinsics(
    focal: tuple[float, float], centre: tuple[float, float], where: str, skew: float = 0.0
) -> np.ndarray:
    """K from the focal lengths and the principal point in pixels.

    Raises:
        InputError: a number is not finite, or a focal length not positive
    """
    K = np.array([[focal[0], skew, centre[0]], [0, focal[1], centre[1]], [0, 0, 1]], np.float64)
    if not np.isfinite(K).all():
        raise InputError(
            f"{where}: the intrinsics should be finite numbers, not {shorten(K.tolist())}"
        )
    if K[0, 0] <= 0 or K[1, 1] <= 0:
        raise InputError(
            f"{where}: focal lengths {K[0, 0]:g} and {K[1, 1]:g} should be positive: a negative "
            "one mirrors the image. Where rows are counted from below, give fy and height - cy"
        )
    return K


def to_half(matrix: np.ndarray) -> np.ndarray:
    """K or P for pixel centres at integer + 0.5, from one for centres at integers."""
    return np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]]) @ matrix


def nearest_rotation(matrix: np.ndarray, where: str) -> np.ndarray:
    """The rotation, or in a left-handed world the reflection, that a matrix is, up to rounding.

    Raises:
        InputError: it is none
    """
    if not np.isfinite(matrix).all():
        raise InputError(f"{where}: the pose should be finite numbers, not {matrix.tolist()}")
    off = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
    det = float(np.linalg.det(matrix))
    if off > SLOPPY:
        raise InputError(
            f"{where}: R should be a rotation (R R^T = 1 to within {SLOPPY:g}, det R = +1); "
            f"R R^T is off by {off:.2g}, det R = {det:.4g}"
        )
    u, _, v = np.linalg.svd(matrix)
    return u @ v


def numbers(value: Any, shape: tuple[int, ...], where: str) -> np.ndarray:
    """An array of finite numbers of this shape, which a file may write as strings."""
    try:
        array = np.array(value, dtype=object).astype(np.float64)  # a long word makes none longer
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise InputError(
            f"{where}: should be numbers of shape {list(shape)}: {explain(error)}"
        ) from error
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(
            f"{where}: should be finite numbers of shape {list(shape)}, not "
            f"{shorten(array.tolist())}"
        )
    if np.abs(array).max(initial=0) > LARGEST:
        raise InputError(
            f"{where}: should be numbers up to {LARGEST:g}, not {shorten(array.tolist())}"
        )
    return array


def pixels(width: Any, height: Any, where: str) -> tuple[int, int]:
    """Width and height as a file gives them.

    Raises:
        InputError: one is not 1, 2, ...
    """
    size = numbers([width, height], (2,), f"{where}: width and height")
    if (size < 1).any() or (size > WIDEST).any() or (size != size.round()).any():
        raise InputError(
            f"{where}: width and height should be whole numbers from 1 to {WIDEST:,}, "
            f"not {size[0]:g} and {size[1]:g}"
        )
    return int(size[0]), int(size[1])


def read_lines(path: Path) -> list[str]:
    """The lines of a text file."""
    return read_text(path).splitlines()


def refuse_skew(cameras: Cameras, i: int) -> None:
    """Refuse a camera whose pixels are no rectangles, for a format that cannot say so."""
    K, height = cameras.K[i], float(cameras.sizes[i, 1])
    if (shift := float(abs(K[0, 1]) / K[1, 1]) * height / 2) > SKEW:
        raise InputError(
            f"view {cameras.views[i]!r}: its K has a skew of {float(K[0, 1]):.3g}, which moves "
            f"pixels by up to {shift:.2g}; the format has none"
        )
