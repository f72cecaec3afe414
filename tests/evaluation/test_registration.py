"""A known similarity is found again, and no mirror image is."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from silmesh.evaluation.ground_truth import compare_to_truth
from silmesh.evaluation.registration import register


def teapot():
    """A lopsided body: no rotation and no reflection maps it on itself."""
    body = trimesh.creation.icosphere(4, 0.4)
    body.vertices *= [1, 0.75, 0.9]
    spout = trimesh.creation.capsule(0.5, 0.09, count=[24, 24])
    spout.apply_transform(trimesh.transformations.rotation_matrix(1.1, [0, 1, 0.3]))
    knob = trimesh.creation.icosphere(3, 0.13).apply_translation([-0.05, 0.36, 0.14])
    handle = trimesh.creation.torus(0.17, 0.05).apply_translation([-0.45, -0.03, 0.05])
    return trimesh.util.concatenate([body, spout, knob, handle])


def moved(mesh, scale, rotation, shift):
    copy = mesh.copy()
    copy.vertices = scale * mesh.vertices @ rotation.T + shift
    return copy


@pytest.mark.parametrize("seed", range(3))
def test_a_known_similarity_is_found_again(seed):
    truth = teapot()
    rotation = Rotation.random(rng=seed).as_matrix()
    scale, shift = (0.02, 1.0, 37.0)[seed], np.array([3.0, -8.0, 1.0])
    mesh = moved(truth, 1 / scale, rotation.T, -rotation.T @ shift / scale)
    found = register(mesh, truth)
    assert found.scale == pytest.approx(scale, rel=1e-3)
    np.testing.assert_allclose(found.R, rotation, atol=1e-3)
    np.testing.assert_allclose(found.apply(mesh.vertices), truth.vertices, atol=1e-3)
    assert np.linalg.det(found.R) == pytest.approx(1)


def test_a_turn_about_the_up_axis_of_a_coarser_mesh():
    """As calibration leaves it; the mesh is another one of the same surface."""
    truth = trimesh.creation.icosphere(5, 0.5)
    truth.vertices *= [1, 0.6, 0.8] + 0.3 * truth.vertices[:, ::-1]
    coarse = trimesh.creation.icosphere(3, 0.5)
    coarse.vertices *= [1, 0.6, 0.8] + 0.3 * coarse.vertices[:, ::-1]
    turn = Rotation.from_rotvec([0, 2.5, 0]).as_matrix()
    found = register(moved(coarse, 0.7, turn, [0.1, 0, -0.2]), truth)
    np.testing.assert_allclose(found.R, turn.T, atol=0.01)
    assert found.scale == pytest.approx(1 / 0.7, rel=0.01)


@pytest.mark.slow
def test_a_mirror_image_fits_badly():
    truth = teapot()
    mirrored = truth.copy()
    mirrored.vertices *= [1, 1, -1]
    mirrored.invert()
    scores = []
    for mesh in (truth, mirrored):
        copy = moved(mesh, 2.0, Rotation.random(rng=5).as_matrix(), [1, 2, 3])
        copy.vertices = register(copy, truth).apply(copy.vertices)
        scores.append(compare_to_truth(copy, truth))
    own, other = scores
    assert own["f_score"] > 0.99
    assert other["f_score"] < own["f_score"] - 0.1
    assert other["chamfer"] > 2 * own["chamfer"]


def test_a_body_of_revolution_is_laid_on_itself():
    """Its turn about its axis is free, which must not stop the rest."""
    outline = [[0.001, -0.5], [0.3, -0.5], [0.25, 0.1], [0.1, 0.4], [0.001, 0.42]]
    truth = trimesh.creation.revolve(outline, sections=96)
    mesh = moved(truth, 3.0, Rotation.random(rng=2).as_matrix(), [0, 5, 0])
    found = register(mesh, truth)
    assert found.scale == pytest.approx(1 / 3, rel=1e-3)
    mesh.vertices = found.apply(mesh.vertices)
    assert compare_to_truth(mesh, truth)["chamfer"] < 0.01
