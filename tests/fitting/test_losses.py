import numpy as np
import pytest
import torch

from silmesh.fitting.losses import Flatten, Laplacian, Objective, edge_diamonds, iou_loss
from silmesh.geometry.mesh_files import to_tensors
from silmesh.settings.fit import FastWeights
from silmesh.shapes.sphere import unit_sphere

#     3
#    / \
#   0---1   two triangles about the edge 0-1
#    \ /
#     2
PAIR = torch.tensor([[0, 1, 3], [1, 0, 2]])
SIDE = 3**0.5 / 2


def bent(angle, dtype=torch.float64):
    """``PAIR`` of unit triangles, flat at 180 degrees, folded shut at 0."""
    turn = np.radians(angle)
    down = [0.5, SIDE * np.cos(turn), SIDE * np.sin(turn)]
    return torch.tensor([[0, 0, 0], [1, 0, 0], down, [0.5, SIDE, 0]], dtype=dtype)


def bumpy(verts, dtype=torch.float64):
    """A sphere whose vertices were moved at random."""
    template, faces = to_tensors(unit_sphere(verts))
    noise = torch.randn(template.shape, generator=torch.manual_seed(0))
    return (template + 0.1 * noise).to(dtype), faces


def test_iou_by_hand():
    alpha = torch.tensor([[[1.0, 0.5], [0, 0]], [[0.2, 0], [0, 0]]])
    truth = torch.tensor([[[1.0, 0], [1, 0]], [[0, 0], [0, 1]]])
    # first view: 1 / (1.5 + 2 - 1) = 0.4; second: 0 / (0.2 + 1)
    assert iou_loss(alpha, truth).item() == pytest.approx(1 - 0.4 / 2, abs=1e-6)


def test_iou_of_a_perfect_and_of_an_empty_picture():
    truth = torch.zeros(1, 4, 4)
    truth[:, 1:3] = 1
    assert iou_loss(truth, truth).item() == pytest.approx(0, abs=1e-6)
    nothing = torch.zeros(1, 4, 4, requires_grad=True)
    loss = iou_loss(nothing, torch.zeros(1, 4, 4))
    loss.backward()
    assert loss.item() == 1
    assert nothing.grad.isfinite().all()


def test_the_laplacian_is_that_of_the_dense_matrix():
    verts, faces = bumpy(40)
    adjacent = torch.zeros(40, 40, dtype=verts.dtype)
    for a, b, c in faces.tolist():
        for i, j in ((a, b), (b, c), (c, a)):
            adjacent[i, j] = adjacent[j, i] = 1
    matrix = torch.eye(40, dtype=verts.dtype) - adjacent / adjacent.sum(1, keepdim=True)
    torch.testing.assert_close(
        Laplacian(faces, 40)(verts), (matrix @ verts).square().sum(), rtol=1e-6, atol=0
    )


def test_the_laplacian_by_hand():
    verts = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    # v0 - (v1 + v2) / 2 = (-.5, -.5), v1 - (v0 + v2) / 2 = (1, -.5), v2 likewise
    loss = Laplacian(torch.tensor([[0, 1, 2]]), 3)(verts)
    assert loss.item() == pytest.approx(0.5 + 1.25 + 1.25)


@pytest.mark.parametrize(("angle", "loss"), [(180, 0), (90, 1), (60, 2.25), (120, 0.25), (0, 4)])
def test_a_bent_pair_has_the_flatten_loss_of_its_angle(angle, loss):
    assert Flatten(PAIR)(bent(angle)).item() == pytest.approx(loss, abs=1e-4)


def test_the_flatten_loss_is_a_sum_over_all_edges():
    verts, faces = bumpy(30)
    opposite = {}
    for a, b, c in faces.tolist():
        for i, j, k in ((a, b, c), (b, c, a), (c, a, b)):
            opposite.setdefault(frozenset((i, j)), []).append(k)
    v, total = verts.numpy(), 0
    for edge, (c, d) in opposite.items():
        a, b = edge
        along = (v[b] - v[a]) / np.linalg.norm(v[b] - v[a])
        across = [v[k] - v[a] - along * (along @ (v[k] - v[a])) for k in (c, d)]
        cos = across[0] @ across[1] / np.prod([np.linalg.norm(x) for x in across])
        total += (cos + 1) ** 2
    assert len(opposite) == 84
    assert Flatten(faces)(verts).item() == pytest.approx(total, rel=2e-4)


def test_gradients_are_those_of_finite_differences():
    verts, faces = bumpy(14)
    verts.requires_grad_()
    assert torch.autograd.gradcheck(Flatten(faces), verts)
    assert torch.autograd.gradcheck(Laplacian(faces, 14), verts)
    torch.manual_seed(0)
    alpha = torch.rand(2, 3, 4, dtype=torch.float64, requires_grad=True)
    truth = (torch.rand(2, 3, 4) > 0.5).double()
    assert torch.autograd.gradcheck(lambda a: iou_loss(a, truth), alpha)
    weights = torch.tensor([0.3, 1.0], dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda a: iou_loss(a, truth, weights), alpha)


@pytest.mark.parametrize("kind", [Flatten, lambda faces: Laplacian(faces, 60)])
def test_a_smoothness_term_on_the_cpu_is_that_of_plain_torch(kind):
    verts, faces = bumpy(60)
    found = []
    for term in (kind(faces), kind(faces).in_torch):
        moved = verts.clone().requires_grad_()
        loss = term(moved)
        loss.backward()
        found.append((loss.detach(), moved.grad))
    torch.testing.assert_close(*found, rtol=1e-10, atol=1e-10)


def test_collapsed_triangles_keep_gradients_finite():
    verts = torch.zeros(4, 3, requires_grad=True)
    (Flatten(PAIR)(verts) + Laplacian(PAIR, 4)(verts)).backward()
    assert verts.grad.isfinite().all()


def test_gradients_are_bitwise_the_same_for_any_number_of_threads():
    """Enough edges (5,760) for torch to gather in parallel."""
    verts, faces = bumpy(1922, torch.float32)
    seen = set()
    for threads in (1, 2, 2, 2, 2):
        torch.set_num_threads(threads)
        moved = verts.clone().requires_grad_()
        (Laplacian(faces, 1922)(moved) + Flatten(faces)(moved)).backward()
        seen.add(moved.grad.numpy().tobytes())
    assert len(seen) == 1


def test_only_the_shared_edge_has_a_diamond():
    (a, b, c, d), *others = edge_diamonds(PAIR).tolist()
    assert not others
    assert ({a, b}, {c, d}) == ({0, 1}, {2, 3})


def test_an_edge_of_three_faces_is_left_out():
    fan = torch.tensor([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    assert edge_diamonds(fan).shape == (0, 4)


def test_what_a_photograph_does_not_show_does_not_count():
    verts, faces = bumpy(14)
    objective = Objective(faces, 14, FastWeights(laplacian=0, flatten=0))
    known = torch.tensor([[[1.0, 1, 0], [1, 1, 0]]])
    truth = torch.tensor([[[1.0, 0, 0], [1, 0, 0]]])
    alpha = torch.tensor([[[1.0, 1, 1], [1, 0, 1]]], requires_grad=True)
    losses = objective(verts, alpha, truth, known=known)
    assert losses.iou_loss.item() == pytest.approx(1 - 2 / 3, abs=1e-6)
    losses.iou_loss.backward()
    assert (alpha.grad[known == 0] == 0).all()
