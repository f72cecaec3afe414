import math
from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from scenes import silhouettes, turntable

from silmesh.errors import InputError
from silmesh.evaluation.mesh_quality import count_intersections
from silmesh.fitting import fast, image_pyramid
from silmesh.fitting.band import BandLevel
from silmesh.fitting.camera_refinement import SHARED_SD
from silmesh.fitting.fast import Fast
from silmesh.fitting.loop import run
from silmesh.geometry.mesh_files import to_tensors
from silmesh.geometry.silhouette_iou import silhouette_iou
from silmesh.settings.fit import FastFit, FastWeights
from silmesh.shapes.sphere import unit_sphere

AXES, CENTRE = (0.4, 0.22, 0.3), (0.05, -0.1, 0.0)
TOLD = FastFit(
    iterations=300,
    learning_rate=0.5,
    betas=(0.9, 0.999),
    sigma=(0.24 / 64) ** 2,
    weights=FastWeights(laplacian=0.1, flatten=5e-5),
    smoothing=1.0,
    batch=6,
    coarse_to_fine=True,
    refine_cameras=True,
    remesh=True,
    untangle=True,
    seed=0,
)


def changed(**others):
    """The same but for some, whatever they are."""
    return TOLD.model_copy(update=others)


def scene(count=12, size=64, elevation=20.0):
    cameras = turntable(count, size, elevation)
    return cameras, torch.tensor(silhouettes(cameras, AXES, CENTRE), dtype=torch.float32)


def fitted(cameras, seen, told=TOLD, first=None, **others):
    fit = Fast(*(first or to_tensors(unit_sphere(642))), cameras, seen, told, **others)
    return fit, run(fit)


def test_a_sphere_becomes_the_ellipsoid():
    cameras, seen = scene()
    fit, records = fitted(cameras, seen)
    iou = silhouette_iou(fit.verts, fit.faces, cameras, seen.numpy() > 0, TOLD.sigma)
    assert iou.mean() > 0.97
    assert len(records) < TOLD.iterations  # it has levelled
    extents = (fit.verts.max(0).values - fit.verts.min(0).values) / 2
    np.testing.assert_allclose(extents, AXES, rtol=0.15)  # no view shows the poles
    mesh = trimesh.Trimesh(fit.verts.numpy(), fit.faces.numpy(), process=False)
    assert mesh.is_watertight
    assert mesh.euler_number == 2
    assert mesh.volume == pytest.approx(4 / 3 * math.pi * np.prod(AXES), rel=0.15)


def test_a_small_sphere_elsewhere_finds_the_object():
    cameras, seen = scene()
    verts, faces = to_tensors(unit_sphere(642))
    fit, _ = fitted(cameras, seen, first=(verts * 0.2 + torch.tensor([0.7, 0.9, -0.6]), faces))
    iou = silhouette_iou(fit.verts, fit.faces, cameras, seen.numpy() > 0, TOLD.sigma)
    assert iou.mean() > 0.96


def test_a_perturbed_turntable_is_found():
    """Cameras 3 degrees too low and 3 % off the axis: corrected, the silhouettes are met."""
    true, seen = scene()
    low = turntable(12, 64, 17.0)
    wrong = replace(low, t=low.t + torch.tensor([0.03, 0, 0], dtype=torch.float64))
    ious = {}
    for refine in (False, True):
        fit, _ = fitted(wrong, seen, changed(refine_cameras=refine))
        cameras = fit.correct(wrong, list(range(12)))
        ious[refine] = silhouette_iou(fit.verts, fit.faces, cameras, seen.numpy() > 0, 1e-6).mean()
    assert ious[True] > 0.965
    assert ious[True] > ious[False] + 0.01
    forward, wished = cameras.R[:, 2, 1], true.R[:, 2, 1]  # minus the elevation's sine
    assert (forward - wished).abs().mean() < 0.6 * (wrong.R[:, 2, 1] - wished).abs().mean()
    assert (cameras.t[:, 0]).abs().mean() < 0.015


def test_cameras_that_are_right_stay_about_where_they_are():
    cameras, seen = scene()
    fit, _ = fitted(cameras, seen)
    corrected = fit.correct(cameras, list(range(12)))
    assert (corrected.t - cameras.t).abs().max() < 0.03
    assert (corrected.R - cameras.R).abs().max() < 0.03
    assert (corrected.K / cameras.K).nan_to_num(1).sub(1).abs().max() < SHARED_SD[6]


