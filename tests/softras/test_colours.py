"""Colour pictures, against values computed by hand."""

import math

import pytest
import torch

from silmesh.softras import soft_silhouettes
from silmesh.softras.colours import render_colours

FACE = torch.tensor([[0, 1, 2]])
RED_GREEN_BLUE = torch.eye(3)[None]  # [faces, 3, 3]


def fill(*colours):
    """One colour a face: [faces, 3, 3]."""
    return torch.tensor(colours)[:, None].expand(-1, 3, -1)


def test_colours_are_interpolated_with_perspective():
    # the pixel (2, 1) is centred at (2.5, 1.5): barycentric 1/2, 5/16, 3/16 in this triangle
    points = torch.tensor([[[0.0, 0.0], [8.0, 0.0], [0.0, 8.0]]])
    depths = torch.tensor([[1.0, 2.0, 4.0]])
    picture = render_colours(points, depths, FACE, RED_GREEN_BLUE, (8, 8))
    shares = torch.tensor([1 / 2, 5 / 16 / 2, 3 / 16 / 4])
    expected = torch.cat([shares / shares.sum(), torch.ones(1)])
    torch.testing.assert_close(picture[0, :, 1, 2], expected)
    assert picture[0, :, 7, 7].tolist() == [1, 1, 1, 0]


def make_two_layers(near_first):
    """A red square at depth 1 and a green one at depth 2, each covering the image."""
    square = torch.tensor([[-50.0, -50.0], [90.0, -50.0], [-50.0, 90.0]])
    points = torch.cat([square, square])[None]
    depths = torch.tensor([[1.0] * 3 + [2.0] * 3])
    order = [0, 1] if near_first else [1, 0]
    faces = torch.arange(6).reshape(2, 3)[order]
    colours = fill([1.0, 0.0, 0.0], [0.0, 1.0, 0.0])[order]
    return points, depths, faces, colours


@pytest.mark.parametrize("near_first", [True, False])
@pytest.mark.parametrize("gamma", [None, 1e-4])
def test_the_nearest_face_is_seen(near_first, gamma):
    picture = render_colours(*make_two_layers(near_first), (6, 8), gamma=gamma)
    expected = torch.tensor([1.0, 0, 0, 1])[:, None, None].expand(4, 6, 8)
    torch.testing.assert_close(picture[0], expected)


def test_soft_order_mixes_by_the_formula():
    # D = 1 for both, n = 1 and 0, the background is black
    gamma = 0.5
    picture = render_colours(
        *make_two_layers(True), (6, 8), gamma=gamma, background=(0.0, 0.0, 0.0)
    )
    weights = [math.exp(1 / gamma), 1.0, math.exp(1e-3 / gamma)]
    expected = torch.tensor([weights[0], weights[1], 0.0]) / sum(weights)
    torch.testing.assert_close(picture[0, :3, 3, 3], expected)


def test_soft_alpha_is_the_silhouette():
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(2, 30, 2, generator=generator) * 40
    depths = torch.rand(2, 30, generator=generator) + 1
    faces = torch.randint(30, (20, 3), generator=generator)
    faces = faces[(faces != faces.roll(1, 1)).all(dim=1)]
    picture = render_colours(
        points, depths, faces, torch.rand(len(faces), 3, 3), (33, 40), sigma=1e-3, gamma=1e-2
    )
    alpha = soft_silhouettes(points.double(), faces, (33, 40), 1e-3)
    torch.testing.assert_close(picture[:, 3], alpha.float(), atol=1e-4, rtol=0)
    assert picture.isfinite().all()


def test_small_sigma_and_gamma_come_to_the_hard_picture():
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(1, 30, 2, generator=generator) * 40
    depths = torch.rand(1, 30, generator=generator) + 1
    faces, colours = torch.arange(30).reshape(10, 3), torch.rand(10, 3, 3, generator=generator)
    hard = render_colours(points, depths, faces, colours, (40, 40))
    soft = render_colours(points, depths, faces, colours, (40, 40), sigma=1e-7, gamma=1e-5)
    alike = (hard - soft).abs().amax(dim=1) < 1e-2
    assert alike.float().mean() > 0.98  # all but pixels that an edge or a crossing runs through


def test_faces_behind_the_camera_are_left_out():
    points, depths, faces, colours = make_two_layers(True)
    depths[0, 1] = -1.0
    picture = render_colours(points, depths, faces, colours, (6, 8))
    assert picture[0, :, 3, 3].tolist() == [0, 1, 0, 1]
