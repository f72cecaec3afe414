"""RealityCapture's CSV of internal and external camera parameters, by its export templates."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shots import HEIGHT, NAMES, POINTS, WIDTH, assert_seen, cameras, views

from silmesh.cameras.formats import attempt_from_file
from silmesh.errors import InputError
from silmesh.geometry.lens import Lens

GIVEN = cameras()
OLD = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"
NEW = "#name,x,y,alt,yaw,pitch,roll,f_35mm,px_norm,py_norm,k1,k2,k3,k4,t1,t2"
F35, PX, PY = 39.375, 0.0171875, -0.01875  # 700 pixels; 11 right and 12 above the middle


def turn(heading: float, pitch: float, roll: float) -> np.ndarray:
    """The camera's axes right, up, back as columns: about z, then x, then y, written out."""
    h, p, r = np.radians([heading, pitch, roll])
    about_z = [[np.cos(h), np.sin(h), 0], [-np.sin(h), np.cos(h), 0], [0, 0, 1]]  # clockwise
    about_x = [[1, 0, 0], [0, np.cos(p), -np.sin(p)], [0, np.sin(p), np.cos(p)]]
    about_y = [[np.cos(r), 0, np.sin(r)], [0, 1, 0], [-np.sin(r), 0, np.cos(r)]]
    return np.array(about_z) @ np.array(about_x) @ np.array(about_y)


def find_angles(i: int) -> list[float]:
    axes = GIVEN.R[i].numpy().T @ np.diag([1.0, -1, -1])
    minus_heading, pitch, roll = Rotation.from_matrix(axes).as_euler("ZXY", degrees=True)
    np.testing.assert_allclose(turn(-minus_heading, pitch, roll), axes, atol=1e-12)
    return [-minus_heading, pitch, roll]


def write(tmp_path, header=OLD, lens=(0,) * 6):
    rows = [
        ",".join(map(str, [f"{name}.jpg", *place, *find_angles(i), F35, PX, PY, *lens]))
        for i, (name, place) in enumerate(zip(NAMES, GIVEN.centres.tolist(), strict=True))
    ]
    path = tmp_path / "cameras.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


@pytest.mark.parametrize("header", [OLD, NEW, f"#cameras 4\n{OLD}"])
def test_its_angles_and_its_pixels(tmp_path, header):
    attempt = attempt_from_file(write(tmp_path, header), views())
    expected = []
    for i in range(4):
        seen = (POINTS - GIVEN.centres[i].numpy()) @ turn(*find_angles(i))
        u = WIDTH / 2 + 11 - 700 * seen[:, 0] / seen[:, 2]
        v = HEIGHT / 2 - 12 + 700 * seen[:, 1] / seen[:, 2]
        expected.append(np.stack([u, v], axis=1))
    assert_seen(attempt.cameras, np.stack(expected))
    assert attempt.cameras.lenses == (None,) * 4


def test_a_camera_that_looks_down_has_north_above(tmp_path):
    """Without a turn; heading turns what is above to the east."""
    np.testing.assert_allclose(turn(0, 0, 0), np.eye(3))
    np.testing.assert_allclose(turn(90, 0, 0) @ [0, 1, 0], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(turn(0, 90, 0) @ [0, 0, -1], [0, 1, 0], atol=1e-12)


def test_browns_lens_with_its_tangential_terms(tmp_path):
    path = write(tmp_path, lens=(0.1, -0.02, 0.01, 0.001, 0.004, 0.003))
    lens = attempt_from_file(path, views()).cameras.lenses[0]
    assert lens == Lens("BROWN", (0.1, -0.02, 0.01, 0.001, 0.003, 0.004))


def test_k1_alone_may_be_of_the_division_model(tmp_path):
    with pytest.raises(InputError, match=r"row 0 \(shot_1.jpg\): a lens of k1 alone may be of the"):
        attempt_from_file(write(tmp_path, lens=(-0.1, 0, 0, 0, 0, 0)), views())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (",heading", ",direction", "heading are missing"),
        (",t1,t2", ",t1,t3", "'t3' is unknown"),
        ("39.375,", "x,", "f: should be numbers"),
        ("39.375,", "nan,", "f: should be finite numbers"),
        ("39.375,", "", "has 15 fields; should have 16"),
        ("39.375,", "0,", "should be positive"),
    ],
)
def test_a_wrong_file_is_named(tmp_path, old, new, message):
    path = write(tmp_path)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=message) as error:
        attempt_from_file(path, views())
    assert str(error.value).startswith(str(path))