@pytest.mark.parametrize("seed", range(4))
def test_the_perspective_of_right_cameras_does_not_drift_whatever_the_rounding(seed):
    """A millionth of a shift stands for another processor's rounding."""
    cameras, seen = scene()
    verts, faces = to_tensors(unit_sphere(642))
    shift = 1e-6 * torch.randn(verts.shape, generator=torch.Generator().manual_seed(seed))
    fit, _ = fitted(cameras, seen, first=(verts + shift, faces))
    corrected = fit.correct(cameras, list(range(12)))
    focal = corrected.K[:, 0, 0] / cameras.K[:, 0, 0]
    assert focal.log().abs().max() < 0.008
    assert (corrected.t - cameras.t).abs().max() < 0.03


@pytest.mark.parametrize(("views", "batch"), [(12, 5), (12, 0), (7, 2), (3, 12)])
def test_batches_share_the_views_evenly_and_each_round_sees_all(views, batch):
    cameras, seen = scene(views)
    fit = Fast(*to_tensors(unit_sphere(162)), cameras, seen, changed(batch=batch))
    number = math.ceil(views / (batch or views))
    for _ in range(3):
        order = []
        for _ in range(number):
            order.append(fit._choose())
            fit._state.steps += 1
        assert sorted(view for index in order for view in index) == list(range(views))
        for index in order:
            assert len(index) <= (batch or views)
            assert set(np.diff(index)) <= {number}


def test_a_step_halves_when_a_round_is_no_better_and_the_level_ends():
    fit = Fast(*to_tensors(unit_sphere(162)), *scene(), TOLD)
    levels = len(fit._levels)
    assert levels > 1
    for level in range(levels):
        halvings = fast.HALVINGS if level == levels - 1 else fast.COARSE_HALVINGS
        for rounds in range(halvings):  # nothing is before the first; each further one halves
            for _ in range(fit._round):
                fit._count_round(0.5)
            assert (fit._state.level, fit._state.slowed) == (level, rounds)
        assert not fit.done
        for _ in range(fit._round):
            fit._count_round(0.5 * (1 - fast.LEVELLED / 2))
        assert (fit._state.level, fit._state.slowed) == (level + 1, 0)
    assert fit.done


def test_falling_losses_do_not_halve():
    fit = Fast(*to_tensors(unit_sphere(162)), *scene(), TOLD)
    for k in range(5):
        for _ in range(fit._round):
            fit._count_round(0.8**k)
    assert fit._state.slowed == 0


def test_losses_that_fall_after_a_jump_halve_once():
    fit = Fast(*to_tensors(unit_sphere(162)), *scene(), TOLD)
    for loss in (0.2, 0.3, 0.28, 0.26, 0.24, 0.22):
        for _ in range(fit._round):
            fit._count_round(loss)
    assert (fit._state.level, fit._state.slowed) == (0, 1)


def test_a_view_without_weight_says_nothing():
    cameras, seen = scene(6)
    wrong = seen.clone()
    wrong[2] = wrong[2].flip(1).roll(9, 0)
    weights = torch.ones(6)
    weights[2] = 0
    told = changed(iterations=30, batch=0, coarse_to_fine=False)
    verts, faces = to_tensors(unit_sphere(162))
    first = verts * 0.6, faces
    _, records = fitted(cameras, wrong, told, first, weights=weights)
    _, expected = fitted(cameras, seen, told, first, weights=weights)
    assert [r.loss for r in records] == [r.loss for r in expected]


@pytest.mark.parametrize("threads", [1, 2])
def test_fits_are_bitwise_the_same_for_any_number_of_threads(threads):
    told = changed(iterations=20)
    fit, records = fitted(*scene(), told)
    torch.set_num_threads(threads)
    again, same = fitted(*scene(), told)
    assert again.verts.numpy().tobytes() == fit.verts.numpy().tobytes()
    assert [record.loss for record in same] == [record.loss for record in records]


def test_a_loss_that_is_not_finite_stops_the_fit():
    cameras, seen = scene()
    seen[:, 0, 0] = math.nan
    with pytest.raises(InputError, match="step 0 of the fit: loss nan"):
        fitted(cameras, seen)


