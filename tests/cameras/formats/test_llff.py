"""LLFF's poses_bounds.npy: its axes, its order, its size."""

import numpy as np
import pytest
import torch
from shots import HEIGHT, NAMES, POINTS, WIDTH, assert_seen, cameras, views

from silmesh.cameras.formats import attempt_from_file
from silmesh.cameras.locate import locate
from silmesh.errors import InputError

GIVEN = cameras()
FOCAL = 1400.0
BY_NAME = [0, 2, 3, 1]  # shot_1, shot_10, shot_11, shot_2: as a program sorts


def make_rows(width=2 * WIDTH, height=2 * HEIGHT) -> np.ndarray:
    """[views, 17]: by rows down, right, back, place, (height, width, focal); near, far."""
    rows = []
    for i in BY_NAME:
        right, down, forward = GIVEN.R[i].numpy()
        place = GIVEN.centres[i].numpy()
        matrix = np.stack([down, right, -forward, place, [height, width, FOCAL]], axis=1)
        rows.append([*matrix.ravel(), 1.0, 2.0])
    return np.array(rows)


def project() -> np.ndarray:
    """In pixels of the photographs, half as large as those of the file: [views, points, 2]."""
    seen = [(POINTS - GIVEN.centres[i].numpy()) @ GIVEN.R[i].numpy().T for i in range(4)]
    centre = [WIDTH / 2, HEIGHT / 2]
    return np.stack([FOCAL / 2 * s[:, :2] / s[:, 2:] + centre for s in seen])


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_rows_belong_to_sorted_photographs_that_were_made_smaller(tmp_path, dtype):
    np.save(tmp_path / "poses_bounds.npy", make_rows().astype(dtype))
    attempt = attempt_from_file(tmp_path, views())
    assert attempt.cameras.views == NAMES
    assert attempt.figures["format"] == "LLFF's poses_bounds.npy"
    assert "cameras for 1280x960 pixels are scaled" in attempt.warnings[0]
    found = attempt.cameras.project(torch.tensor(POINTS)).numpy()
    np.testing.assert_allclose(found, project() / 10 + [0, 8], atol=1e-3)
    if dtype is np.float64:
        assert_seen(attempt.cameras, project())


def test_an_array_is_llffs_by_its_shape(tmp_path):
    np.save(tmp_path / "a.npy", make_rows())
    np.save(tmp_path / "b.npy", np.ones((4, 3)))
    assert locate(tmp_path / "a.npy").kind == "llff"
    assert locate(tmp_path / "b.npy").kind == "softras"


def test_a_size_that_no_photograph_has(tmp_path):
    np.save(tmp_path / "poses_bounds.npy", make_rows(width=4000, height=4000))
    with pytest.raises(InputError, match="is for 4000x4000 pixels, but its photograph has 640x480"):
        attempt_from_file(tmp_path, views())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows[:3], "has 3 cameras, but there are 4 photographs"),
        (lambda rows: rows * np.nan, "row 0: should be finite numbers"),
        (lambda rows: rows * 0, "should be pixels, not 0 and 0"),
        (lambda rows: rows.astype("U8"), "should hold .* numbers, not .* of <U8"),
        (lambda rows: np.where(np.arange(17) == 0, 9, rows), "R should be a rotation"),
    ],
)
def test_a_wrong_array_is_named(tmp_path, change, message):
    path = tmp_path / "poses_bounds.npy"
    np.save(path, change(make_rows()))
    with pytest.raises(InputError, match=message) as error:
        attempt_from_file(path, views())
    assert str(error.value).startswith(str(path))


def test_a_truncated_array(tmp_path):
    path = tmp_path / "poses_bounds.npy"
    np.save(path, make_rows())
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(InputError, match=r"cannot be read as a \.npy array"):
        attempt_from_file(path, views())
