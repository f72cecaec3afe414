"""Projection matrices P = K [R | t], with depth (u, v, 1) = P (X, 1): their cameras by RQ.

P is known up to a factor, so its sign is free: it is taken such that det R = +1 with the diagonal
of K positive (Hartley and Zisserman, section 6.2.4). Of a left-handed world, or of mirrored pixels,
what the cameras look at then comes out behind them: the silhouettes show it (``conventions``).
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.linalg import rq

from silmesh.cameras.formats.parsing import UNSAID, Camera
from silmesh.errors import InputError, shorten
from silmesh.geometry.camera import LARGEST

SINGULAR = 1e-9  # of the matrix's scale, below which the left 3x3 has no inverse


def decompose(P: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K [3, 3] with K[2, 2] = 1 and a positive diagonal, R [3, 3], t [3] of a matrix [3, 4].

    Raises:
        InputError: it is not finite, or its left 3x3 has no inverse
    """
    if not np.isfinite(P).all() or np.abs(P).max() > LARGEST:
        raise InputError(
            f"{where}: the matrix should be finite numbers up to {LARGEST:g}, not "
            f"{shorten(P.tolist())}"
        )
    M = P[:, :3]
    if abs(np.linalg.det(M)) <= SINGULAR * np.prod(np.linalg.norm(M, axis=1)):
        raise InputError(
            f"{where}: the left 3x3 of the matrix has no inverse (determinant "
            f"{np.linalg.det(M):.3g}), so it is no camera at a finite place; rows should be those "
            "of P = K [R | t]"
        )
    K, R = rq(M)
    signs = np.sign(np.diag(K))
    K, R = K * signs, signs[:, None] * R
    t = np.linalg.solve(K, P[:, 3])
    if np.linalg.det(R) < 0:
        R, t = -R, -t
    return K / K[2, 2], R, t


def cameras_of(matrices: Sequence[np.ndarray], names: Sequence[str], path: Path) -> list[Camera]:
    """Cameras of matrices [3, 4] for pixel centres at integer + 0.5.

    Raises:
        InputError: a matrix is no camera
    """
    cameras = []
    for P, name in zip(matrices, names, strict=True):
        K, R, t = decompose(P, f"{path}: {name}")
        cameras.append(Camera(name, UNSAID, K, R, t))
    return cameras
