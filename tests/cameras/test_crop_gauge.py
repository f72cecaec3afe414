"""What crops leave open, and deviations that say so, by made-up bodies whose cameras are known."""

import math
from itertools import pairwise

import numpy as np
import pytest
import torch
from cropping import crop_to_box
from trimesh.creation import box as make_box
from trimesh.creation import icosphere as make_icosphere
from trimesh.transformations import random_rotation_matrix
from trimesh.util import concatenate

from silmesh.cameras.calibrate import attempt_calibration
from silmesh.cameras.crop_gauge import aim, find_aim
from silmesh.cameras.frontier import to_maps
from silmesh.cameras.silhouette_coherence import trace
from silmesh.cameras.turntable import orbit_cameras
from silmesh.cameras.turntable_residuals import STEP, VIEW, Turntable
from silmesh.scene.agreement import normalise
from silmesh.softras import soft_silhouettes

SIZE, COUNT = 64, 12


def stand(count, elevation, distance, uneven=0.0):
    """Cameras around an axis that passes beside the object, steps with errors of some degrees."""
    same, rng = torch.ones(count, dtype=torch.float64), np.random.default_rng(7)
    angles = 360 / count * torch.arange(count) + torch.tensor(rng.normal(0, uneven, count))
    names = [f"v{i:02d}" for i in range(count)]
    around = orbit_cameras(names, SIZE, distance * same, elevation * same, angles)
    centre = torch.tensor([0.04, 0.0, -0.03], dtype=torch.float64)
    around.t.add_(around.R @ centre)
    return around


def make_body(seed):
    """A few boxes and ellipsoids: vertices in the sphere of radius 0.5, and faces."""
    rng, parts = np.random.default_rng(seed), []
    for make in (make_box, make_icosphere, make_icosphere)[: rng.integers(2, 4)]:
        part = make()
        for _ in range(3 if make is make_box else 0):
            part = part.subdivide()
        turn = random_rotation_matrix(rng.random(3))[:3, :3]
        part.vertices = part.vertices * rng.uniform(0.2, 0.6, 3) @ turn + rng.uniform(-0.3, 0.3, 3)
        parts.append(part)
    body = concatenate(parts)
    points = body.vertices - body.bounds.mean(axis=0)
    points = points / np.linalg.norm(points, axis=1).max() / 2
    return torch.tensor(np.asarray(points)), torch.tensor(np.asarray(body.faces))


def render(cameras, body):
    seen = cameras.project(body[0]).float()
    return (soft_silhouettes(seen, body[1].long(), (SIZE, SIZE), sigma=1e-8) > 0.5).numpy()


def project(turn, own, crops, ratios):
    """Projection matrices of cropped views: [views, 3, 4]."""
    K, R, t = turn.camera(own)
    cut = np.tile(np.eye(3), (len(crops), 1, 1))
    maps = to_maps(crops, ratios)
    cut[:, 0, 0], cut[:, 1, 1], cut[:, :2, 2] = maps[:, 0, 0], maps[:, 0, 1], maps[:, 1]
    return cut @ K @ np.concatenate([R, t[:, :, None]], axis=2)


def relate(first, second):
    """The fundamental matrix of two cameras, which alone their outlines depend on."""
    centre = np.linalg.svd(first)[2][-1]
    x, y, z = second @ centre
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = across @ second @ np.linalg.pinv(first)
    return matrix / np.linalg.norm(matrix) * np.sign(matrix.flat[np.abs(matrix).argmax()])


@pytest.mark.parametrize("aspect", [1.0, 1.3])
@pytest.mark.parametrize("roll", [0.0, 9.0])
def test_views_of_a_camera_that_is_aimed_elsewhere_are_the_same(roll, aspect):
    rng = np.random.default_rng(1)
    disc = np.hypot(*(np.mgrid[:100, :100] - 50)) < 30
    turn = Turntable(trace(np.stack([disc] * 5), 32, list("abcde")), 100, aspect)
    turn.column = turn.row = 50
    own = np.r_[20.0, roll, 50.0, math.log(math.tan(0.25)), 31.0, np.zeros(5)]
    crops = np.column_stack([rng.normal(0, 5, (5, 2)), rng.normal(0, 0.1, 5)])
    ratios, middles = np.ones((5, 2)), np.full((5, 2), 70.0)
    aimed, moved = aim(turn, own, crops, middles, ratios)
    assert abs(find_aim(turn, aimed, moved, middles, ratios)) < 1e-9
    assert aimed[0] > 22  # the object is seen below the middle, so more steeply
    before, after = project(turn, own, crops, ratios), project(turn, aimed, moved, ratios)
    for (a, b), (c, d) in zip(pairwise(before), pairwise(after), strict=True):
        np.testing.assert_allclose(relate(a, b), relate(c, d), atol=1e-9)
    assert aimed[STEP] == own[STEP]
    assert aimed[VIEW] != own[VIEW]


def measure_errors(seed):
    """Errors of elevation and half angle in said deviations, of a made-up body cropped to 64."""
    rng = np.random.default_rng(seed)
    elevation, body = rng.uniform(5, 40), make_body(seed)
    cropped, _, _ = crop_to_box(stand(COUNT, elevation, rng.uniform(1.8, 3.5)), body[0])
    attempt = attempt_calibration(render(cropped, body), cropped.views, step=360 / COUNT)
    assert len(attempt.figures["crops"]) == COUNT
    focal = np.exp(np.log(cropped.K[:, 0, 0].numpy()).mean())
    true = {"elevation": elevation, "half_angle": math.degrees(math.atan(SIZE / 2 / focal))}
    found = attempt.figures["estimates"]
    return [(found[name]["value"] - value) / found[name]["sd"] for name, value in true.items()]


@pytest.mark.slow
def test_the_truth_lies_within_what_is_said_of_it():
    errors = np.array([measure_errors(seed) for seed in range(500, 510)])
    assert ((np.abs(errors) < 2).sum(axis=0) >= 9).all()


@pytest.mark.slow
def test_steps_that_are_not_even_are_found_with_crops():
    body, told = make_body(505), []
    cropped, _, _ = crop_to_box(stand(16, 20.0, 2.2, uneven=4.0), body[0])
    silhouettes = render(cropped, body)
    attempt = attempt_calibration(silhouettes, cropped.views, step=22.5, progress=told.append)
    assert told == sorted(told)
    assert len({share for share in told if 0.4 <= share < 0.7}) > 10  # while crops are sought
    offsets = np.array(list(attempt.figures["offsets"].values()))
    true = np.random.default_rng(7).normal(0, 4.0, 16)
    assert np.corrcoef(offsets, true)[0, 1] > 0.7
    assert not attempt.figures["disagreeing"]
    assert normalise(attempt.cameras, silhouettes).overall > 0.995


def test_crops_that_cut_the_object_are_told_or_refused():
    body = make_body(503)
    cropped, _, _ = crop_to_box(stand(COUNT, 15.0, 2.2), body[0], margin=-0.15)
    attempt = attempt_calibration(render(cropped, body), cropped.views, step=30.0)
    said = attempt.refusal or "; ".join(attempt.warnings)
    assert "the silhouettes lie along opposite edges of their photographs" in said
    assert "crop it with a small margin" in said
