"""Views that were cropped one by one, found from objects whose cameras and crops are known."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from cropping import crop_to_box
from trimesh.creation import icosphere as make_icosphere

from silmesh.cameras.attempt import FILE, Attempt
from silmesh.cameras.calibrate import attempt_calibration
from silmesh.cameras.crop_signs import are_alike, are_tight, find_margins, see_crops
from silmesh.cameras.frontier import SCALE, Frontier, trace_hulls
from silmesh.cameras.gauss_newton import Problem, minimise
from silmesh.cameras.silhouette_coherence import trace
from silmesh.cameras.turntable import orbit_cameras
from silmesh.errors import InputError
from silmesh.scene.agreement import normalise
from silmesh.scene.conventions import settle
from silmesh.softras import soft_silhouettes
from silmesh.synthetic.dataset import make_object

SIZE = 96


@pytest.fixture(scope="module")
def bear():
    """Vertices and faces."""
    mesh = make_object("bear")
    return torch.tensor(np.asarray(mesh.vertices)), torch.tensor(np.asarray(mesh.faces))


def stand(count, elevation=15.0):
    same = torch.ones(count, dtype=torch.float64)
    angles = 360 / count * torch.arange(count, dtype=torch.float64)
    names = [f"v{i:02d}" for i in range(count)]
    return orbit_cameras(names, SIZE, 2.2 * same, elevation * same, angles)


def render(cameras, bear):
    points, faces = bear
    seen = cameras.project(points).float()
    return (soft_silhouettes(seen, faces.long(), (SIZE, SIZE), sigma=1e-8) > 0.5).numpy()


def touch_boxed(bear, count):
    """Frontier points of views cropped to the object's box, and the scales and shifts of these."""
    cameras = stand(count)
    cropped, scale, shift = crop_to_box(cameras, bear[0])
    outlines = trace(render(cropped, bear), 24, cameras.views)
    camera = tuple(part.numpy() for part in (cameras.K, cameras.R, cameras.t))
    hulls, every = trace_hulls(outlines.distances), np.ones(count, bool)
    return Frontier.of(camera, np.zeros(3), hulls, np.ones((count, 2)), every), scale, shift


def test_frontier_points_agree_at_the_true_crops_alone(bear):
    frontier, scale, shift = touch_boxed(bear, 12)
    crops = np.column_stack([shift, np.log(scale)])
    residuals = frontier.residuals(crops)
    assert np.sqrt((residuals**2).mean()) < 0.25
    crops[3, SCALE] += 0.1
    touched = (frontier.first == 3) | (frontier.second == 3)
    assert np.sqrt((frontier.residuals(crops)[touched] ** 2).mean()) > 1.5
    np.testing.assert_array_equal(frontier.residuals(crops)[~touched], residuals[~touched])


def test_slopes_are_those_of_the_residuals(bear):
    frontier, scale, shift = touch_boxed(bear, 5)
    crops = np.column_stack([shift + 1, np.log(scale) + 0.02])
    slopes = frontier.slopes(crops)
    for view, name in ((0, 1), (3, SCALE)):
        moved = crops.copy()
        moved[view, name] += 1e-4
        change = (frontier.residuals(moved) - frontier.residuals(crops)) / 1e-4
        np.testing.assert_allclose(slopes[:, :, view, name], change, atol=0.05, rtol=0.05)


def test_margins_show_crops():
    silhouettes = np.zeros((5, 40, 40), bool)
    for i in range(5):
        silhouettes[i, 4:36, 10 - i : 30 + i] = True
    frames = np.tile([0, 0, 40, 40], (5, 1))
    assert find_margins(silhouettes, frames)[1].tolist() == [9, 4, 9, 4]
    assert "middle" in see_crops(silhouettes)
    assert not are_tight(silhouettes, None)
    silhouettes[:3] = np.roll(silhouettes[:3], 5, axis=2)
    assert see_crops(silhouettes) == ""
    frames = np.array([[0, i, 40, 40 - i] for i in range(5)])
    assert "5 different sizes" in see_crops(silhouettes, frames, np.ones((5, 2)))


def test_what_touches_opposite_sides_is_tight():
    silhouettes = np.zeros((3, 20, 20), bool)
    silhouettes[:, :, 5:15] = True
    assert are_tight(silhouettes, None)
    silhouettes[:, 19] = False  # touches the top alone, as of an object that the frame cuts
    assert not are_tight(silhouettes, None)


def test_what_differs_in_place_and_size_alone_is_alike():
    y, x = np.mgrid[:64, :64]
    discs = np.stack([(x - 9 - 4 * i) ** 2 + (y - 30) ** 2 < (7 + i) ** 2 for i in range(8)])
    assert are_alike(discs)
    discs[::2] &= (x > 4 * np.arange(0, 8, 2)[:, None, None]) & (y > 28)  # halves of every other
    assert not are_alike(discs)


