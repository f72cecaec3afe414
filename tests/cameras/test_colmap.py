from dataclasses import replace

import numpy as np
import PIL.Image  # noqa: F401, before pycolmap
import pycolmap
import pytest
import torch
from scenes import names, turntable
from scipy.spatial.transform import Rotation

from silmesh.cameras.attempt import read_attempt, write_attempt
from silmesh.cameras.colmap import attempt_model, in_order
from silmesh.cameras.stages import Report
from silmesh.geometry.lens import Lens
from silmesh.views import place_view

WIDTH, HEIGHT, SIZE, COUNT = 640, 480, 128, 12
FOCAL, CENTRE = 900.0, (330.0, 230.0)
TURN = Rotation.from_euler("xyz", [70, -40, 130], degrees=True).as_matrix()
SHIFT = np.array([3.0, -7, 5])
POINTS = np.random.default_rng(0).uniform(-0.4, 0.4, (80, 3))


def all_views(count=COUNT, resize="pad"):
    return [place_view(name, "", WIDTH, HEIGHT, SIZE, resize) for name in names(count)]


def report(count=COUNT, **features):
    return Report(
        figures={
            "features": dict.fromkeys(names(count), 100) | features,
            "linked": dict.fromkeys(names(count), 5) | {"v3": 0},
            "models": [count],
        }
    )


def write_model(folder, cameras, points=POINTS, k=0.0):
    """A model of these cameras and points in a world that was turned and shifted."""
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(
            camera_id=1,
            model="SIMPLE_RADIAL",
            width=WIDTH,
            height=HEIGHT,
            params=[FOCAL, *CENTRE, k],
        )
    )
    world = points @ TURN.T + SHIFT
    for number, name in enumerate(cameras.views, start=1):
        R = cameras.R[number - 1].numpy() @ TURN.T
        pose = pycolmap.Rigid3d(np.column_stack([R, cameras.t[number - 1].numpy() - R @ SHIFT]))
        seen = model.cameras[1].img_from_cam(world @ R.T + pose.translation)
        image = pycolmap.Image(name=name, keypoints=seen, camera_id=1, image_id=number)
        model.add_image_with_trivial_frame(image, pose)
    for j, point in enumerate(world):
        track = pycolmap.Track()
        for number in range(1, len(cameras) + 1):
            track.add_element(number, j)
        model.add_point3D(point, track, np.zeros(3, np.uint8))
    model.update_point_3d_errors()
    folder.mkdir()
    model.write(folder)
    return model


@pytest.mark.parametrize("resize", ["pad", "stretch"])
def test_a_point_is_seen_where_the_model_sees_it(tmp_path, resize):
    model = write_model(tmp_path / "m", turntable(COUNT, SIZE, 20))
    views = all_views(resize=resize)
    attempt = attempt_model("colmap", tmp_path / "m", report(), views)
    back = np.array(attempt.figures["colmap_from_world"])
    ours = torch.as_tensor((POINTS @ TURN.T + SHIFT) @ back)  # X of the model = back @ ours
    found = attempt.cameras.project(ours).numpy()
    for number, view in enumerate(views, start=1):
        there = model.images[number].points2D
        theirs = np.array([[*point.xy, 1] for point in there]) @ view.pixel_map.T
        np.testing.assert_allclose(found[number - 1], theirs[:, :2], atol=1e-6)
    assert attempt.cameras.sizes.tolist() == [[SIZE, SIZE]] * COUNT


def test_the_world_is_upright_and_its_first_camera_over_z(tmp_path):
    truth = turntable(COUNT, SIZE, 20)
    write_model(tmp_path / "m", truth)
    attempt = attempt_model("colmap", tmp_path / "m", report(), all_views())
    found = attempt.cameras
    torch.testing.assert_close(found.R, truth.R)
    middle = found.centres.mean(0)
    torch.testing.assert_close(found.centres - middle, truth.centres - truth.centres.mean(0))
    figures = attempt.figures
    assert figures["up_found_by"] == "ring"
    assert (figures["registered"], figures["points"], figures["track_length"]) == (COUNT, 80, COUNT)
    assert figures["reprojection_error"] == pytest.approx(0, abs=1e-6)
    assert figures["in_order"] == 1
    assert figures["azimuths"]["v1"] == pytest.approx(30)
    assert attempt.warnings == ()


def test_the_points_are_kept_in_the_world_of_the_cameras(tmp_path):
    truth = turntable(COUNT, SIZE, 20)
    write_model(tmp_path / "m", truth)
    attempt = attempt_model("colmap", tmp_path / "m", report(), all_views())
    write_attempt(tmp_path / "attempt", attempt)
    points = read_attempt(tmp_path / "attempt").points
    found = attempt.cameras.project(torch.as_tensor(points))
    expected = replace(attempt.cameras, R=truth.R, t=truth.t).project(torch.as_tensor(POINTS))
    torch.testing.assert_close(found, expected)


