"""Colours from photographs of made-up balls whose paint is a formula."""

import numpy as np
import pytest
import torch
import trimesh
from drawing import render_colours
from scenes import dome, turntable

from silmesh.texture.vertex_colours import colour_vertices

SIZE = 96


def paint(verts):
    """Smooth colours that differ on all sides: [verts, 3] in [0, 255]."""
    return 127 + 90 * verts / np.linalg.norm(verts, axis=1, keepdims=True)


def photograph(mesh, colours, cameras):
    """Pictures on black [views, h, w, 3] uint8, and silhouettes."""
    verts = torch.tensor(mesh.vertices)
    corners = torch.tensor(colours / 255)[torch.tensor(mesh.faces)]
    size = (SIZE, SIZE)
    pictures = render_colours(
        cameras.project(verts),
        cameras.depths(verts),
        torch.tensor(mesh.faces),
        corners,
        size,
        background=(0.0, 0.0, 0.0),
    ).numpy()
    rgb = (255 * np.moveaxis(pictures[:, :3], 1, -1)).round().astype(np.uint8)
    return rgb, pictures[:, 3] > 0.5


def blur(pictures):
    """The mean of 3 x 3 pixels, as a lens would mix the background into the outline."""
    padded = np.pad(pictures.astype(float), [(0, 0), (1, 1), (1, 1), (0, 0)], mode="edge")
    shifted = [padded[:, y : y + SIZE, x : x + SIZE] for y in range(3) for x in range(3)]
    return np.mean(shifted, axis=0).round().astype(np.uint8)


@pytest.fixture(scope="module")
def ball():
    return trimesh.creation.icosphere(3, 0.4)


def test_the_paint_is_found_again(ball):
    cameras = dome(16, SIZE)
    expected = paint(ball.vertices)
    pictures, seen = photograph(ball, expected, cameras)
    found = colour_vertices(ball.vertices, ball.faces, cameras, blur(pictures), seen)
    assert found.dtype == np.uint8
    error = np.abs(found - expected)
    assert error.mean() < 3
    assert error.max() < 15


def test_no_background_bleeds_in_at_the_outline(ball):
    """Seen from one height, the poles lie at every outline."""
    cameras = turntable(12, SIZE)
    white = np.full((len(ball.vertices), 3), 200.0)
    pictures, seen = photograph(ball, white, cameras)
    found = colour_vertices(ball.vertices, ball.faces, cameras, blur(pictures), seen)
    assert found.min() > 185


def test_what_hides_lends_no_colour():
    """A red ball before a green one: the camera sees no green where red stands before it."""
    red, green = (trimesh.creation.icosphere(3, 0.2) for _ in range(2))
    red.apply_translation([0, 0, 0.25])
    green.apply_translation([0, 0, -0.25])
    both = trimesh.util.concatenate(red, green)
    colours = np.repeat([[220.0, 0, 0], [0, 220.0, 0]], len(red.vertices), axis=0)
    cameras = turntable(12, SIZE)
    pictures, seen = photograph(both, colours, cameras)
    found = colour_vertices(both.vertices, both.faces, cameras, pictures, seen).astype(int)
    first = np.arange(len(colours)) < len(red.vertices)
    wrong = np.where(first, found[:, 1] > found[:, 0], found[:, 0] > found[:, 1])
    assert wrong.mean() < 0.01


def test_one_view_that_differs_is_outvoted(ball):
    cameras = turntable(12, SIZE)
    plain = np.full((len(ball.vertices), 3), 150.0)
    pictures, seen = photograph(ball, plain, cameras)
    pictures[4][seen[4]] = 255
    found = colour_vertices(ball.vertices, ball.faces, cameras, pictures, seen).astype(int)
    assert np.median(np.abs(found - 150)) <= 1
    assert (np.abs(found - 150).max(axis=1) < 25).mean() > 0.95


def test_vertices_that_no_view_sees_take_their_neighbours_colour(ball):
    cameras = turntable(12, SIZE).select([0])
    plain = np.full((len(ball.vertices), 3), 90.0)
    pictures, seen = photograph(ball, plain, cameras)
    found = colour_vertices(ball.vertices, ball.faces, cameras, pictures, seen).astype(int)
    assert np.abs(found - 90).max() <= 2


def test_without_any_view_all_is_grey(ball):
    cameras = turntable(2, SIZE)
    pictures = np.zeros((2, SIZE, SIZE, 3), np.uint8)
    nothing = np.zeros((2, SIZE, SIZE), bool)
    found = colour_vertices(ball.vertices, ball.faces, cameras, pictures, nothing)
    assert (found == 124).all()
