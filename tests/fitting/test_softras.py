import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scenes import silhouettes, turntable

from silmesh.errors import InputError
from silmesh.fitting.loop import Record, run
from silmesh.fitting.losses import Flatten
from silmesh.fitting.softras import SoftRas
from silmesh.geometry.mesh_files import to_tensors
from silmesh.settings.fit import SoftRasFit
from silmesh.shapes.sphere import unit_sphere
from silmesh.softras import reference

AXES = (0.45, 0.3, 0.35)
SOFTRAS = {
    "learning_rate": 0.01,
    "betas": (0.5, 0.99),
    "sigma": 1e-4,
    "weights": {"laplacian": 0.03, "flatten": 0.0003},
}


def settings(iterations, **changes):
    return SoftRasFit(iterations=iterations, **SOFTRAS).model_copy(update=changes)


def fit(template, faces, cameras, seen, told, **others):
    procedure = SoftRas(template, faces, cameras, seen, told)
    records = run(procedure, **others)
    return procedure.verts, records


def scene(verts, size, views):
    """A sphere, and the cameras and silhouettes of an ellipsoid."""
    cameras = turntable(views, size)
    seen = torch.tensor(silhouettes(cameras, AXES), dtype=torch.float32)
    return *to_tensors(unit_sphere(verts)), cameras, seen


def plain_losses(displacement, centre, template, faces, cameras, seen, told):
    """The report's losses in float64, written out: loss, IoU loss, Laplacian, flatten."""
    halved = template.double() / 2
    base = torch.log(halved.abs() / (1 - halved.abs()))
    v = torch.sigmoid(base + displacement) * halved.sign()
    c = torch.tanh(centre)
    v = v.relu() * (1 - c) - (-v).relu() * (1 + c) + c
    alpha = reference.soft_silhouettes(cameras.project(v), faces, tuple(seen.shape[1:]), told.sigma)
    t = seen.double()
    iou = ((alpha * t).sum((1, 2)) / ((alpha + t - alpha * t).sum((1, 2)) + 1e-6)).mean()
    adjacent = torch.zeros(len(v), len(v), dtype=torch.float64)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        adjacent[faces[:, i], faces[:, j]] = adjacent[faces[:, j], faces[:, i]] = 1
    laplacian = (v - adjacent @ v / adjacent.sum(1, keepdim=True)).square().sum()
    flatten, weights = Flatten(faces)(v), told.weights
    loss = 1 - iou + weights.laplacian * laplacian + weights.flatten * flatten
    return torch.stack([loss, 1 - iou, laplacian, flatten])


def plain_fit(scene, told):
    """The fit's twin: Adam in numpy on both parameters."""
    template = scene[0]
    values = [np.zeros(template.shape), np.zeros(3)]
    first, second = ([np.zeros_like(v) for v in values] for _ in range(2))
    rows = []
    for step in range(1, told.iterations + 1):
        parameters = [torch.tensor(v, requires_grad=True) for v in values]
        losses = plain_losses(*parameters, *scene, told)
        losses[0].backward()
        rows.append(losses.tolist())
        for k, parameter in enumerate(parameters):
            g = parameter.grad.numpy()
            first[k] = told.betas[0] * first[k] + (1 - told.betas[0]) * g
            second[k] = told.betas[1] * second[k] + (1 - told.betas[1]) * g * g
            m = first[k] / (1 - told.betas[0] ** step)
            s = second[k] / (1 - told.betas[1] ** step)
            values[k] = values[k] - told.learning_rate * m / (np.sqrt(s) + 1e-8)
    return values, rows


def test_the_loop_is_the_plain_twins():
    made, told = scene(40, 24, 4), settings(3, sigma=1e-3)
    verts, records = fit(*made, told)
    (displacement, centre), rows = plain_fit(made, told)
    ours = [[r.loss, r.iou_loss, r.laplacian, r.flatten] for r in records]
    np.testing.assert_allclose(ours, rows, rtol=1e-4)
    halved = made[0].double().numpy() / 2
    with np.errstate(divide="ignore"):
        base = np.log(np.abs(halved) / (1 - np.abs(halved)))
    v = np.sign(halved) / (1 + np.exp(-(base + displacement)))
    c = np.tanh(centre)
    expected = np.maximum(v, 0) * (1 - c) - np.maximum(-v, 0) * (1 + c) + c
    np.testing.assert_allclose(verts.numpy(), expected, atol=1e-5)


def test_a_fit_approaches_the_silhouettes_and_says_so():
    watched = []
    made = scene(162, 32, 4)
    verts, records = fit(*made, settings(100), watch=watched.append)
    assert watched == records
    assert [record.iteration for record in records] == list(range(100))
    assert np.all(np.diff([record.seconds for record in records]) > 0)
    assert records[-1].iou_loss < 0.2 < 0.5 < records[0].iou_loss
    extents = (verts.max(0).values - verts.min(0).values) / 2
    np.testing.assert_allclose(extents, AXES, rtol=0.25)


def test_a_record_is_a_row_of_loss_csv():
    fields = list(Record.__dataclass_fields__)
    assert fields == ["iteration", "loss", "iou_loss", "laplacian", "flatten", "seconds"]


@pytest.mark.parametrize("verts", [642, 1922])
def test_fits_are_bitwise_the_same_for_any_number_of_threads(verts):
    made, seen = scene(verts, 32, 4), set()
    for threads in (1, 2, 2):
        torch.set_num_threads(threads)
        fitted, records = fit(*made, settings(5))
        seen.add((fitted.numpy().tobytes(), tuple(record.loss for record in records)))
    assert len(seen) == 1


def test_a_initial_mesh_outside_the_cube_is_refused():
    template, *others = scene(40, 16, 2)
    with pytest.raises(InputError, match=r"within \(-1, 1\)"):
        fit(template * 3, *others, settings(1))


def test_a_loss_that_is_not_finite_stops_the_fit():
    template, faces, cameras, seen = scene(40, 16, 2)
    seen[0, 0, 0] = math.nan
    with pytest.raises(InputError, match=r"step 0 of the fit: loss nan, IoU loss nan, .* finite"):
        fit(template, faces, cameras, seen, settings(3))


def test_a_mesh_behind_every_camera_is_no_fit_but_no_crash():
    template, faces, cameras, seen = scene(40, 16, 2)
    turned = replace(cameras, t=-cameras.t)
    _, records = fit(template, faces, turned, seen, settings(1))
    assert records[0].iou_loss == 1
