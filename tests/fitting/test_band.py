"""The band about the outlines: its loss and its gradient are those of whole images."""

import numpy as np
import pytest
import torch
import trimesh

from silmesh.fitting.band import Band, BandLevel, Hinges, choose_factors
from silmesh.fitting.losses import iou_loss
from silmesh.softras import soft_silhouettes
from silmesh.softras.tiles import TILE, soft_tiles

SIZE = 300
SIGMA = (2 * 0.03 / SIZE) ** 2
ROWS, COLUMNS = np.mgrid[:SIZE, :SIZE] + 0.5


def disc(x, y, radius):
    return (COLUMNS - x) ** 2 + (ROWS - y) ** 2 < radius**2


def scene(shift=3.0):
    """A ball in two views, and discs that it misses by ``shift`` pixels."""
    mesh = trimesh.creation.icosphere(3)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(1.1, [0.2, 0.5, 0.7]))
    points = np.stack([100 * mesh.vertices[:, :2] + [150, 140], 80 * mesh.vertices[:, 1:] + 150])
    silhouettes = np.stack([disc(150 + shift, 140, 100), disc(150, 150 - shift, 84)])
    return torch.tensor(points, dtype=torch.float32), torch.tensor(mesh.faces), silhouettes


def outside_as_mask(alpha, tiles):
    wanted = torch.tensor(tiles.number >= 0).repeat_interleave(TILE, 1).repeat_interleave(TILE, 2)
    return torch.where(wanted[:, :SIZE, :SIZE], alpha, (alpha > 0.5).float())


def both_losses(points, faces, level, weights=None):
    """The loss by whole images and by the band, and the gradients, and the band.

    Outside the band the images are a mask, since single pixels on edges inside the object let a
    little through.
    """
    points = points.clone().requires_grad_()
    band = Band(level, points.detach(), Hinges.of(faces))
    whole = outside_as_mask(soft_silhouettes(points, faces, (SIZE, SIZE), SIGMA), band.tiles)
    every = np.ones_like(level.silhouettes) if level.known is None else level.known
    known = torch.tensor(every).float()
    shown = torch.tensor(level.silhouettes).float() * known
    index = list(range(len(points)))
    losses = [
        iou_loss(whole * known, shown, weights),
        band.iou_loss(soft_tiles(points, faces, band.tiles, SIGMA), index, weights),
    ]
    gradients = [torch.autograd.grad(loss, points)[0] for loss in losses]
    return losses, gradients, band


@pytest.mark.parametrize("shift", [0.0, 3.0, 60.0])
@pytest.mark.parametrize("weights", [None, torch.tensor([1.0, 0.3])])
def test_loss_and_gradient_are_those_of_whole_images(shift, weights):
    points, faces, silhouettes = scene(shift)
    level = BandLevel(1, silhouettes, SIGMA, 1.0)
    losses, (whole, ours), band = both_losses(points, faces, level, weights)
    assert losses[1].item() == pytest.approx(losses[0].item(), abs=2e-6)
    assert (whole - ours).norm() < 1e-4 * whole.norm()
    assert band.tiles.count < 0.8 * band.tiles.number.size


def test_pixels_that_are_not_known_do_not_count():
    points, faces, silhouettes = scene()
    known = np.ones_like(silhouettes)
    known[0, :, 170:] = False  # the frame cuts the ball
    level = BandLevel(1, silhouettes, SIGMA, 1.0, known)
    losses, (whole, ours), _ = both_losses(points, faces, level)
    assert losses[1].item() == pytest.approx(losses[0].item(), abs=2e-6)
    assert (whole - ours).norm() < 1e-4 * whole.norm()


def test_a_coarser_level_averages_the_pixels():
    points, faces, silhouettes = scene()
    level = BandLevel(2, silhouettes, SIGMA, 1.0)
    assert level.size == (150, 150)
    band = Band(level, points / 2, Hinges.of(faces))
    alpha = soft_tiles(points / 2, faces, band.tiles, SIGMA)
    small = torch.nn.functional.avg_pool2d(torch.tensor(silhouettes).float(), 2)
    whole = soft_silhouettes(points / 2, faces, (150, 150), SIGMA)
    expected = iou_loss(whole, small).item()
    assert band.iou_loss(alpha, [0, 1]).item() == pytest.approx(expected, abs=1e-3)
    only = band.tiles.select([1])
    alpha = soft_tiles(points[[1]] / 2, faces, only, SIGMA)
    expected = iou_loss(whole[[1]], small[[1]]).item()
    assert band.iou_loss(alpha, [1]).item() == pytest.approx(expected, abs=1e-3)


def test_the_last_pixels_of_an_odd_size_count_by_what_they_show():
    silhouettes = np.zeros((1, 301, 301), bool)
    silhouettes[0, 200:] = True  # reaches the lower and right sides, where pixels are half beyond
    level = BandLevel(2, silhouettes, SIGMA, 1.0)
    plate = trimesh.creation.box(bounds=[[-9, 100, 0], [160, 160, 1]])
    corners = torch.tensor(plate.vertices[None, :, :2], dtype=torch.float32)
    faces = torch.tensor(plate.faces)
    band = Band(level, corners, Hinges.of(faces))
    loss = band.iou_loss(soft_tiles(corners, faces, band.tiles, SIGMA), [0])
    assert level.size == (151, 151)
    assert loss.item() == pytest.approx(0, abs=1e-3)


def test_the_band_grows_with_the_outline_not_with_the_area():
    def share(scale):
        wide = np.kron(disc(150, 150, 100), np.ones((scale, scale), bool))[None]
        mesh = trimesh.creation.icosphere(4)
        points = torch.tensor(mesh.vertices[None, :, :2] * 100 + 150, dtype=torch.float32) * scale
        return Band(
            BandLevel(1, wide, SIGMA, 1.0), points, Hinges.of(torch.tensor(mesh.faces))
        ).tiles.count

    assert share(4) < 2.5 * share(2)


def test_the_band_holds_until_a_point_moves_by_its_margin():
    points, faces, silhouettes = scene()
    band = Band(BandLevel(1, silhouettes, SIGMA, 1.0), points, Hinges.of(faces))
    moved = points.clone()
    moved[1, 7, 0] += 7.9
    assert band.holds(moved, [0, 1])
    moved[1, 7, 0] += 0.2
    assert not band.holds(moved, [0, 1])
    assert band.holds(moved[:1], [0])


def test_levels_lead_from_small_images_to_the_images_own_size():
    assert choose_factors(256, 256) == []
    assert choose_factors(300, 256) == [1]
    assert choose_factors(512, 256) == [1]
    assert choose_factors(1000, 256) == [2, 1]
    assert choose_factors(4000, 256) == [8, 4, 2, 1]
