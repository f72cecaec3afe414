"""What a camera sees of two balls, one behind the other."""

import numpy as np
import pytest
import torch
import trimesh
from scenes import turntable

from silmesh.texture.visibility import look, measure, shrink

SIZE = 200


@pytest.fixture(scope="module")
def scene():
    near, far = trimesh.creation.icosphere(3, 0.15), trimesh.creation.icosphere(3, 0.3)
    camera = turntable(1, SIZE)
    towards = camera.centres[0].numpy() / np.linalg.norm(camera.centres[0].numpy())
    near.apply_translation(0.3 * towards)
    far.apply_translation(-0.2 * towards)
    mesh = trimesh.util.concatenate(near, far)
    P, eye = camera.projections[0].numpy(), camera.centres[0].numpy()
    sight = look(mesh.vertices, mesh.faces, P, (SIZE, SIZE), np.ones((SIZE, SIZE), bool))
    return mesh, eye, measure(sight, eye, mesh.vertices, mesh.vertex_normals), camera


def test_what_stands_behind_is_not_seen(scene):
    """Against rays, which this does not cast."""
    mesh, eye, (_, cosine, _), _ = scene
    towards = eye - mesh.vertices
    facing = (mesh.vertex_normals * towards).sum(axis=1) / np.linalg.norm(towards, axis=1)
    starts = mesh.vertices + 1e-3 * mesh.vertex_normals
    free = ~mesh.ray.intersects_any(starts, towards) & (facing > 0)
    assert not (cosine[~free & (facing < -0.05)] > 0).any()
    assert ((cosine > 0) & ~free).mean() < 0.01
    assert (cosine[free & (facing > 0.5)] > 0).mean() > 0.85  # the rest lies at an outline
    assert cosine[cosine > 0] == pytest.approx(facing[cosine > 0])


def test_distances_are_to_the_outline_of_what_stands_before(scene):
    mesh, _, (pixels, cosine, margin), camera = scene
    middle = camera.project(torch.tensor(mesh.vertices))[0].numpy()
    assert pixels[cosine > 0] == pytest.approx(middle[cosine > 0])
    first = np.arange(len(cosine)) < len(cosine) // 2
    summit = np.argmax(np.where(first, cosine, 0))
    radius = np.abs(middle[first] - middle[summit]).max()
    assert margin[summit] == pytest.approx(radius, rel=0.15)


def test_silhouettes_become_no_larger_than_a_map():
    large = np.zeros((900, 1300), bool)
    large[450:] = True
    small = shrink(large)
    assert small.shape == (443, 640)
    assert small[222:].all()
    assert not small[:220].any()
    assert shrink(small).shape == small.shape