@pytest.mark.slow
def test_a_turntable_of_crops_is_found(bear):
    cameras = stand(20)
    cropped, scale, _ = crop_to_box(cameras, bear[0])
    silhouettes = render(cropped, bear)
    attempt = attempt_calibration(silhouettes, cameras.views, step=18.0)
    assert any("cropped one by one" in said for said in attempt.warnings)
    assert normalise(attempt.cameras, silhouettes).overall > 0.98
    estimate = attempt.figures["estimates"]["elevation"]
    assert abs(estimate["value"] - 15) < min(2 * estimate["sd"], 3)
    found = np.array([attempt.figures["crops"][view]["scale"] for view in cameras.views])
    sd = attempt.figures["crops"]["v00"]["scale_sd"]
    assert 0.001 < sd < 0.02
    true = scale / np.exp(np.log(scale).mean())
    assert np.abs(found / true - 1).max() < 0.02


@pytest.mark.slow
def test_crops_of_what_is_nearly_round_are_found_where_one_turntable_explains_it_too():
    mesh = make_icosphere(subdivisions=3)
    points = np.asarray(mesh.vertices) * [0.3, 0.5, 0.18]
    points[points[:, 1] > 0.2] *= [0.6, 1, 0.6]  # a shoulder
    body = torch.tensor(points), torch.tensor(np.asarray(mesh.faces))
    cameras = stand(20)
    cropped, _, _ = crop_to_box(cameras, body[0])
    silhouettes = render(cropped, body)
    attempt = attempt_calibration(silhouettes, cameras.views, step=18.0)
    assert "crops" in attempt.figures
    assert normalise(attempt.cameras, silhouettes).overall > 0.998  # 0.992 without crops


@pytest.mark.slow
def test_crops_are_found_where_the_step_is_not_known(bear):
    cameras = stand(24)
    silhouettes = render(crop_to_box(cameras, bear[0])[0], bear)
    attempt = attempt_calibration(silhouettes, cameras.views)
    assert abs(abs(attempt.figures["estimates"]["step"]["value"]) - 15) < 0.2
    assert len(attempt.figures["crops"]) == 24
    assert normalise(attempt.cameras, silhouettes).overall > 0.98


def test_a_turntable_that_was_not_cropped_has_no_crops(bear):
    cameras = stand(16)
    t = cameras.t + torch.tensor([0.05, -0.03, 0], dtype=torch.float64)
    silhouettes = render(replace(cameras, t=t), bear)
    attempt = attempt_calibration(silhouettes, cameras.views, step=22.5)
    assert attempt.cameras is not None
    assert "crops" not in attempt.figures


@pytest.mark.slow
def test_cameras_of_a_file_are_mended_where_photographs_were_cropped_since(bear):
    cameras = stand(14)
    cropped, scale, _ = crop_to_box(cameras, bear[0])
    silhouettes = render(cropped, bear)
    attempt = Attempt(FILE, cameras, figures={"file": "cameras.json"})
    settled, normalised = settle(attempt, silhouettes)
    assert normalised.overall > 0.98
    assert "cropped since" in settled.warnings[-1]
    assert len(settled.figures["crops"]) == 14
    ratio = np.array([crop["scale"] for crop in settled.figures["crops"].values()]) / scale
    assert np.ptp(ratio) / ratio.mean() < 0.05


def test_cameras_that_agree_are_left_alone(bear):
    cameras = stand(10)
    attempt = Attempt(FILE, cameras, figures={"file": "cameras.json"})
    settled, _ = settle(attempt, render(cameras, bear))
    assert settled.cameras is cameras
    assert not settled.warnings
    assert "crops" not in settled.figures


@pytest.mark.slow
def test_crops_that_cut_the_object_are_refused(bear):
    cameras = stand(16)
    silhouettes = render(crop_to_box(cameras, bear[0], margin=-0.15)[0], bear)
    attempt = attempt_calibration(silhouettes, cameras.views)
    assert attempt.cameras is not None  # rays that leave the frames contradict nothing
    with pytest.raises(InputError, match=r"the crops cut it.* fills more than 0\.\d\d of the sil"):
        settle(attempt, silhouettes)


def test_what_no_residual_depends_on_stays():
    """As a step does, where the rays leave all frames."""
    slopes = np.array([[1.0, 0.0], [2.0, 0.0]])
    problem = Problem(
        lambda x: slopes @ x - [3, 6],
        lambda x: slopes,
        np.ones(2),
        np.zeros(2),
        np.zeros(2),
        np.full(2, -np.inf),
        np.full(2, np.inf),
    )
    np.testing.assert_allclose(minimise(problem, np.array([0.0, 5.0]), 50), [3, 5], atol=1e-3)
