"""Meshes in colours, against values computed by hand."""

import pytest
import torch
from drawing import render_colours

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
def test_the_nearest_face_is_seen(near_first):
    picture = render_colours(*make_two_layers(near_first), (6, 8))
    expected = torch.tensor([1.0, 0, 0, 1])[:, None, None].expand(4, 6, 8)
    torch.testing.assert_close(picture[0], expected)


def test_faces_behind_the_camera_are_left_out():
    points, depths, faces, colours = make_two_layers(True)
    depths[0, 1] = -1.0
    picture = render_colours(points, depths, faces, colours, (6, 8))
    assert picture[0, :, 3, 3].tolist() == [0, 1, 0, 1]
