import numpy as np
import torch

from silmesh.fitting import smooth as module
from silmesh.fitting.smooth import Smooth, UniformAdam
from silmesh.geometry.mesh_files import to_tensors
from silmesh.shapes.sphere import unit_sphere


def dense(faces, verts, smoothing):
    """I + smoothing L, written out."""
    matrix = np.eye(verts)
    edges = {tuple(sorted((f[i], f[(i + 1) % 3]))) for f in faces.tolist() for i in range(3)}
    for a, b in edges:
        matrix[[a, b], [a, b]] += smoothing
        matrix[a, b] -= smoothing
        matrix[b, a] -= smoothing
    return matrix


def test_it_is_the_dense_solve():
    verts, faces = to_tensors(unit_sphere(40))
    smooth, matrix = Smooth(faces, 40, 5.0), dense(faces, 40, 5.0)
    u = smooth.parameters(verts)
    np.testing.assert_allclose(u, matrix @ verts.double().numpy(), atol=1e-12)
    np.testing.assert_allclose(smooth(u), verts, atol=1e-6)
    other = torch.randn(40, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    np.testing.assert_allclose(smooth(other), np.linalg.solve(matrix, other), atol=1e-6)


def test_on_a_device_it_is_the_dense_solve_too(monkeypatch):
    """What a GPU does, on the CPU: an inverse, or a polynomial of a sparse matrix there."""
    verts, faces = to_tensors(unit_sphere(40))
    monkeypatch.setattr(module, "works_on", lambda device: True)
    weight = torch.randn(40, 3, generator=torch.Generator().manual_seed(1))
    for most, smoothing in ((10, 0.0), (10, 5.0), (40, 0.0), (40, 5.0)):
        monkeypatch.setattr(module, "HELD", most)
        smooth, matrix = Smooth(faces, 40, smoothing), dense(faces, 40, smoothing)
        u = smooth.parameters(verts).requires_grad_()
        np.testing.assert_allclose(smooth(u).detach(), verts, atol=3e-6)
        (smooth(u) * weight).sum().backward()
        np.testing.assert_allclose(u.grad, np.linalg.solve(matrix, weight.double()), atol=1e-5)


def test_a_gradient_goes_through_the_inverse():
    verts, faces = to_tensors(unit_sphere(40))
    smooth = Smooth(faces, 40, 5.0)
    u = smooth.parameters(verts).requires_grad_()
    weight = torch.randn(40, 3, generator=torch.Generator().manual_seed(1))
    (smooth(u) * weight).sum().backward()
    expected = np.linalg.solve(dense(faces, 40, 5.0), weight.double())
    np.testing.assert_allclose(u.grad, expected, atol=1e-6)


def test_a_shift_of_all_vertices_is_not_smoothed_away():
    verts, faces = to_tensors(unit_sphere(40))
    smooth = Smooth(faces, 40, 50.0)
    moved = smooth(smooth.parameters(verts) + torch.tensor([0.1, 0, 0]))
    np.testing.assert_allclose(moved - verts, np.tile([0.1, 0, 0], (40, 1)), atol=1e-6)


def test_uniform_adam_keeps_directions():
    gradient = torch.tensor([[3.0, 4.0, 0.0], [0.3, 0.4, 0.0]], dtype=torch.float64)
    mover = UniformAdam(gradient, (0.9, 0.99))
    for _ in range(3):  # with one gradient again and again the moments are g and g^2
        np.testing.assert_allclose(mover.direction(gradient), gradient / 4, rtol=1e-12)
