"""Turntables whose geometry is known, found from made-up objects' silhouettes."""

import math

import damage
import numpy as np
import pytest
import torch
from scenes import silhouettes as ellipsoid
from scenes import turntable

from silmesh.cameras.attempt import read_attempt, write_attempt
from silmesh.cameras.calibrate import (
    Estimate,
    _warn_of_rivals,
    attempt_calibration,
    calibrate,
)
from silmesh.cameras.turntable import orbit_cameras
from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras
from silmesh.geometry.silhouette_iou import coherence
from silmesh.geometry.visual_hull import carve
from silmesh.naming import match_masks
from silmesh.scene.scene import find_similarity
from silmesh.silhouettes import read_silhouettes, write_silhouettes
from silmesh.softras import soft_silhouettes
from silmesh.synthetic.dataset import make_object
from silmesh.views import find_images, write_views

SIZE = 128


def stand(angles, elevation=12.0, roll=1.2, half_angle=10.0, shift=(0.06, -0.04), size=SIZE):
    """A camera that looks past the axis, leaning to its right; angles in degrees."""
    names = [f"v{i}" for i in range(len(angles))]
    a = torch.as_tensor(np.asarray(angles, dtype=float))
    plain = orbit_cameras(names, size, torch.full_like(a, 3), torch.full_like(a, elevation), a)
    c, s = math.cos(math.radians(roll)), math.sin(math.radians(roll))
    lean = torch.tensor([[c, -s, 0], [s, c, 0], [0, 0, 1]], dtype=torch.float64)
    tan = math.tan(math.radians(half_angle))
    K = plain.K.clone()
    K[:, 0, 0] = K[:, 1, 1] = size / 2 / tan
    t = torch.tensor([*shift, 0.8 / tan], dtype=torch.float64) * torch.tensor([1.6, 1.6, 1])
    return Cameras(plain.views, plain.sizes, K, lean @ plain.R, t.repeat(len(a), 1))


def render(name: str, cameras: Cameras) -> np.ndarray:
    mesh = make_object(name)
    points = cameras.project(torch.tensor(np.asarray(mesh.vertices))).float()
    faces = torch.tensor(np.asarray(mesh.faces), dtype=torch.int64)
    width, height = cameras.sizes[0].tolist()
    return (soft_silhouettes(points, faces, (height, width), sigma=1e-8) > 0.5).numpy()


def axis_at(cameras: Cameras, row: float) -> float:
    """The column at which the world's axis y passes a row."""
    ends = torch.tensor([[0, -0.1, 0], [0, 0.1, 0]], dtype=torch.float64)
    (u0, v0), (u1, v1) = cameras.select([0]).project(ends)[0].tolist()
    return u0 + (row - v0) * (u1 - u0) / (v1 - v0)


@pytest.fixture(scope="module")
def bear():
    """Twelve views of the bear, which turns backwards."""
    cameras = stand(-30 * np.arange(12))
    return cameras, render("bear", cameras)


@pytest.fixture(scope="module")
def found(bear):
    cameras, seen = bear
    return calibrate(seen, cameras.views, step=30)


def test_a_turntable_is_found(bear, found):
    cameras, _ = bear
    e = found.estimates
    assert e["axis"].value == pytest.approx(axis_at(cameras, found.row), abs=0.5)
    assert e["elevation"].value == pytest.approx(12, abs=1)
    assert e["roll"].value == pytest.approx(1.2, abs=0.5)
    assert (e["step"].value, e["step"].status) == (-30, "given")
    assert found.direction_certain
    assert found.rms < 0.4


def test_the_cameras_are_those_of_the_estimates(bear, found):
    """The axis as the cameras project it, and the turn from one to the next."""
    assert axis_at(found.cameras, found.row) == pytest.approx(found.estimates["axis"].value)
    R = found.cameras.R
    turn = R[0].mT @ R[1]  # about y by the step
    assert math.degrees(math.atan2(turn[2, 0], turn[0, 0])) == pytest.approx(-30)
    assert found.cameras.centres[:, 1].std() < 1e-12
    assert found.cameras.views == bear[0].views


