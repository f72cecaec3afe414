"""COLMAP models: written by COLMAP itself, text and binary, and by us; truncated ones."""

from pathlib import PureWindowsPath

import numpy as np
import PIL.Image  # noqa: F401, before pycolmap
import pycolmap
import pytest
import torch
from scenes import behind_lenses
from scipy.spatial.transform import Rotation
from shots import HEIGHT, NAMES, POINTS, WIDTH, assert_seen, by_definition, cameras, views

from silmesh.cameras.formats import attempt_from_file, colmap_model
from silmesh.cameras.locate import locate
from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras, read_cameras, write_cameras
from silmesh.geometry.lens import CURVED, Lens
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


def write_models(made, folder, *parts):
    """Models 0, 1, ... of these images of the reconstruction."""
    for number, names in enumerate(parts):
        (folder / str(number)).mkdir(parents=True)
        made.write_text(folder / str(number))
        file = folder / str(number) / "images.txt"
        blocks = file.read_text().splitlines()
        kept = [b for b in blocks[4:] if b.split()[9:] and b.split()[9].split("/")[-1] in names]
        file.write_text("\n".join(line for image in kept for line in (image, "")) + "\n")


@pytest.mark.parametrize("within", ["", "sparse", "colmap/sparse"])
def test_of_several_models_the_one_of_most_photographs(made, tmp_path, within):
    names = [f"{name}.png" for name in NAMES]
    write_models(made, tmp_path / within, names[:2], names[1:], [])
    attempt = attempt_from_file(tmp_path, views())
    assert attempt.cameras.views == NAMES[1:]
    assert attempt.warnings[0] == (
        f"{tmp_path / within}: holds 2 reconstructions that do not join; of the 4 photographs "
        "0 2, 1 3. That of most is taken, 1"
    )
    assert len(attempt_from_file(tmp_path / within, views()).cameras) == 3
    assert attempt_from_file(tmp_path / within, views()[:2]).cameras.views == NAMES[:2]
    with pytest.raises(InputError, match="fit 2 of the 4 views"):  # one that is named is taken
        attempt_from_file(tmp_path / within / "0", views())


def test_what_is_located_of_several_models_is_located_again(made, tmp_path):
    write_models(made, tmp_path / "sparse", ["shot_1.png"], ["shot_2.png"])
    found = locate(tmp_path)
    assert found.path == tmp_path / "sparse"
    assert locate(found.path) == found
    assert [file.parent.name for file in found.files] == ["0", "0", "1", "1"]


def test_a_rig_is_read_as_its_images(tmp_path):
    """COLMAP 4 writes rigs and frames beside; the images' poses are complete without them."""
    given = cameras()
    found = pycolmap.Reconstruction()
    rig = pycolmap.Rig(rig_id=1)
    for i in (1, 2):
        camera = pycolmap.Camera(
            model="PINHOLE", width=WIDTH, height=HEIGHT, params=[700, 690, 331, 228], camera_id=i
        )
        found.add_camera(camera)
    poses = [np.c_[given.R[i].numpy(), given.t[i].numpy()] for i in range(4)]
    second = pycolmap.Rigid3d(poses[1]) * pycolmap.Rigid3d(poses[0]).inverse()
    rig.add_ref_sensor(found.cameras[1].sensor_id)
    rig.add_sensor(found.cameras[2].sensor_id, second)
    found.add_rig(rig)
    seen = list(poses)
    for frame_id, i in ((1, 0), (2, 2)):
        frame = pycolmap.Frame(frame_id=frame_id, rig_id=1)
        frame.rig_from_world = pycolmap.Rigid3d(poses[i])
        for side in (0, 1):
            frame.add_data_id(pycolmap.data_t(found.cameras[side + 1].sensor_id, i + side + 1))
        found.add_frame(frame)
        for side in (0, 1):
            found.add_image(
                pycolmap.Image(
                    name=f"{NAMES[i + side]}.png",
                    camera_id=side + 1,
                    image_id=i + side + 1,
                    frame_id=frame_id,
                )
            )
        found.register_frame(frame_id)
        seen[i + 1] = (second * pycolmap.Rigid3d(poses[i])).matrix()
    found.write_text(tmp_path)
    assert (tmp_path / "rigs.txt").is_file()
    K = [[700, 0, 331], [0, 690, 228], [0, 0, 1]]
    expected = np.stack([by_definition(K, pose[:, :3], pose[:, 3]) for pose in seen])
    assert_seen(attempt_from_file(tmp_path, views()).cameras, expected)


def write_by_hand(folder, names, between=""):
    """A model whose images have this line, or none, after each."""
    given = cameras()
    folder.mkdir(exist_ok=True)
    (folder / "cameras.txt").write_text(f"1 PINHOLE {WIDTH} {HEIGHT} 700 690 331 228\n")
    lines = ["# by hand"]
    for i, name in enumerate(names):
        q = Rotation.from_matrix(given.R[i].numpy()).as_quat(scalar_first=True)
        numbers = " ".join(map(repr, [*q.tolist(), *given.t[i].tolist()]))
        lines += [f"{i + 1} {numbers} 1 {name}", *([] if between is None else [between])]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    return folder


@pytest.mark.parametrize("between", [None, "", "\n\n", "12.5 3 -1 100 200 17", "1 2 3 " * 4])
@pytest.mark.parametrize("form", ["{}.png", "ring 1/{}.png", "100 200 17 {}.png", "{}"])
def test_images_by_hand_with_and_without_lines_of_points(tmp_path, between, form):
    names = [form.format(name) for name in NAMES]
    stems = [PureWindowsPath(name).stem for name in names]
    model = write_by_hand(tmp_path / "m", names, between)
    found = attempt_from_file(model, views(stems)).cameras
    assert_seen(found, cameras().project(torch.tensor(POINTS)).numpy())


