"""NeRF's transforms.json: as Blender, instant-ngp and nerfstudio write it, and as we do."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scenes import behind_lenses
from shots import HEIGHT, NAMES, POINTS, WIDTH, assert_seen, by_definition, cameras, views

from silmesh.cameras.formats import attempt_from_file
from silmesh.cameras.locate import locate
from silmesh.errors import InputError
from silmesh.geometry.camera import write_cameras
from silmesh.geometry.lens import Lens
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
    given = behind_lenses(GIVEN, [Lens("RADIAL", (0.1, -0.02)), None, None, None])
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
    write_cameras(tmp_path / "c.json", behind_lenses(GIVEN, [Lens("FOV", (0.5,))] * 4))
    argv = ["--cameras", str(tmp_path / "c.json"), "--format", "transforms"]
    with pytest.raises(InputError, match="view 'shot_1': a lens FOV cannot be written"):
        export_cameras.main([*argv, "--output", str(tmp_path / "transforms.json")])
    assert not (tmp_path / "transforms.json").exists()


SPLITS = {"train": (0, 1), "val": (2,), "test": (3,)}


def write_splits(folder, name="./{split}/{view}", splits=SPLITS):
    """transforms_train.json and its siblings, each with some of the views."""
    folder.mkdir(exist_ok=True)
    for split, places in splits.items():
        frames = [
            {
                "file_path": name.format(split=split, view=NAMES[i]),
                "rotation": 0.01,
                "transform_matrix": POSES[i].tolist(),
            }
            for i in places
        ]
        content = json.dumps({"camera_angle_x": 0.7, "frames": frames})
        (folder / f"transforms_{split}.json").write_text(content)
    return folder


def project_blenders() -> np.ndarray:
    focal = WIDTH / 2 / math.tan(0.35)
    return np.stack([project(pose, focal, focal, WIDTH / 2, HEIGHT / 2) for pose in POSES])


def test_the_parts_of_a_synthetic_scene_are_read_together(tmp_path):
    folder = write_splits(tmp_path / "model")
    located = locate(folder)
    assert [file.name[11:] for file in located.files] == ["train.json", "val.json", "test.json"]
    assert_seen(attempt_from_file(folder, views()).cameras, project_blenders())
    assert locate(located.path) == located


def test_one_of_its_files_is_just_that(tmp_path):
    folder = write_splits(tmp_path / "model", splits=SPLITS | {"train": (0, 1, 2)})
    attempt = attempt_from_file(folder / "transforms_train.json", views())
    assert attempt.cameras.views == NAMES[:3]


def test_equal_names_are_told_apart_by_their_folders(tmp_path):
    """As in NeRF's own scenes, where train/r_0 and test/r_0 are different photographs."""
    folder = write_splits(tmp_path / "model", "./{split}/r_0")
    for split in ("train", "val", "test"):
        pose = POSES[SPLITS[split][0]].tolist()
        frames = [
            {"file_path": f"./{split}/{NAMES[i]}", "transform_matrix": pose} for i in range(4)
        ]
        content = json.dumps({"camera_angle_x": 0.7, "frames": frames})
        (folder / f"transforms_{split}.json").write_text(content)
    placed = [
        replace(view, source=str(tmp_path / split / f"{view.view}.png"))
        for view, split in zip(views(), ("test", "train", "val", "test"), strict=True)
    ]
    found = attempt_from_file(folder, placed).cameras
    all_seen = project_blenders()
    assert_seen(found, all_seen[[3, 0, 2, 3]])
    with pytest.raises(InputError, match=r"3 cameras for the view 'shot_1': './train/shot_1', "):
        attempt_from_file(folder, views())


@pytest.mark.parametrize(
    "shared",
    [
        {"fl_x": 2800, "cx": 1280, "cy": 960},
        {"fl_x": 2800, "camera_angle_x": 2 * math.atan(1280 / 2800), "cx": 1324, "cy": 912},
        {"fl_x": 175, "cx": 80, "cy": 60},
    ],
)
def test_a_size_that_is_not_said_but_told(tmp_path, shared):
    scale = shared["fl_x"] / 700
    centre = shared["cx"] / scale, shared["cy"] / scale
    attempt = attempt_from_file(write(tmp_path, shared), views())
    assert_seen(attempt.cameras, np.stack([project(p, 700, 700, *centre) for p in POSES]))
    assert "are scaled to the photographs' 640x480" in attempt.warnings[0]