def test_the_lens_is_kept(tmp_path):
    write_model(tmp_path / "m", turntable(COUNT, SIZE), k=0.05)
    attempt = attempt_model("colmap", tmp_path / "m", report(), all_views())
    assert attempt.cameras.lenses == (Lens("SIMPLE_RADIAL", (0.05,)),) * COUNT


def test_views_without_a_camera_are_dropped_with_the_reason(tmp_path):
    kept = [i for i in range(COUNT) if i not in (2, 3, 4)]
    write_model(tmp_path / "m", turntable(COUNT, SIZE).select(kept))
    attempt = attempt_model("colmap", tmp_path / "m", report(v2=7), all_views())
    assert attempt.cameras.views == tuple(f"v{i}" for i in kept)
    assert attempt.dropped == {
        "v2": "7 features, the others have 100; perhaps blurred",
        "v3": "none of its 100 features fits another photograph",
        "v4": "matches with 5 others do not fit the cameras of the rest",
    }
    assert "3 of 12 photographs have no camera and are left out: v2, v3, v4" in attempt.warnings[0]
    because = {"too few features": 1, "too few matches": 1, "refused by geometry": 1}
    assert attempt.figures["dropped_because"] == because
    told = "(too few features: 1, too few matches: 1, refused by geometry: 1)"
    assert attempt.warnings[0].endswith(told)


def test_how_close_a_view_without_a_camera_came_is_its_reason(tmp_path):
    kept = [i for i in range(COUNT) if i not in (3, 4, 5)]
    write_model(tmp_path / "m", turntable(COUNT, SIZE).select(kept))
    told = report(v3=100).tell(closest={"v3": None, "v4": ["v6", 9], "v5": ["v6", 80]})
    attempt = attempt_model("colmap", tmp_path / "m", told, all_views())
    assert attempt.dropped == {
        "v3": "none of its 100 features fits another photograph",
        "v4": "shares too few points with those that have a camera: 9 with 'v6' at most",
        "v5": "matches with 5 others do not fit the cameras of the rest",
    }
    because = {"too few matches": 2, "refused by geometry": 1}
    assert attempt.figures["dropped_because"] == because


def test_a_model_of_few_views_is_refused_with_its_figures(tmp_path):
    write_model(tmp_path / "m", turntable(COUNT, SIZE).select(range(5)))
    attempt = attempt_model("colmap", tmp_path / "m", report(), all_views())
    assert attempt.cameras is None
    assert "5 of 12 photographs have a camera, from 80 points" in attempt.refusal
    assert "at least 50% should" in attempt.refusal
    assert attempt.figures["registered"] == 5


def test_a_model_of_few_points_is_refused(tmp_path):
    write_model(tmp_path / "m", turntable(COUNT, SIZE), POINTS[:20])
    attempt = attempt_model("colmap", tmp_path / "m", report(), all_views())
    assert "from 20 points" in attempt.refusal
    assert "at least 60 points" in attempt.refusal


def test_cameras_that_look_the_same_way_are_held_by_the_background(tmp_path):
    still = turntable(180, SIZE).select(range(3))  # two degrees apart
    write_model(tmp_path / "m", still)
    attempt = attempt_model("colmap", tmp_path / "m", report(3), all_views(3))
    assert "look the same way to within 4.0 degrees" in attempt.refusal
    assert "a background that stands still" in attempt.refusal


def test_views_out_of_order_are_told_of(tmp_path):
    ring = turntable(COUNT, SIZE).select([0, 3, 1, 5, 2, 8, 4, 10, 6, 11, 7, 9])
    shuffled = replace(ring, views=tuple(names(COUNT)))
    write_model(tmp_path / "m", shuffled)
    attempt = attempt_model("colmap", tmp_path / "m", report(), all_views())
    assert "follow the one before in the same direction" in attempt.warnings[0]


def test_a_refusal_of_an_earlier_stage_is_handed_on(tmp_path):
    attempt = attempt_model("colmap", tmp_path / "none", Report("no features"), all_views())
    assert (attempt.cameras, attempt.refusal) == (None, "no features")


@pytest.mark.parametrize(
    ("azimuth", "share"),
    [([0, 90, 180, -90, 0], 1), ([0, -10, -20, -30], 1), ([0, 10, 5, 15, 20], 0.75)],
)
def test_the_share_of_turns_in_one_direction(azimuth, share):
    assert in_order(torch.tensor(azimuth, dtype=torch.float64)) == share
