"""Projection matrices P = K [R | t], with depth (u, v, 1) = P (X, 1): their cameras by RQ.

P is known up to a factor, so its sign is free: it is taken such that det R = +1 with the diagonal
of K positive (Hartley and Zisserman, section 6.2.4). What cannot be mended is a matrix that mirrors
the image: then what the cameras look at comes out behind them.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.linalg import rq

from silmesh.cameras.camera import LARGEST
from silmesh.cameras.formats.parts import UNSAID, Camera
from silmesh.errors import InputError, shorten

SINGULAR = 1e-9  # of the matrix's scale, below which the left 3x3 has no inverse
PARALLEL = 1e-3  # mean squared sine of the angles between axes, below which they meet nowhere
MIRRORED = 0.5  # of the cameras with their middle behind them: the matrices mirror


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
        InputError: a matrix is no camera, or together they mirror
    """
    cameras = []
    for P, name in zip(matrices, names, strict=True):
        K, R, t = decompose(P, f"{path}: {name}")
        cameras.append(Camera(name, UNSAID, K, R, t))
    _refuse_mirrors(cameras, path)
    return cameras


def _refuse_mirrors(cameras: Sequence[Camera], path: Path) -> None:
    """Refuse cameras that turn their backs to the point where their axes meet."""
    R, t = np.stack([c.R for c in cameras]), np.stack([c.t for c in cameras])
    axes, centres = R[:, 2], -np.einsum("nji,nj->ni", R, t)
    across = np.eye(3) - axes[:, :, None] * axes[:, None]
    left = across.mean(axis=0)
    if np.linalg.eigvalsh(left)[0] < PARALLEL:
        return
    middle = np.linalg.solve(left, np.einsum("nij,nj->i", across, centres) / len(cameras))
    behind = int((((middle - centres) * axes).sum(axis=1) < 0).sum())
    if behind > MIRRORED * len(cameras):
        raise InputError(
            f"{path}: the matrices mirror: the point that the cameras look at lies behind "
            f"{behind} of {len(cameras)} of them, once det R = +1. Perhaps they count rows from "
            "below; then replace the second row of each P by height * (third row) - (second row)"
        )
