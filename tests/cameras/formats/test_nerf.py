"""NeRF's transforms.json: as Blender, instant-ngp and nerfstudio write it, and as we do."""

import json
import math

import numpy as np
import pytest
import torch
from shots import HEIGHT, NAMES, POINTS, WIDTH, assert_seen, by_definition, cameras, views

from silmesh.cameras.camera import write_cameras
from silmesh.cameras.formats import attempt_from_file
from silmesh.cameras.lens import Lens
from silmesh.errors import InputError
from silmesh.steps import export_cameras

GIVEN = cameras()
POSES = np.tile(np.eye(4), (4, 1, 1))  # camera to world, OpenGL: x right, y up, z backwards
POSES[:, :3, 0] = GIVEN.R[:, 0]
POSES[:, :3, 1] = -GIVEN.R[:, 1]
POSES[:, :3, 2] = -GIVEN.R[:, 2]
POSES[:, :3, 3] = GIVEN.centres


def project(pose: np.ndarray, fx: float, fy: float, cx: float, cy: float) -> np.ndarray:
    """By OpenGL's definition: x right, y up, the camera looks along -z."""
    seen = (POINTS - pose[:3, 3]) @ pose[:3, :3]
    return np.stack([cx - fx * seen[:, 0] / seen[:, 2], cy + fy * seen[:, 1] / seen[:, 2]], axis=1)


def write(tmp_path, shared, *frames, names=tuple(f"./train/{n}" for n in NAMES)):
    rows = [
        {"file_path": name, "transform_matrix": pose.tolist()} | frame
        for name, pose, frame in zip(names, POSES, frames or [{}] * 4, strict=True)
    ]
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps(shared | {"frames": rows}))
    return path


def test_blenders(tmp_path):
    path = write(tmp_path, {"camera_angle_x": 0.7})
    attempt = attempt_from_file(path, views())
    focal = WIDTH / 2 / math.tan(0.35)
    expected = [project(pose, focal, focal, WIDTH / 2, HEIGHT / 2) for pose in POSES]
    assert_seen(attempt.cameras, np.stack(expected))
    assert attempt.warnings == ()


def test_nerfstudios_with_a_frame_of_its_own(tmp_path):
    shared = {"camera_model": "OPENCV", "w": WIDTH, "h": HEIGHT, "fl_x": 700, "fl_y": 690}
    shared |= {"cx": 331, "cy": 228, "k1": 0.1, "k2": 0, "p1": 0.01, "p2": -0.02}
    frames = [{}, {"fl_x": 800, "fl_y": 810, "cx": 300, "k1": 0, "p1": 0, "p2": 0}, {}, {"k3": 0.2}]
    names = [f"images/{name}.png" for name in NAMES]
    found = attempt_from_file(write(tmp_path, shared, *frames, names=names), views()).cameras
    expected = [project(pose, 700, 690, 331, 228) for pose in POSES]
    expected[1] = project(POSES[1], 800, 810, 300, 228)
    assert_seen(found, np.stack(expected))
    assert found.lenses == (
        Lens("OPENCV", (0.1, 0, 0.01, -0.02)),
        None,
        Lens("OPENCV", (0.1, 0, 0.01, -0.02)),
        Lens("FULL_OPENCV", (0.1, 0, 0.01, -0.02, 0.2, 0, 0, 0)),
    )


@pytest.mark.parametrize("shared", [{"camera_model": "OPENCV_FISHEYE"}, {"is_fisheye": True}])
def test_a_fisheye(tmp_path, shared):
    path = write(tmp_path, shared | {"fl_x": 300, "k1": 0.1, "k3": 0.2, "p1": 9})
    assert attempt_from_file(path, views()).cameras.lenses[0] == Lens(
        "OPENCV_FISHEYE", (0.1, 0, 0.2, 0)
    )


def test_photographs_that_were_scaled_since(tmp_path):
    path = write(tmp_path, {"w": 2 * WIDTH, "h": 2 * HEIGHT, "fl_x": 1400, "cx": 662, "cy": 456})
    attempt = attempt_from_file(path, views())
    assert_seen(attempt.cameras, np.stack([project(p, 700, 700, 331, 228) for p in POSES]))
    assert attempt.warnings == (
        f"{path}: its cameras for 1280x960 pixels are scaled to the photographs' 640x480",
    )