@pytest.mark.parametrize("shared", [{"cx": 320, "cy": 240}, {"cx": 323.25, "cy": 238}, {}])
def test_pixels_are_the_photographs_where_nothing_tells_otherwise(tmp_path, shared):
    attempt = attempt_from_file(write(tmp_path, {"fl_x": 700} | shared), views())
    centre = shared.get("cx", 320), shared.get("cy", 240)
    assert_seen(attempt.cameras, np.stack([project(p, 700, 700, *centre) for p in POSES]))
    assert attempt.warnings == ()


@pytest.mark.parametrize(
    ("shared", "message"),
    [
        ({"camera_model": "FISHEYE624"}, "camera model 'FISHEYE624' cannot be read"),
        ({"camera_model": "EQUIRECTANGULAR"}, "camera model 'EQUIRECTANGULAR' cannot be read"),
        ({"camera_model": "ORTHOPHOTO"}, "camera model 'ORTHOPHOTO' cannot be read"),
        (
            {"distortion_params": [0.1, 0, 0]},
            r"distortion_params = .* has a lens, a shutter or a projection",
        ),
        ({"ftheta_p0": 0.3}, "ftheta_p0 = 0.3"),
        ({"equirectangular": True}, "equirectangular = True"),
        ({"rolling_shutter": [0, 0.1, 0]}, "rolling_shutter"),
        ({"lens": "fisheye"}, "lens = 'fisheye'"),
        ({"lens_mode": "ftheta"}, "lens_mode = 'ftheta'"),
        ({"camera_type": "ORTHO"}, "camera_type"),
        ({"ortho_scale": 2}, "ortho_scale"),
        ({"distortion_params": [[[0.1]]] * 2}, "distortion_params = "),
        ({"shift_x": 0.1}, "shift_x"),
        ({"k7": 0.1}, "k7 = 0.1"),
        ({"D": [0.1, 0, 0, 0]}, "D = "),
        ({"b1": 0.1}, "b1 = 0.1"),
        ({"k5": 0.1}, "a lens OPENCV has no k5"),
        ({"omega": 0.5}, "a lens OPENCV has no omega"),
    ],
)
def test_a_lens_that_is_not_read_is_named(tmp_path, shared, message):
    path = write(tmp_path, {"fl_x": 700} | shared)
    with pytest.raises(InputError, match=message) as error:
        attempt_from_file(path, views())
    assert str(error.value).startswith(f"{path}: frame 0")


def test_what_says_nothing_of_a_lens_is_let_pass(tmp_path):
    """As nerfstudio and instant-ngp write it: parameters of 0, a model that is a pinhole's."""
    shared = {"fl_x": 700, "camera_model": "PINHOLE", "is_fisheye": False, "k3": 0, "k4": 0}
    shared |= {"distortion_params": [0, 0.0], "rolling_shutter": [0, 0, 0], "lens_mode": "pinhole"}
    shared |= {"applied_transform": [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]], "aabb_scale": 16}
    shared |= {
        "ply_file_path": "a.ply",
        "sharpness": 3,
        "lens": 35.0,
        "orientation_override": "none",
    }
    assert attempt_from_file(write(tmp_path, shared), views()).cameras.lenses == (None,) * 4


@pytest.mark.parametrize("model", ["PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "OPENCV"])
def test_terms_of_a_lens_hold_whatever_its_model_is_called(tmp_path, model):
    """nerfstudio undistorts by them, instant-ngp does not look at the model."""
    path = write(tmp_path, {"fl_x": 700, "camera_model": model, "k1": 0.1, "p2": 0.01})
    assert attempt_from_file(path, views()).cameras.lenses[0] == Lens("OPENCV", (0.1, 0, 0, 0.01))


def test_all_of_opencvs_terms(tmp_path):
    given = {f"k{i}": i / 100 for i in range(1, 7)} | {"p1": 0.001, "p2": 0.002}
    path = write(tmp_path, {"fl_x": 700, "camera_model": "FULL_OPENCV"} | given)
    expected = (0.01, 0.02, 0.001, 0.002, 0.03, 0.04, 0.05, 0.06)
    assert attempt_from_file(path, views()).cameras.lenses[0] == Lens("FULL_OPENCV", expected)
