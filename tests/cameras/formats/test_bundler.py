"""Bundler's .out: its axes, its lens, its list of names."""

import numpy as np
import pytest
from shots import HEIGHT, NAMES, POINTS, WIDTH, assert_seen, cameras, views

from silmesh.cameras.formats import attempt_from_file
from silmesh.errors import InputError

GIVEN = cameras()
FLIP = np.diag([1.0, -1.0, -1.0])
R = [FLIP @ r.numpy() for r in GIVEN.R]  # x right, y up, looking along -z
T = [FLIP @ t.numpy() for t in GIVEN.t]
FOCAL, K1, K2 = 700.0, -0.1, 0.02


def write(folder, found=(True,) * 4, names=NAMES, k=(0.0, 0.0)):
    lines = ["# Bundle file v0.3", f"{len(found)} 1"]
    for i, here in enumerate(found):
        lines.append(f"{FOCAL} {k[0]} {k[1]}" if here else "0 0 0")
        lines += [" ".join(map(repr, row.tolist())) for row in (R[i] if here else 0 * R[i])]
        lines.append(" ".join(map(repr, (T[i] if here else 0 * T[i]).tolist())))
    lines += ["1 2 3", "255 0 0", "1 0 0 1.5 -2.5"]
    (folder / "bundle.out").write_text("\n".join(lines) + "\n")
    (folder / "list.txt").write_text("".join(f"./{name}.jpg 0 700.5\n" for name in names))
    return folder / "bundle.out"


def project(i: int, k1: float = 0.0, k2: float = 0.0) -> np.ndarray:
    """By Bundler's manual: from the middle, x right and y up."""
    seen = POINTS @ R[i].T + T[i]
    p = -seen[:, :2] / seen[:, 2:]
    r2 = (p**2).sum(axis=1, keepdims=True)
    p = FOCAL * (1 + k1 * r2 + k2 * r2**2) * p
    return np.stack([WIDTH / 2 + p[:, 0], HEIGHT / 2 - p[:, 1]], axis=1)


def test_cameras_look_along_minus_z_and_count_from_the_middle(tmp_path):
    attempt = attempt_from_file(write(tmp_path), views())
    assert attempt.figures["format"] == "Bundler's .out"
    assert_seen(attempt.cameras, np.stack([project(i) for i in range(4)]))


def test_its_lens_bends_as_the_manual_says(tmp_path):
    found = attempt_from_file(write(tmp_path, k=(K1, K2)), views()).cameras
    seen = POINTS @ GIVEN.R[2].numpy().T + GIVEN.t[2].numpy()
    bent = found.lenses[2].distort(seen[:, :2] / seen[:, 2:])
    K = found.K[2].numpy()
    np.testing.assert_allclose(
        bent @ K[:2, :2].T + K[:2, 2], project(2, K1, K2) / 10 + [0, 8], atol=1e-9
    )


def test_one_that_was_not_found_has_no_camera(tmp_path):
    write(tmp_path, found=(True, False, True, True))
    attempt = attempt_from_file(tmp_path, views())
    assert attempt.cameras.views == (NAMES[0], NAMES[2], NAMES[3])
    assert set(attempt.dropped) == {NAMES[1]}


@pytest.mark.parametrize("place", ["scene.list.txt", "imagelist.lst", "../list.txt"])
def test_its_list_lies_beside_it(tmp_path, place):
    folder = tmp_path / "bundle"
    folder.mkdir()
    file = write(folder).rename(folder / "scene.out")
    (folder / "list.txt").rename(folder / place)
    assert attempt_from_file(file, views()).cameras.views == NAMES


def test_names_may_have_spaces(tmp_path):
    names = ("cup 1", "cup 0 2", "my cup 3", "cup")
    file = write(tmp_path, names=names)
    (tmp_path / "list.txt").write_text("".join(f"{name}.jpg\n" for name in names))
    assert attempt_from_file(file, views(names)).cameras.views == names


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("# Bundle file v0.3", "# Other", "should begin with '# Bundle file v0.3'"),
        ("\n4 1\n", "\n4\n", "second line should be the numbers of cameras and points"),
        ("\n4 1\n", "\n40 1\n", "should hold 5 lines for each of 40 cameras"),
        ("700.0 0.0 0.0", "nan 0.0 0.0", "camera 0: should be finite numbers"),
        ("700.0 0.0 0.0", "700.0 0.0", "camera 0: should be"),
        ("700.0 0.0 0.0", "-700.0 0.0 0.0", "should be positive"),
    ],
)
def test_a_wrong_file_is_named(tmp_path, old, new, message):
    file = write(tmp_path)
    file.write_text(file.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=message) as error:
        attempt_from_file(file, views())
    assert str(error.value).startswith(str(file))


def test_names_are_needed(tmp_path):
    file = write(tmp_path, names=NAMES[:3])
    with pytest.raises(InputError, match=r"has 4 cameras, but its list .*list.txt names 3"):
        attempt_from_file(file, views())
    (tmp_path / "list.txt").unlink()
    with pytest.raises(InputError, match=r"has no names; beside it should lie list\.txt"):
        attempt_from_file(file, views())
    with pytest.raises(InputError, match="none of its 4 cameras was found"):
        attempt_from_file(write(tmp_path, found=(False,) * 4), views())
