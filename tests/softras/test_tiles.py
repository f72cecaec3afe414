"""Soft silhouettes in tiles: those of whole images, cut."""

import numpy as np
import pytest
import torch
import trimesh

from silmesh.softras import soft_silhouettes
from silmesh.softras.tiles import TILE, count_tiles, find_tiles, gather_tiles, soft_tiles

SIZE = (75, 139)  # neither side is a multiple of a tile's


def ball(dtype=torch.float32):
    mesh = trimesh.creation.icosphere(2)
    first = mesh.vertices[:, :2] * 33 + [70, 40]
    second = mesh.vertices[:, 1:] * [60, 20] + [60, 35]
    points = torch.tensor(np.stack([first, second]), dtype=dtype)
    return points.requires_grad_(), torch.tensor(mesh.faces)


def some_tiles(share=0.5):
    return find_tiles(np.random.default_rng(5).random((2, *count_tiles(SIZE))) < share, SIZE)


def test_tiles_are_numbered_view_by_view_and_row_by_row():
    wanted = np.array([[[True, False], [True, True]], [[False, True], [False, False]]])
    tiles = find_tiles(wanted, (40, 50))
    assert tiles.number.tolist() == [[[0, -1], [1, 2]], [[-1, 3], [-1, -1]]]
    assert tiles.ends.tolist() == [0, 3, 4]
    assert tiles.select([1]).number.tolist() == [[[-1, 0], [-1, -1]]]
    assert count_tiles((32, 33)) == (1, 2)


def test_gathered_tiles_hold_their_part_of_an_image():
    images = torch.arange(2 * 75 * 139, dtype=torch.float32).reshape(2, *SIZE)
    wanted = np.zeros((2, *count_tiles(SIZE)), bool)
    wanted[0, 1, 2] = wanted[1, 2, 4] = True
    inner, corner = gather_tiles(images, find_tiles(wanted, SIZE))
    assert torch.equal(inner, images[0, 32:64, 64:96])
    assert torch.equal(corner[:11, :11], images[1, 64:, 128:])
    assert not corner[11:].any()
    assert not corner[:, 11:].any()


@pytest.mark.parametrize("sigma", [1e-3, 1e-4, 1e-6])
def test_alpha_and_gradient_are_those_of_the_whole_image(sigma):
    (points, faces), tiles = ball(), some_tiles()
    within = gather_tiles(torch.ones(2, *SIZE), tiles)
    upstream = torch.randn(within.shape, generator=torch.manual_seed(3)) * within
    whole = gather_tiles(soft_silhouettes(points, faces, SIZE, sigma), tiles)
    alpha = soft_tiles(points, faces, tiles, sigma)
    assert (alpha - whole)[within > 0].abs().max() < 2e-6
    expected, gradient = (
        torch.autograd.grad((part * upstream).sum(), points)[0] for part in (whole, alpha)
    )
    assert (gradient - expected).abs().max() < 1e-5 * expected.abs().max()


def test_other_types_take_the_plain_twin():
    (points, faces), tiles = ball(torch.float64), some_tiles()
    whole = gather_tiles(soft_silhouettes(points, faces, SIZE, 1e-4), tiles)
    assert torch.equal(soft_tiles(points, faces, tiles, 1e-4), whole)


def test_faces_behind_a_camera_and_no_tiles_at_all_are_rendered():
    points, faces = ball()
    behind = points.detach().clone()
    behind[0, 3] = torch.nan
    tiles = some_tiles()
    whole = gather_tiles(soft_silhouettes(behind, faces, SIZE, 1e-4), tiles)
    within = gather_tiles(torch.ones(2, *SIZE), tiles) > 0
    assert (soft_tiles(behind, faces, tiles, 1e-4) - whole)[within].abs().max() < 2e-6
    none = some_tiles(0)
    alpha = soft_tiles(points, faces, none, 1e-4)
    assert alpha.shape == (0, TILE, TILE)
    alpha.sum().backward()
    assert not points.grad.any()


def test_threads_change_nothing():
    (points, faces), tiles = ball(), some_tiles()
    before = torch.get_num_threads()
    found = []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        alpha = soft_tiles(points, faces, tiles, 1e-4)
        found.append((alpha, torch.autograd.grad(alpha.square().sum(), points)[0]))
    torch.set_num_threads(before)
    assert all(torch.equal(*pair) for pair in zip(*found, strict=True))
