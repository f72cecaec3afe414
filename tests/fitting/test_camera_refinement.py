from dataclasses import replace

import numpy as np
import pytest
import torch
from scenes import dome, turntable

from silmesh.fitting.camera_refinement import OWN_SD, Refinement, _similarities

POINTS = torch.randn(7, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)) * 0.2


def randomly(refinement, scale=1.0, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return scale * torch.randn(refinement.start().shape, dtype=torch.float64, generator=generator)


def rotations(cameras):
    return cameras.R @ cameras.R.mT


def test_no_correction_leaves_the_cameras_as_they_are():
    cameras = turntable(5, 32, 10)
    corrected = Refinement(cameras)(Refinement(cameras).start(), range(5))
    for name in ("K", "R", "t"):
        np.testing.assert_allclose(getattr(corrected, name), getattr(cameras, name), atol=1e-12)


@pytest.mark.parametrize("cameras", [turntable(5, 32, 10), dome(6, 32)])
def test_gradients_are_those_of_finite_differences(cameras):
    refinement = Refinement(cameras)
    at = randomly(refinement).requires_grad_()
    assert torch.autograd.gradcheck(
        lambda p: refinement(p, [4, 1]).project(POINTS).sum(dim=(1, 2)) + refinement.prior(p), at
    )


@pytest.mark.parametrize("cameras", [turntable(8, 32, 10), dome(9, 32)])
def test_the_whole_does_not_drift(cameras):
    """Corrections have no part that a turn, shift or scale of the world would make."""
    refinement = Refinement(cameras)
    parameters = randomly(refinement, 0.01)
    parameters[6] = 0  # the lens, which takes its distance along
    corrected = refinement(parameters, range(len(cameras)))
    turn = corrected.R @ cameras.R.mT - torch.eye(3)  # [w]x to first order
    w = torch.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], dim=1)
    sd = torch.tensor(OWN_SD, dtype=torch.float64)
    moved = (torch.cat([w, corrected.t - cameras.t], dim=1) / sd).reshape(-1)
    gauge = _similarities(cameras) / sd.repeat(len(cameras)).unsqueeze(1)
    shared_left = torch.linalg.qr(gauge).Q.mT @ moved
    if (
        cameras.views == turntable(8, 32).views
    ):  # of a turntable, three shared ones are similarities
        own = refinement.corrections(parameters)[1].reshape(-1)
        assert float((torch.linalg.qr(gauge).Q.mT @ own).abs().max()) < 1e-9
        assert float(shared_left.abs().max()) < 1e-3 * float(moved.norm())


def test_similarities_are_what_they_do():
    """Turning, shifting and scaling the world, by differences."""
    cameras, small = dome(4, 32), 1e-6
    gauge = _similarities(cameras).reshape(4, 6, 7)
    for k in range(3):
        a = torch.zeros(3, dtype=torch.float64)
        a[k] = small
        shifted = cameras.t + cameras.R @ a
        np.testing.assert_allclose((shifted - cameras.t) / small, gauge[:, 3:, 3 + k], atol=1e-6)
        cross = torch.linalg.cross(a.expand(3, 3), torch.eye(3, dtype=torch.float64)).mT
        turn = (cameras.R @ torch.linalg.matrix_exp(-cross) @ cameras.R.mT - torch.eye(3)) / small
        w = torch.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], dim=1)
        np.testing.assert_allclose(w, gauge[:, :3, k], atol=1e-5)
    np.testing.assert_allclose(gauge[:, 3:, 6], cameras.t)


def test_own_corrections_have_no_shared_part():
    refinement = Refinement(dome(9, 32))
    own = refinement.corrections(randomly(refinement))[1]
    np.testing.assert_allclose(own.mean(0), np.zeros(6), atol=1e-12)


def test_views_that_are_not_fitted_have_the_shared_corrections():
    every = turntable(6, 32, 10)
    fitted = [0, 1, 3, 4]
    refinement = Refinement(every.select(fitted))
    parameters = randomly(refinement)
    corrected = refinement.all_of(parameters, every, fitted)
    some = refinement(parameters, [3, 1])  # of those that are fitted
    np.testing.assert_allclose(corrected.select([4, 1]).R, some.R, atol=1e-12)
    np.testing.assert_allclose(corrected.select([4, 1]).t, some.t, atol=1e-12)
    np.testing.assert_allclose(corrected.K[2], some.K[0], atol=1e-12)
    np.testing.assert_allclose(rotations(corrected), np.tile(np.eye(3), (6, 1, 1)), atol=1e-12)
    alone = parameters.clone()
    alone[7:] = 0
    np.testing.assert_allclose(
        corrected.select([2, 5]).t, refinement.all_of(alone, every, fitted).select([2, 5]).t
    )


def test_a_lens_is_shared_and_keeps_the_objects_size():
    cameras = turntable(3, 32)
    parameters = Refinement(cameras).start()
    parameters[6] = 1.0  # a standard deviation: exp(0.1)
    dollied = Refinement(cameras)(parameters, range(3))
    K = dollied.K
    np.testing.assert_allclose(K[:, 0, 0], cameras.K[:, 0, 0] * np.exp(0.1))
    np.testing.assert_allclose(K[:, :2, 2], cameras.K[:, :2, 2])
    origin = torch.zeros(1, 3, dtype=torch.float64)
    across = torch.tensor([[0.0, 0.01, 0.0]], dtype=torch.float64)
    size = [(c.project(across) - c.project(origin)).norm() for c in (cameras, dollied)]
    assert float(size[1]) == pytest.approx(float(size[0]), rel=1e-6)
    assert replace(cameras, K=K).views == cameras.views