def test_a_step_far_too_long_is_shortened():
    cameras, seen = scene(6)
    _, records = fitted(cameras, seen, changed(iterations=20, learning_rate=1e21))
    assert all(math.isfinite(record.loss) for record in records)


@pytest.mark.parametrize(("untangle", "crossed"), [(True, False), (False, True)])
def test_a_wing_that_is_inside_out_is_turned_after_the_last_step(untangle, crossed):
    mesh = unit_sphere(642)
    verts = 2 * mesh.vertices * [0.4, 0.01, 0.3]
    verts[:, 1] -= (
        0.06 * np.exp(-(verts[:, 0] ** 2 + verts[:, 2] ** 2) / 0.05) * np.sign(verts[:, 1])
    )
    cameras = turntable(4, 64, elevation=20)
    seen = torch.tensor(silhouettes(cameras, [0.4, 0.01, 0.3]), dtype=torch.float32)
    template = torch.tensor(verts, dtype=torch.float32), torch.tensor(mesh.faces)
    told = changed(iterations=1, learning_rate=1e-3, remesh=False, untangle=untangle)
    fit = Fast(*template, cameras, seen, told)
    run(fit)
    assert bool(count_intersections(fit.verts.numpy(), fit.faces.numpy())) == crossed


def test_an_object_that_frames_cut_goes_on_beyond_them():
    """Half of the views show a half of the ellipsoid: the mesh is whole, and fills no padding."""
    cameras, seen = scene()
    known = torch.ones_like(seen)
    known[::4, :, :32] = known[2::4, :, 32:] = 0
    fit = Fast(*to_tensors(unit_sphere(642)), cameras, seen * known, TOLD, None, known)
    run(fit)
    iou = silhouette_iou(fit.verts, fit.faces, cameras, seen.numpy() > 0, TOLD.sigma)
    assert iou.min() > 0.93  # with the silhouettes as no frame cuts them


LARGE = 160  # pixels, where images of more than 64 are large
AS_LARGE = changed(sigma="auto", vertices=2000, batch=3, iterations=400)


@pytest.fixture
def small_base(monkeypatch):
    for module in (image_pyramid, fast):
        monkeypatch.setattr(module, "BASE", 64)


@pytest.mark.usefixtures("small_base")
def test_large_images_are_fitted_by_bands_with_a_finer_mesh():
    cameras, seen = scene(6, LARGE)
    fit = Fast(*to_tensors(unit_sphere(300)), cameras, seen, AS_LARGE)
    sizes = [max(level.size) if isinstance(level, BandLevel) else 0 for level in fit._levels]
    assert sizes == [0, 0, 80, 160]
    coarse = None
    while not fit.done:
        if fit._state.level == 2 and coarse is None:
            coarse = fit.verts, fit.faces
        fit.step()
    iou = [
        silhouette_iou(*mesh, cameras, seen.numpy() > 0, AS_LARGE.sigma_at(LARGE)).mean()
        for mesh in (coarse, (fit.verts, fit.faces))
    ]
    assert iou[1] > max(0.985, iou[0])
    mesh = trimesh.Trimesh(fit.verts.numpy(), fit.faces.numpy(), process=False)
    assert mesh.is_watertight
    assert 1500 < len(mesh.vertices) < 2200
    extents = (fit.verts.max(0).values - fit.verts.min(0).values) / 2
    np.testing.assert_allclose(extents, AXES, rtol=0.15)


@pytest.mark.usefixtures("small_base")
def test_a_fit_that_resumes_within_a_band_ends_bitwise_as_it_would_have():
    cameras, seen = scene(6, LARGE)
    parts = *to_tensors(unit_sphere(300)), cameras, seen, AS_LARGE
    fit = Fast(*parts)
    while fit._state.seen is None:
        fit.step()
    for _ in range(3):
        fit.step()
    other = Fast(*parts)
    other.restore(fit.state())
    for each in (fit, other):
        for _ in range(10):
            last = each.step()
        each.last = last
    assert fit.last == other.last
    assert torch.equal(fit.verts, other.verts)


def test_images_that_are_not_large_have_the_pyramid_alone():
    cameras, seen = scene()
    fit = Fast(*to_tensors(unit_sphere(642)), cameras, seen, TOLD)
    assert not any(isinstance(level, BandLevel) for level in fit._levels)
    assert [level.factor for level in fit._levels] == [2, 1]
