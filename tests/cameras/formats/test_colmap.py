"""COLMAP models: written by COLMAP itself, text and binary, and by us; truncated ones."""

import numpy as np
import PIL.Image  # noqa: F401, before pycolmap
import pycolmap
import pytest
import torch
from shots import HEIGHT, NAMES, POINTS, WIDTH, assert_seen, by_definition, cameras, views

from silmesh.cameras.camera import Cameras, read_cameras, write_cameras
from silmesh.cameras.formats import attempt_from_file, colmap
from silmesh.cameras.lens import CURVED, Lens
from silmesh.errors import InputError
from silmesh.steps import export_cameras

LENSES = [
    ("PINHOLE", [700, 690, 331, 228]),
    ("SIMPLE_RADIAL", [700, 331, 228, 0.1]),
    ("OPENCV", [700, 690, 331, 228, 0.1, -0.02, 0.003, 0.001]),
    ("THIN_PRISM_FISHEYE", [700, 690, 331, 228, 0.1, 0, 0.01, 0, 0, 0, 0.02, 0.01]),
]


@pytest.fixture
def made():
    """A reconstruction by COLMAP: an image of each name, a camera of each model, some points."""
    found = pycolmap.Reconstruction()
    given = cameras()
    for i, (model, values) in enumerate(LENSES):
        camera = pycolmap.Camera(
            model=model, width=WIDTH, height=HEIGHT, params=values, camera_id=i + 1
        )
        found.add_camera_with_trivial_rig(camera)
        pose = np.c_[given.R[i].numpy(), given.t[i].numpy()]
        image = pycolmap.Image(name=f"left/{NAMES[i]}.png", camera_id=i + 1, image_id=i + 1)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(np.array([3.0, 4]))] * i)
        found.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose))
    return found


@pytest.mark.parametrize("write", ["write_text", "write_binary"])
@pytest.mark.parametrize("within", ["", "sparse/0", "0"])
def test_a_model_of_colmaps_own(made, tmp_path, write, within):
    (tmp_path / within).mkdir(parents=True, exist_ok=True)
    getattr(made, write)(tmp_path / within)
    attempt = attempt_from_file(tmp_path, views())
    assert attempt.figures["format"] == "a COLMAP model"
    assert attempt.cameras.views == NAMES
    expected = []
    for i, (model, values) in enumerate(LENSES):
        K = made.cameras[i + 1].calibration_matrix()
        pose = made.images[i + 1].cam_from_world().matrix()
        expected.append(by_definition(K, pose[:, :3], pose[:, 3]))
        lens = attempt.cameras.lenses[i]
        assert (lens and lens.model) == (None if model == "PINHOLE" else model)
        assert lens is None or list(lens.parameters) == values[-len(CURVED[model]) :]
    assert_seen(attempt.cameras, np.stack(expected))


def test_what_a_camera_sees_through_its_lens_is_what_colmap_projects(made, tmp_path):
    made.write_binary(tmp_path)
    found = attempt_from_file(tmp_path, views()).cameras
    i = 2
    pose = made.images[i + 1].cam_from_world().matrix()
    seen = POINTS @ pose[:, :3].T + pose[:, 3]
    expected = np.asarray(made.cameras[i + 1].img_from_cam(seen)) / 10 + [0, 8]
    K = found.K[i].numpy()
    bent = found.lenses[i].distort(seen[:, :2] / seen[:, 2:])
    np.testing.assert_allclose(bent @ K[:2, :2].T + K[:2, 2], expected, atol=1e-9)


@pytest.mark.parametrize("file", ["images.txt", "cameras.txt"])
def test_a_file_of_the_model_stands_for_it(made, tmp_path, file):
    made.write_text(tmp_path)
    assert len(attempt_from_file(tmp_path / file, views()).cameras) == 4


@pytest.mark.parametrize(
    ("name", "cut"), [("images.bin", 30), ("images.bin", 5), ("cameras.bin", 9)]
)
def test_a_truncated_model(made, tmp_path, name, cut):
    made.write_binary(tmp_path)
    data = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(data[: len(data) - cut])
    with pytest.raises(InputError, match=rf"{name}: is truncated, or no binary COLMAP model: has "):
        attempt_from_file(tmp_path, views())


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("cameras.txt", "OPENCV", "EUCM", "camera 3.*camera model 'EUCM' cannot be read"),
        ("cameras.txt", "700 690 331 228\n", "nan 690 331 228\n", "camera 1: should be finite"),
        ("cameras.txt", "700 690 331 228\n", "700 -690 331 228\n", "should be positive: a negat"),
        ("images.txt", " 2 left/shot_2.png", " 7 left/shot_2.png", "has camera 7, which the model"),
        ("images.txt", "left/shot_1.png", "", "an image should be IMAGE_ID QW"),
        ("images.txt", " 2 left/shot_2.png", " x left/shot_2.png", "CAMERA_ID should be a number"),
    ],
)
def test_a_wrong_model_is_named(made, tmp_path, file, old, new, message):
    made.write_text(tmp_path)
    text = (tmp_path / file).read_text()
    assert text.count(old) == 1, text
    (tmp_path / file).write_text(text.replace(old, new))
    with pytest.raises(InputError, match=message):
        attempt_from_file(tmp_path, views())