def test_found_cameras_agree_with_the_silhouettes(bear, found):
    _, seen = bear
    cameras = found.cameras.in_world_of(find_similarity(found.cameras, seen))
    assert coherence(carve(seen, cameras, 64), cameras, seen).mean() > 0.95


def test_a_view_without_a_silhouette_keeps_its_place(bear, found):
    cameras, seen = bear
    lacking = seen.copy()
    lacking[[0, 7]] = False
    less = calibrate(lacking, cameras.views, step=30)
    assert less.cameras.views == cameras.views
    assert (less.view_rms[[0, 7]] == 0).all()
    assert less.estimates["elevation"].value == pytest.approx(
        found.estimates["elevation"].value, abs=1
    )
    turned = less.cameras.R @ found.cameras.R.mT  # by nothing, for every view
    angles = torch.rad2deg(
        torch.arccos(((turned.diagonal(dim1=1, dim2=2).sum(1) - 1) / 2).clip(-1, 1))
    )
    assert angles.max() < 1.5


@pytest.fixture(scope="module")
def shaken():
    """A turntable that errs by half a degree from view to view."""
    jitter = np.random.default_rng(3).normal(0, 0.5, 36)
    cameras = stand(10 * np.arange(36) + jitter)
    return jitter, calibrate(render("plane", cameras), cameras.views, step=10)


def test_errors_of_the_steps_are_found(shaken):
    jitter, found = shaken
    error = found.offsets - jitter
    assert error.std() < 0.6 * jitter.std()
    assert np.corrcoef(found.offsets, jitter)[0, 1] > 0.8


def test_even_steps_are_left_alone(found):
    assert not found.offsets.any()


