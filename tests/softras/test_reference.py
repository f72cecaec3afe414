"""The plain renderer's gradient, against finite differences in float64."""

import pytest
import torch

from silmesh.softras import reference, soft_silhouettes


def make_soup(verts, faces, size, seed=0):
    generator = torch.Generator().manual_seed(seed)
    points = torch.rand(1, verts, 2, generator=generator, dtype=torch.float64) * size
    return points, torch.randint(verts, (faces, 3), generator=generator)


@pytest.mark.parametrize("seed", range(4))
def test_gradient_of_random_triangles(seed):
    # some faces have a corner twice, and so no area; a large sigma keeps every pixel in reach
    points, faces = make_soup(6, 4, 7.0, seed)
    points.requires_grad_()
    assert torch.autograd.gradcheck(lambda p: soft_silhouettes(p, faces, (5, 7), 0.5), points)


def test_gradient_of_faces_without_area():
    points = torch.tensor([[[1.3, 1.2], [4.1, 2.9], [6.9, 4.6]]], dtype=torch.float64)
    faces = torch.tensor([[0, 1, 1], [2, 2, 2]])
    points.requires_grad_()
    assert torch.autograd.gradcheck(lambda p: soft_silhouettes(p, faces, (5, 7), 0.5), points)


def test_bins_and_chunks_leave_no_seams(monkeypatch):
    points, faces = make_soup(30, 20, 40.0)
    whole = soft_silhouettes(points, faces, (37, 40), 1e-3)
    monkeypatch.setattr(reference, "BIN", 5)
    monkeypatch.setattr(reference, "PAIRS", 30)
    torch.testing.assert_close(soft_silhouettes(points, faces, (37, 40), 1e-3), whole)