def test_the_format_is_colmaps(tmp_path):
    """What we write is read by COLMAP and by us, with a lens that has one focal length no more."""
    given = cameras().with_lenses(
        [None, Lens("RADIAL", (0.1, -0.02)), Lens("FOV", (0.5,)), Lens("RADIAL_FISHEYE", (0.1, 0))]
    )
    write_cameras(tmp_path / "cameras.json", given)
    arguments = ["--cameras", tmp_path / "cameras.json", "--format", "colmap", "--output"]
    export_cameras.main([*map(str, [*arguments, tmp_path / "model"])])
    theirs = pycolmap.Reconstruction(tmp_path / "model")
    assert [theirs.cameras[i].model_name for i in (1, 2, 3, 4)] == [
        *("PINHOLE", "OPENCV", "FOV", "OPENCV_FISHEYE")
    ]
    assert theirs.images[2].name == f"{NAMES[1]}.png"
    seen = POINTS @ given.R[1].numpy().T + given.t[1].numpy()
    expected = given.lenses[1].distort(seen[:, :2] / seen[:, 2:]) * [700, 690] + [331, 228]
    np.testing.assert_allclose(theirs.cameras[2].img_from_cam(seen), expected, atol=1e-9)
    found = attempt_from_file(tmp_path / "model", views()).cameras
    assert_seen(found, given.project(torch.tensor(POINTS)).numpy())


def test_our_own_file_keeps_the_lens(tmp_path):
    given = cameras().with_lenses([None, Lens("RADIAL", (0.1, -0.02)), None, Lens("FISHEYE", ())])
    write_cameras(tmp_path / "cameras.json", given)
    assert read_cameras(tmp_path / "cameras.json").lenses == given.lenses
    text = (tmp_path / "cameras.json").read_text()
    (tmp_path / "cameras.json").write_text(text.replace("[0.1, -0.02]", "[0.1, NaN]"))
    with pytest.raises(InputError, match=r"camera 1 \(shot_2\): lens: parameters should be finite"):
        read_cameras(tmp_path / "cameras.json")


def test_a_skew_cannot_be_written(tmp_path):
    given = cameras()
    K = given.K.clone()
    K[2, 0, 1] = 20
    skewed = Cameras(given.views, given.sizes, K, given.R, given.t)
    with pytest.raises(InputError, match="view 'shot_10': its K has a skew of 20, which moves"):
        colmap.write(tmp_path / "model", skewed, {view: view for view in given.views})
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1 PINHOLE 640 480", "a camera should be CAMERA_ID MODEL WIDTH HEIGHT PARAMS"),
        ("1", "a camera should be CAMERA_ID MODEL WIDTH HEIGHT PARAMS"),
        ("1 PINHOLE 640 480 700", "PINHOLE has 1 parameters, which are too few"),
        ("x PINHOLE 640 480 7 7 3 2", "CAMERA_ID should be a number, not 'x'"),
        ("1" * 5000 + " PINHOLE 640 480 7 7 3 2", "CAMERA_ID should be a number, not '1111"),
        ("1 PINHOLE 0 480 7 7 3 2", "should be whole numbers from 1 to 1,000,000, not 0 and 480"),
        ("1 PINHOLE 640 -480 7 7 3 2", "should be whole numbers from 1 to"),
        ("1 PINHOLE 640.5 480 7 7 3 2", "should be whole numbers from 1 to"),
        ("1 PINHOLE nan 480 7 7 3 2", "width and height: should be finite numbers"),
        ("1 PINHOLE 1e9 480 7 7 3 2", "should be whole numbers from 1 to"),
        ("2 PINHOLE 640 480 7 7 3 2", "has camera 2 twice"),
    ],
)
def test_a_wrong_camera_is_named(made, tmp_path, row, message):
    made.write_text(tmp_path)
    rows = (tmp_path / "cameras.txt").read_text().splitlines()
    rows = [row, *(r for r in rows if not r.startswith("1 "))]
    (tmp_path / "cameras.txt").write_text("\n".join(rows) + "\n")
    with pytest.raises(InputError, match=message) as error:
        attempt_from_file(tmp_path, views())
    assert len(str(error.value)) < 1000
