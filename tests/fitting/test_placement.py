import numpy as np
import torch
from scenes import silhouettes, turntable

from silmesh.fitting.placement import move_to_silhouettes
from silmesh.geometry.mesh_files import to_tensors
from silmesh.shapes.sphere import unit_sphere

CENTRE = (0.2, -0.15, 0.1)


def scene():
    cameras = turntable(6, 64, 15)
    seen = silhouettes(cameras, (0.15, 0.15, 0.15), CENTRE)
    return cameras, torch.tensor(seen, dtype=torch.float32)


def test_a_mesh_elsewhere_is_brought_to_the_object():
    verts, _ = to_tensors(unit_sphere(642))
    placed = move_to_silhouettes(verts / 2, *scene())
    np.testing.assert_allclose(placed.mean(0), CENTRE, atol=0.01)
    np.testing.assert_allclose((placed - placed.mean(0)).norm(dim=1), 0.15, rtol=0.05)


def test_a_mesh_that_is_there_stays():
    verts, _ = to_tensors(unit_sphere(642))
    there = verts * 0.14 + torch.tensor(CENTRE)
    assert torch.equal(move_to_silhouettes(there, *scene()), there)


def test_a_mesh_behind_the_cameras_is_brought_before_them():
    verts, _ = to_tensors(unit_sphere(642))
    placed = move_to_silhouettes(verts / 2 + torch.tensor([0, 0, 5.0]), *scene())
    np.testing.assert_allclose(placed.mean(0), CENTRE, atol=0.01)