def test_images_that_are_numbers(tmp_path):
    names = ["1", "2", "3", "4"]
    found = attempt_from_file(write_by_hand(tmp_path / "m", names, None), views(names)).cameras
    assert found.views == tuple(names)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1 1 0 0 0 0 0 0 1 12 34 56", "may be an image or the points of the one before"),
        ("12.5 3 -1 100 200", "an image should be IMAGE_ID QW"),
        ("1 x 0 0 0 0 0 0 1 shot_2.png", "should be numbers"),
        ("1.5 1 0 0 0 0 0 0 1 shot_2.png", "an image should be IMAGE_ID QW"),
    ],
)
def test_a_line_that_is_neither_image_nor_points(tmp_path, row, message):
    write_by_hand(tmp_path / "m", [f"{name}.png" for name in NAMES], row)
    with pytest.raises(InputError, match=message):
        attempt_from_file(tmp_path / "m", views())


def test_two_lines_of_points_are_not_an_image(tmp_path):
    row = "1 2 3 4 5 6 7 8 1 9 10 11"
    write_by_hand(tmp_path / "m", [f"{name}.png" for name in NAMES], f"{row}\n{row}")
    with pytest.raises(InputError, match="an image should be IMAGE_ID QW"):
        attempt_from_file(tmp_path / "m", views())


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
        ("cameras.txt", "OPENCV 640", "EQUIRECTANGULAR 640", "'EQUIRECTANGULAR' cannot be read"),
        ("cameras.txt", "OPENCV", "EUCM", "camera 3.*camera model 'EUCM' cannot be read"),
        ("cameras.txt", "700 690 331 228\n", "nan 690 331 228\n", "camera 1: should be finite"),
        ("cameras.txt", "700 690 331 228\n", "700 -690 331 228\n", "should be positive: a negat"),
        ("images.txt", " 2 left/shot_2.png", " 7 left/shot_2.png", "has camera 7, which the model"),
        ("images.txt", "left/shot_1.png", "", "an image should be IMAGE_ID QW"),
        ("images.txt", " 2 left/shot_2.png", " x left/shot_2.png", "TZ CAMERA_ID NAME, with"),
    ],
)
def test_a_wrong_model_is_named(made, tmp_path, file, old, new, message):
    made.write_text(tmp_path)
    text = (tmp_path / file).read_text()
    assert text.count(old) == 1, text
    (tmp_path / file).write_text(text.replace(old, new))
    with pytest.raises(InputError, match=message):
        attempt_from_file(tmp_path, views())


def test_a_lens_of_a_binary_model_is_named(made, tmp_path):
    made.write_binary(tmp_path)
    file = tmp_path / "cameras.bin"
    data = bytearray(file.read_bytes())
    data[12:16] = (17).to_bytes(4, "little")  # after their count and the first one's number
    file.write_bytes(data)
    with pytest.raises(InputError, match="camera model EQUIRECTANGULAR cannot be read; known"):
        attempt_from_file(tmp_path, views())


def test_the_format_is_colmaps(tmp_path):
    """What we write is read by COLMAP and by us, with a lens that has one focal length no more."""
    given = behind_lenses(
        cameras(),
        [None, Lens("RADIAL", (0.1, -0.02)), Lens("FOV", (0.5,)), Lens("RADIAL_FISHEYE", (0.1, 0))],
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
    given = behind_lenses(
        cameras(), [None, Lens("RADIAL", (0.1, -0.02)), None, Lens("FISHEYE", ())]
    )
    write_cameras(tmp_path / "cameras.json", given)
    assert read_cameras(tmp_path / "cameras.json").lenses == given.lenses
    text = (tmp_path / "cameras.json").read_text()
    (tmp_path / "cameras.json").write_text(text.replace("[0.1, -0.02]", "[0.1, NaN]"))
    with pytest.raises(InputError, match=r"camera 1 \(shot_2\): lens: parameters should be finite"):
        read_cameras(tmp_path / "cameras.json")


def test_a_lens_that_colmap_has_not(tmp_path):
    given = behind_lenses(cameras(), [Lens("BROWN", (0.1, 0, 0, 0.1, 0, 0))] * 4)
    with pytest.raises(InputError, match="view 'shot_1': COLMAP has no lens BROWN"):
        colmap_model.write(tmp_path / "model", given, {view: view for view in given.views})
    assert not (tmp_path / "model").exists()


def test_a_skew_cannot_be_written(tmp_path):
    given = cameras()
    K = given.K.clone()
    K[2, 0, 1] = 20
    skewed = Cameras(given.views, given.sizes, K, given.R, given.t)
    with pytest.raises(InputError, match="view 'shot_10': its K has a skew of 20, which moves"):
        colmap_model.write(tmp_path / "model", skewed, {view: view for view in given.views})
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1 PINHOLE 640 480", "a camera should be CAMERA_ID MODEL WIDTH HEIGHT PARAMS"),
        ("1", "a camera should be CAMERA_ID MODEL WIDTH HEIGHT PARAMS"),
        ("1 PINHOLE 640 480 700", "PINHOLE has 1 parameters, which are too few"),
        ("1 PINHOLE 640 480 7 7 3 2 0.1 0", "PINHOLE has 6 parameters, which are too many"),
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