@pytest.mark.parametrize(
    ("shared", "frame", "message"),
    [
        ({}, {}, r"frame 0 \(./train/shot_1\): should have fl_x, or camera_angle_x"),
        ({"camera_angle_x": 0.7, "w": 800, "h": 800}, {}, "is for 800x800 pixels, but its photog"),
        ({"camera_angle_x": 0.7, "w": 480, "h": 640}, {}, "turned as their EXIF orientation says"),
        ({"camera_angle_x": math.nan}, {}, "camera_angle_x: should be finite numbers"),
        ({"fl_x": -700}, {}, "focal lengths -700 and -700 should be positive: a negative one mirr"),
        ({"fl_x": 700, "k4": 0.1}, {}, "k4 of a lens that is no fisheye cannot be read"),
        ({"fl_x": 700, "camera_model": "X", "k1": 0.1}, {}, "camera model 'X' cannot be read"),
        ({"fl_x": 700}, {"transform_matrix": (POSES[3] * 2).tolist()}, "frame 3.*off by 3, det R"),
        (
            {"fl_x": 700},
            {"transform_matrix": (POSES[3] * [1, 1, -1, 1]).tolist()},
            "det R = -1, so it mirrors: one axis",
        ),
        ({"fl_x": 700}, {"transform_matrix": [[1, 2], [3, 4]]}, "transform_matrix: should be fin"),
        ({"fl_x": 700}, {"transform_matrix": None}, "transform_matrix: should be"),
        ({"fl_x": 700, "w": 0, "h": 480}, {}, "width and height should be whole numbers from 1"),
        ({"fl_x": 700, "w": -640, "h": 480}, {}, "width and height should be whole numbers from"),
        ({"fl_x": 700, "w": [640], "h": 480}, {}, "width and height: should be numbers"),
        ({"fl_x": 0}, {}, "should have fl_x, or camera_angle_x between 0 and pi, not 0"),
        ({"camera_angle_x": 1e-320}, {}, "should have fl_x, or camera_angle_x between 0 and pi"),
        ({"fl_x": 10**400}, {}, "fl_x: should be numbers"),
        ({"fl_x": 1e200}, {}, "fl_x: should be numbers up to"),
        ({"fl_x": {}}, {}, "fl_x: should be numbers"),
    ],
)
def test_a_wrong_file_is_named(tmp_path, shared, frame, message):
    path = write(tmp_path, shared, {}, {}, {}, frame)
    with pytest.raises(InputError, match=message) as error:
        attempt_from_file(path, views())
    assert str(error.value).startswith(str(path))


def test_what_we_write_is_read(tmp_path):
    given = GIVEN.with_lenses([Lens("RADIAL", (0.1, -0.02)), None, None, None])
    write_cameras(tmp_path / "cameras.json", given)
    export_cameras.main(
        [
            *("--cameras", str(tmp_path / "cameras.json"), "--format", "transforms"),
            *("--image", "photos/{view}.jpg", "--output", str(tmp_path / "transforms.json")),
        ]
    )
    content = json.loads((tmp_path / "transforms.json").read_text())
    assert content["fl_x"] == 700  # what all share stands once
    assert content["frames"][2]["file_path"] == "photos/shot_10.jpg"
    found = attempt_from_file(tmp_path / "transforms.json", views()).cameras
    assert_seen(found, given.project(torch.tensor(POINTS)).numpy())
    assert found.lenses[:2] == (Lens("OPENCV", (0.1, -0.02, 0, 0)), None)
    np.testing.assert_allclose(np.array(content["frames"][1]["transform_matrix"]), POSES[1])
    at = by_definition(given.K[0], given.R[0], given.t[0])
    np.testing.assert_allclose(at, project(POSES[0], 700, 690, 331, 228))


def test_a_lens_without_words_for_it(tmp_path):
    write_cameras(tmp_path / "c.json", GIVEN.with_lenses([Lens("FOV", (0.5,))] * 4))
    argv = ["--cameras", str(tmp_path / "c.json"), "--format", "transforms"]
    with pytest.raises(InputError, match="view 'shot_1': a lens FOV cannot be written"):
        export_cameras.main([*argv, "--output", str(tmp_path / "transforms.json")])
    assert not (tmp_path / "transforms.json").exists()