@pytest.mark.parametrize("arc", [pytest.param(360, marks=pytest.mark.slow), 180])
def test_an_unknown_step_is_found(arc):
    cameras = stand(0.97 * arc / 16 * np.arange(16), size=64)
    told = []
    found = calibrate(render("plane", cameras), cameras.views, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1
    assert found.estimates["step"].value == pytest.approx(0.97 * arc / 16, rel=0.02)
    assert found.estimates["step"].status == "found"


def test_a_stretched_photograph():
    square = stand(30 * np.arange(12))
    wide = torch.tensor([[1.0, 0, 0], [0, 4 / 3, 0], [0, 0, 1]], dtype=torch.float64)
    lift = torch.tensor([[1.0, 0, 0], [0, 1, -SIZE / 8], [0, 0, 1]], dtype=torch.float64)
    cameras = square.in_pixels_of((wide @ lift).expand(12, 3, 3), square.sizes)
    found = calibrate(render("bear", cameras), cameras.views, step=30, aspect=4 / 3)
    assert found.estimates["elevation"].value == pytest.approx(12, abs=1)
    assert found.estimates["axis"].value == pytest.approx(axis_at(cameras, found.row), abs=0.5)
    K = found.cameras.K[0]
    assert K[1, 1] / K[0, 0] == pytest.approx(4 / 3)


@pytest.mark.parametrize(
    ("name", "count", "settings"),
    [
        ("plane", 12, {"elevation": 26, "roll": -2, "half_angle": 18, "shift": (0.1, 0.05)}),
        ("tube", 36, {"elevation": 6, "roll": 2, "half_angle": 6, "shift": (-0.1, 0)}),
        pytest.param("bear", 72, {"elevation": 18, "half_angle": 14}, marks=pytest.mark.slow),
        pytest.param(
            "tube", 72, {"elevation": 9, "half_angle": 8, "roll": -1}, marks=pytest.mark.slow
        ),
    ],
)
def test_other_turntables_are_found(name, count, settings):
    cameras = stand(360 / count * np.arange(count), **settings)
    found = calibrate(render(name, cameras), cameras.views, step=360 / count)
    e = found.estimates
    assert e["axis"].value == pytest.approx(axis_at(cameras, found.row), abs=0.5)
    assert e["elevation"].value == pytest.approx(settings["elevation"], abs=1)
    assert e["step"].value > 0


def test_what_is_known_is_kept(bear):
    cameras, seen = bear
    e = calibrate(seen, cameras.views, step=30, elevation=12).estimates
    assert (e["elevation"].value, e["elevation"].sd) == (12, 0)
    assert e["elevation"].status == "given"
    assert e["axis"].value == pytest.approx(axis_at(cameras, 64), abs=1)


def test_a_calibration_is_written_as_an_attempt(bear, tmp_path):
    cameras, seen = bear
    write_attempt(tmp_path / "found", attempt_calibration(seen, cameras.views, step=30))
    found = read_attempt(tmp_path / "found")
    assert found.figures["estimates"]["step"] == {"value": -30, "sd": 0, "status": "given"}
    assert list(found.figures["view_rms"]) == list(found.cameras.views) == list(cameras.views)


def test_a_refused_calibration_is_an_attempt_too(tmp_path):
    refused = attempt_calibration(np.ones((2, 16, 16), bool), ["a", "b"])
    write_attempt(tmp_path / "refused", refused)
    assert read_attempt(tmp_path / "refused") == refused
    assert refused.cameras is None
    assert refused.refusal.startswith("cameras 'calibrate': there are 2 views")


def test_a_ball_on_the_axis_fixes_neither_elevation_nor_perspective():
    cameras = turntable(12, 64)
    found = calibrate(ellipsoid(cameras, (0.3, 0.3, 0.3)), cameras.views, step=30)
    status = {name: e.status for name, e in found.estimates.items()}
    assert status["elevation"] == status["half_angle"] == "open"
    assert found.estimates["axis"].value == pytest.approx(32, abs=0.3)
    assert status["axis"] == "found"
    assert not found.direction_certain
    assert [w for w in found.warnings if "all silhouettes are the same" in w] == [*found.warnings]


def test_a_thing_on_a_lathe_fixes_nothing_but_its_axis():
    """A spheroid off the middle: a camera at any lower elevation explains it as well."""
    cameras = turntable(12, 64, elevation=25)
    found = calibrate(ellipsoid(cameras, (0.2, 0.35, 0.2)), cameras.views, step=30)
    e = found.estimates
    assert (e["axis"].status, e["roll"].status) == ("found", "found")
    assert (e["elevation"].status, e["half_angle"].status) == ("open", "open")
    assert not found.direction_certain
    assert "turned on a lathe" in found.warnings[0]


LOW = {"elevation": -20.0, "half_angle": 18.0}


@pytest.fixture(scope="module")
def from_below():
    """The bear seen from below the table with a wide view."""
    cameras = stand(30 * np.arange(12), **LOW)
    return cameras, render("bear", cameras)


@pytest.mark.parametrize("above_table", [True, False])
def test_perspective_tells_a_camera_below_the_table(from_below, above_table):
    cameras, seen = from_below
    found = calibrate(seen, cameras.views, step=30, above_table=above_table)
    assert found.mirror == "perspective"
    assert found.estimates["elevation"].value == pytest.approx(-20, abs=1)
    assert found.estimates["step"].value > 0
    assert "looks up at the table" in " ".join(found.warnings)


def test_far_away_the_table_tells_the_mirror_image():
    """With next to no perspective a camera below fits as well."""
    cameras = stand(30 * np.arange(12), elevation=-20.0, half_angle=1.0, size=64)
    seen = render("bear", cameras)
    above = calibrate(seen, cameras.views, step=30)
    assert above.mirror == "table"
    assert above.estimates["elevation"].value == pytest.approx(20, abs=2)
    assert above.estimates["step"].value < 0
    free = calibrate(seen, cameras.views, step=30, above_table=False)
    assert free.mirror == "open"
    assert abs(free.estimates["elevation"].value) == pytest.approx(20, abs=2)
    assert "mirrored" in " ".join(free.warnings)


def test_a_known_distance_is_weighed_in():
    """The ball fixes no perspective; its size is 0.6, and it stands 2.732 away."""
    cameras = turntable(12, 64)
    seen = ellipsoid(cameras, (0.3, 0.3, 0.3))
    found = calibrate(seen, cameras.views, step=30, distance=2.732 / 0.6)
    assert found.estimates["half_angle"].value == pytest.approx(15, abs=2)


def test_steps_that_explain_as_much_are_named():
    """A square prism looks the same after a quarter turn: 10 degrees a view, or 80 back."""
    estimates = {
        "elevation": Estimate(12.0, 0.1, "found"),
        "step": Estimate(10.0, 0.1, "found"),
    }
    rivals = [np.array([12.0, 0, 64, -1.7, step]) for step in (80.0, 10.1)]
    said = _warn_of_rivals(estimates, rivals, True, "perspective")
    assert said == [
        "steps of 10 and 80 degrees explain the silhouettes as well; if you know the step, "
        "give it: turntable ',,step'"
    ]


@pytest.mark.slow
def test_a_photograph_that_came_twice_is_named(bear):
    _, seen = bear
    order = [0, 1, 2, 3, 4, 5, 5, 6, 7, 8, 9, 10, 11]
    names = [f"p{i}" for i in range(13)]
    attempt = attempt_calibration(seen[order], names, step=30)
    said = " ".join(attempt.warnings) + (attempt.refusal or "")
    assert "'p5' and 'p6' show the same silhouette" in said


@pytest.mark.slow
def test_views_out_of_order(bear):
    cameras, seen = bear
    order = np.random.default_rng(1).permutation(12)
    with pytest.raises(InputError, match=r"no turntable explains.*in the order in which"):
        calibrate(seen[order], cameras.views, step=30)


def test_an_object_that_the_frame_cuts():
    """The bear's feet are below the frame in all views."""
    cameras = stand(30 * np.arange(12), shift=(0.03, 0.24))
    seen = render("bear", cameras)
    assert seen[:, -1].any(axis=1).all()
    found = calibrate(seen, cameras.views, step=30)
    assert found.estimates["elevation"].value == pytest.approx(12, abs=1.5)
    assert found.estimates["axis"].value == pytest.approx(axis_at(cameras, found.row), abs=0.5)
    assert found.warnings[0] == (
        "the frame cuts the object in 12 of 12 views: 'v0', 'v1', 'v2' and 9 more"
    )


def test_an_object_that_the_frame_of_a_padded_photograph_cuts():
    """The photograph ends above the end of its square image, and the bear's feet below it."""
    cameras = stand(30 * np.arange(12), shift=(0.03, 0.0))
    seen = render("bear", cameras)
    below = int(np.flatnonzero(seen.any(axis=(0, 2))).max()) - 14
    seen[:, below:] = False
    frames = np.tile([0, SIZE - below, SIZE, below], (12, 1))
    blind = attempt_calibration(seen, cameras.views, step=30)
    assert not any("frame cuts" in warning for warning in blind.warnings)
    found = calibrate(seen, cameras.views, step=30, frames=frames)
    assert found.rms < blind.figures["rms"]
    assert found.estimates["elevation"].value == pytest.approx(12, abs=1.5)
    assert found.warnings[0].startswith("the frame cuts the object in 12 of 12 views")
    assert found.estimates["axis"].value == pytest.approx(axis_at(cameras, found.row), abs=0.5)


def test_a_full_silhouette_is_named(bear):
    cameras, seen = bear
    full = seen.copy()
    full[4] = True
    attempt = attempt_calibration(full, cameras.views, step=30)
    assert attempt.figures["disagreeing"] == {"v4": "it fills its photograph"}
    assert attempt.warnings[0] == (
        "the silhouettes of 1 of 12 views disagree with the turntable that the others agree on, "
        "and had no say: 'v4' (it fills its photograph)"
    )
    assert attempt.cameras.views == cameras.views


def bite(seen: np.ndarray, share: float, at: int) -> np.ndarray:
    """The silhouette without a disc about a pixel of its outline that holds a share of it."""
    rows, columns = np.nonzero(seen)
    edge = np.argmax(columns) if at % 2 else np.argmin(columns)
    distance = np.hypot(rows - rows[edge], columns - columns[edge])
    gone = np.argsort(distance)[: round(share * len(rows))]
    out = seen.copy()
    out[rows[gone], columns[gone]] = False
    return out


@pytest.fixture(scope="module")
def plane():
    """24 views of the plane."""
    cameras = stand(15 * np.arange(24), elevation=17, size=96)
    return cameras, render("plane", cameras)


def assert_found(found, cameras, elevation):
    assert found.estimates["axis"].value == pytest.approx(axis_at(cameras, found.row), abs=0.5)
    assert found.estimates["elevation"].value == pytest.approx(elevation, abs=1)
    assert found.estimates["step"].value > 0


@pytest.mark.slow
def test_bitten_silhouettes_have_no_say_and_are_named(plane):
    cameras, seen = plane
    bitten, wrong = seen.copy(), [2, 3, 9, 16, 21]
    for i in wrong:
        bitten[i] = bite(seen[i], 0.15, i)
    found = calibrate(bitten, cameras.views, step=15)
    assert_found(found, cameras, 17)
    assert list(found.disagreeing) == [f"v{i}" for i in wrong]
    assert found.rms < 0.4
    assert found.view_rms[wrong].min() > 2 * np.delete(found.view_rms, wrong).max()
    assert found.cameras.views == cameras.views
    assert found.warnings[0].startswith("the silhouettes of 5 of 24 views disagree")
    assert f"'v2' (it disagrees by {found.view_rms[2]:.2g} pixels)" in found.warnings[0]


@pytest.mark.slow
def test_bites_in_small_images_leave_a_turntable():
    """Seven of 36 views are bitten at random; outlines of 64 pixels are rough themselves."""
    cameras = stand(10 * np.arange(36), elevation=10, roll=0, half_angle=16, shift=(0, 0), size=64)
    bitten, _ = damage.bite(render("plane", cameras), 0.15, 0.2, seed=0)
    assert_found(calibrate(bitten, cameras.views), cameras, 10)


@pytest.mark.slow
def test_wrong_silhouettes_are_named_and_empty_ones_are_not(plane):
    cameras, seen = plane
    swapped, other = seen.copy(), render("pot", cameras)
    swapped[[1, 12, 18]] = other[[1, 12, 18]]
    swapped[6], swapped[14] = True, False
    found = calibrate(swapped, cameras.views, step=15)
    assert_found(found, cameras, 17)
    assert set(found.disagreeing) == {"v1", "v6", "v12", "v18"}
    assert found.disagreeing["v6"] == "it fills its photograph"
    assert found.view_rms[14] == 0


def test_no_view_of_a_sound_turntable_disagrees(found):
    assert found.disagreeing == {}


@pytest.mark.slow
def test_views_that_most_contradict_are_refused_with_how_many_agree(plane):
    cameras, seen = plane
    order = np.random.default_rng(2).permutation(24)
    with pytest.raises(InputError, match=r"no turntable explains more than \d+ of the 24"):
        calibrate(seen[order], cameras.views, step=15)


def test_silhouettes_that_fill_most_photographs_are_refused(bear):
    cameras, seen = bear
    full = seen.copy()
    full[:7] = True
    with pytest.raises(InputError, match="7 of the 12 silhouettes fill their photographs"):
        calibrate(full, cameras.views, step=30)


def test_two_views_with_a_silhouette():
    seen = np.zeros((4, 16, 16), bool)
    seen[[0, 2]] = True
    with pytest.raises(InputError, match="there are 2 views with a silhouette; it takes at least"):
        calibrate(seen, ["a", "b", "c", "d"])


def test_views_of_different_things():
    random = np.random.default_rng(0)
    y, x = np.mgrid[:64, :64]
    seen = np.stack(
        [(x - u) ** 2 + (y - v) ** 2 < 8**2 for u, v in random.uniform(12, 52, (12, 2))]
    )
    with pytest.raises(InputError, match="no turntable explains these silhouettes"):
        calibrate(seen, [str(i) for i in range(12)], step=30)


@pytest.mark.slow
@pytest.mark.data
def test_the_moisturiser(data, tmp_path):
    """The report's cameras reach 0.82."""
    images = find_images(data / "aloi_moisturiser" / "png2" / "moisturiser")
    masks, _ = match_masks(images, find_images(data / "aloi_moisturiser" / "mask2" / "moisturiser"))
    views = write_views(images, 256, "pad", tmp_path / "views")
    write_silhouettes("mask", views, tmp_path / "views", masks, tmp_path / "silhouettes")
    names = [view.view for view in views]
    seen = read_silhouettes(tmp_path / "silhouettes", names)
    found = calibrate(seen, names, step=5)
    cameras = found.cameras.in_world_of(find_similarity(found.cameras, seen))
    assert coherence(carve(seen, cameras), cameras, seen).mean() > 0.975
    assert found.direction_certain
