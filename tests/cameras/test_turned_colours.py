"""Colours tell how a ball was turned, whose silhouettes say nothing of it."""

import numpy as np
import torch
from turned_over import SCALE, SHIFT, SIZE, Q, ring, turn_over

from silmesh.cameras.turned import Turning
from silmesh.cameras.turned_colours import correlate_colours, gather_colours

RADIUS = 0.4
NORMALS = np.random.default_rng(1).normal(size=(3000, 3))
NORMALS /= np.linalg.norm(NORMALS, axis=1, keepdims=True)


def paint(points: np.ndarray) -> np.ndarray:
    """A colour of 0 to 255 that no turn leaves as it is: [..., 3]."""
    return 127 + 120 * np.sin(points @ np.array([[5.0, 1, 2], [1, 7, 3], [2, 3, 9]]) + 0.5)


def picture(cameras) -> np.ndarray:
    """The ball about the origin: [views, SIZE, SIZE, 3] uint8, by where each ray first meets it."""
    u, v = np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5)
    pixels = np.stack([u, v, np.ones_like(u)], axis=-1)
    shown = []
    for K, R, eye in zip(*map(np.asarray, (cameras.K, cameras.R, cameras.centres)), strict=True):
        along = pixels @ np.linalg.inv(K).T @ R
        a, half_b = (along**2).sum(-1), along @ eye
        root = half_b**2 - a * (eye @ eye - RADIUS**2)
        depth = (-half_b - np.sqrt(np.maximum(root, 0))) / a
        colours = paint(eye + depth[..., None] * along)
        shown.append(np.where(root[..., None] > 0, colours, 0).astype(np.uint8))
    return np.stack(shown)


def test_a_point_has_its_colour():
    cameras = ring("a", 20.0)
    colours, seen = gather_colours(RADIUS * NORMALS, NORMALS, cameras, picture(cameras))
    true = paint(RADIUS * NORMALS)
    assert 0.5 < seen.mean() < 1  # the ball's underside is not seen
    assert not seen[NORMALS[:, 1] < -0.9].any()
    assert np.median(np.abs(colours - true)[seen]) < 10


def test_the_right_turn_has_colours_that_agree():
    first, second = ring("a", 20.0), ring("b", 30.0)
    # The second set's own world Y has the ball at X = SCALE Q Y + SHIFT.
    shown = picture(turn_over(second))
    right = Turning(Q, SCALE, np.full(3, SHIFT), np.zeros(1))
    wrong = right.turned_about(np.array([0.0, 1.0, 0.0]), np.zeros(3), 120.0)
    a, b = correlate_colours(
        RADIUS * NORMALS, NORMALS, (first, picture(first)), (second, shown), [right, wrong]
    )
    assert a > 0.9
    assert b < 0.4
    torch.testing.assert_close(right.bring(second).R, turn_over(second).R)
