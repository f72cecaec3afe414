"""Cameras that every format is tested with, and photographs they belong to."""

from collections.abc import Sequence

import numpy as np
import torch
from scenes import dome

from silmesh.geometry.camera import Cameras, Similarity
from silmesh.views import View, place_view

WIDTH, HEIGHT, SIZE = 640, 480, 64
NAMES = ("shot_1", "shot_2", "shot_10", "shot_11")
POINTS = np.array([5, -3, 2]) + np.random.default_rng(3).uniform(-20, 20, (50, 3))


def cameras() -> Cameras:
    """Of photographs of 640x480, off centre and with unequal focal lengths, in a world of mm."""
    K = torch.tensor([[700.0, 0, 331], [0, 690, 228], [0, 0, 1]], dtype=torch.float64)
    elsewhere = Similarity(-torch.tensor([5.0, -3, 2], dtype=torch.float64) / 60, 60.0)
    square = dome(len(NAMES), SIZE).in_world_of(elsewhere)
    sizes = torch.tensor([[WIDTH, HEIGHT]] * len(NAMES))
    return Cameras(NAMES, sizes, K.repeat(len(NAMES), 1, 1), square.R, square.t)


def views(
    names: Sequence[str] = NAMES, width: int = WIDTH, height: int = HEIGHT, resize: str = "pad"
) -> list[View]:
    """Photographs of these names, in working images of 64x64."""
    return [place_view(name, f"{name}.jpg", width, height, SIZE, resize) for name in names]


def to_working(pixels: np.ndarray) -> np.ndarray:
    """Photographs' pixels [..., 2] in the padded working images: 640x480 becomes 64x48."""
    return pixels / 10 + [0, 8]


def by_definition(K: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Where one camera sees POINTS, by z (u, v, 1) = K (R X + t): [points, 2]."""
    seen = (POINTS @ np.asarray(R).T + np.asarray(t)) @ np.asarray(K).T
    return seen[:, :2] / seen[:, 2:]


def assert_seen(attempt_cameras: Cameras, expected: np.ndarray) -> None:
    """The cameras see POINTS at these pixels [views, points, 2] of the photographs."""
    found = attempt_cameras.project(torch.tensor(POINTS)).numpy()
    np.testing.assert_allclose(found, to_working(expected), atol=1e-6)
