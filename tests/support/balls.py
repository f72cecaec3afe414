"""Photographs of a painted ball, each pixel's colour that of the point that its ray meets."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from silmesh.cameras.turntable import turntable_cameras
from silmesh.geometry.camera import Cameras
from silmesh.views import View, place_view

RADIUS, SIZE, LARGE = 0.4, 48, 192  # pixels of the working images and of the photographs
GROUND = 20


def colours_at(points: np.ndarray) -> np.ndarray:
    """Of points [n, 3] on the ball: [n, 3] of 0 to 255, stripes among them."""
    x, y, z = (points / RADIUS).T
    stripes = 30 * np.sin(8 * x) * np.sin(8 * z)
    return np.stack([130 + 80 * x + stripes, 130 + 80 * y, 130 + 80 * z - stripes], axis=1)


def photograph_ball(folder: Path, count: int) -> tuple[Cameras, list[View], np.ndarray]:
    """Photographs in a folder: the cameras of the working images, views, silhouettes in these."""
    named = [f"v{i}" for i in range(count)]
    files = [folder / f"{name}.png" for name in named]
    large = turntable_cameras(named, LARGE, 2.732, 15.0, 360 / count)
    for i, file in enumerate(files):
        Image.fromarray(draw(large, i, colours_at)).save(file)
    views = [
        place_view(name, str(file), LARGE, LARGE, SIZE, "pad")
        for name, file in zip(named, files, strict=True)
    ]
    cameras = turntable_cameras(named, SIZE, 2.732, 15.0, 360 / count)
    return cameras, views, np.stack([meet(cameras, i)[0] for i in range(count)])


def draw(cameras: Cameras, i: int, paint: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """The i-th photograph, [height, width, 3] uint8, of a ball whose points have this paint."""
    shown, points = meet(cameras, i)
    image = np.full((*shown.shape, 3), GROUND, np.uint8)
    image[shown] = paint(points).round().clip(0, 255)
    return image


def meet(cameras: Cameras, i: int) -> tuple[np.ndarray, np.ndarray]:
    """Which pixels see the ball [height, width], and where these meet it [n, 3]."""
    width, height = cameras.sizes[i].tolist()
    v, u = np.mgrid[:height, :width] + 0.5
    K, R, eye = (np.asarray(part[i]) for part in (cameras.K, cameras.R, cameras.centres))
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(K).T @ R
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    half_b = rays @ eye
    inside = half_b**2 - (eye @ eye - RADIUS**2)
    shown = inside > 0
    far = -half_b[shown] - np.sqrt(inside[shown])
    return shown, eye + far[:, None] * rays[shown]
