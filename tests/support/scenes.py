"""Made-up scenes whose truth is a formula, shared by the tests."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from scipy.ndimage import gaussian_filter

from silmesh.cameras.turntable import orbit_cameras, turntable_cameras
from silmesh.geometry.camera import Cameras
from silmesh.geometry.lens import Lens


def names(count: int) -> list[str]:
    return [f"v{i}" for i in range(count)]


def turntable(count: int, size: int, elevation: float = 0.0) -> Cameras:
    """A whole turn of cameras at SoftRas's distance."""
    return turntable_cameras(names(count), size, 2.732, elevation, 360 / count)


def orbit(count: int, size: int, elevation: np.ndarray) -> Cameras:
    """A whole turn of cameras in even steps, each of an elevation [count] of its own."""
    turned = 360 / count * torch.arange(count, dtype=torch.float64)
    far = torch.full_like(turned, 2.732)
    return orbit_cameras(names(count), size, far, torch.as_tensor(elevation), turned)


def dome(count: int, size: int) -> Cameras:
    """Cameras all around: a spiral from above to below."""
    i = torch.arange(count, dtype=torch.float64)
    elevation = torch.rad2deg(torch.asin(1 - (2 * i + 1) / count))
    return orbit_cameras(names(count), size, torch.full_like(i, 2.732), elevation, 137.5 * i)


def behind_lenses(cameras: Cameras, lenses: Sequence[Lens | None]) -> Cameras:
    """The same cameras behind lenses, one for each view."""
    return replace(cameras, lenses=tuple(lenses))


def silhouettes(
    cameras: Cameras, axes: Sequence[float], centre: Sequence[float] = (0, 0, 0)
) -> np.ndarray:
    """Where the ray through each pixel's centre meets an ellipsoid: [views, height, width]."""
    width, height = cameras.sizes[0].tolist()
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    pixels = np.stack([u, v, np.ones_like(u)], axis=-1)
    seen = []
    for K, R, eye in zip(*map(np.asarray, (cameras.K, cameras.R, cameras.centres)), strict=True):
        along = (pixels @ np.linalg.inv(K).T @ R) / axes  # as a sphere of radius 1 sees it
        start = (eye - centre) / axes
        half_b, a = along @ start, (along**2).sum(axis=-1)
        seen.append((half_b**2 >= a * (start @ start - 1)) & (half_b < 0))
    return np.stack(seen)


def blotches(seed: int, size: tuple[int, int] = (320, 240)) -> np.ndarray:
    """A random picture, grey, with features of its own."""
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=size[::-1]), 3)
    return np.clip(128 + 60 * noise / noise.std(), 0, 255).astype(np.uint8)


def save(path: Path, pixels: np.ndarray, **options) -> Path:
    """Write an array, bool for a mask of 1 bit, as an image."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, **options)
    return path
