"""Cameras of a file as the silhouettes show that they are meant."""

import json

import numpy as np
import pytest
import torch
from scenes import silhouettes, turntable
from scipy.io import savemat

from silmesh.cameras.attempt import Attempt
from silmesh.cameras.formats import attempt_from_file
from silmesh.errors import InputError
from silmesh.geometry.camera import MIRROR, Cameras, write_cameras
from silmesh.scene.agreement import normalise
from silmesh.scene.conventions import settle
from silmesh.views import View, place_view

SIZE, COUNT = 64, 12
LEFT = np.diag([*MIRROR, 1.0])  # to a left-handed world
POINTS = torch.tensor(np.random.default_rng(1).uniform(-0.3, 0.3, (20, 3)))
OPENGL, RIGHT_UP_FORWARD = np.diag([1.0, -1, -1]), np.diag([1.0, -1, 1])


def body(cameras: Cameras) -> np.ndarray:
    """An L, which is no mirror image of itself from any side of the table."""
    long = silhouettes(cameras, [0.4, 0.12, 0.1], [0.02, 0.05, 0])
    return long | silhouettes(cameras, [0.1, 0.3, 0.1], [0.2, 0.15, 0.05])


@pytest.fixture(scope="module")
def cameras():
    return turntable(COUNT, SIZE, elevation=15)


@pytest.fixture(scope="module")
def seen(cameras):
    return body(cameras)


@pytest.fixture(scope="module")
def coherence(cameras, seen):
    return normalise(cameras, seen).mean


def views(size: int = SIZE) -> list[View]:
    return [place_view(f"v{i}", f"v{i}.png", size, size, SIZE, "pad") for i in range(COUNT)]


def write_texts(path, matrices):
    path.mkdir()
    for i, matrix in enumerate(matrices):
        np.savetxt(path / f"v{i}.txt", matrix)
    return path


def write_mat(path, matrices):
    """Pixel centres lie at integers."""
    cells = np.empty((1, len(matrices)), object)
    for i, matrix in enumerate(matrices):
        cells[0, i] = to_integers(matrix)
    savemat(f"{path}.mat", {"P": cells})
    return path.with_name(f"{path.name}.mat")


def write_npz(path, matrices):
    np.savez(f"{path}.npz", **{f"world_mat_{i}": to_integers(m) for i, m in enumerate(matrices)})
    return path.with_name(f"{path.name}.npz")


def write_par(path, matrices):
    """``name K R t``, R a rotation: of a left-handed world K has a negative focal length."""
    rows = []
    for i, matrix in enumerate(matrices):
        M = to_integers(matrix)
        q, r = np.linalg.qr(np.linalg.inv(M[:, :3]))
        K, R = np.linalg.inv(r), q.T
        K, R = K * np.sign(K[2, 2]), R * np.sign(K[2, 2])
        turn = np.diag([1, np.linalg.det(R), 1])
        K, R = K @ turn, turn @ R
        t = np.linalg.solve(K, M[:, 3])
        rows.append(" ".join([f"v{i}.png", *map(repr, map(float, [*K.ravel(), *R.ravel(), *t]))]))
    path = path.with_name(f"{path.name}_par.txt")
    path.write_text("\n".join([str(len(rows)), *rows]) + "\n")
    return path


def to_integers(matrix):
    return np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]]) @ matrix


@pytest.mark.parametrize("write", [write_texts, write_mat, write_npz, write_par])
@pytest.mark.parametrize("signs", [1, -3])
def test_matrices_of_a_left_handed_world_are_taken_in_its_mirror_image(
    tmp_path, cameras, seen, coherence, write, signs
):
    matrices = cameras.projections.numpy() @ LEFT
    attempt, placed = settle(
        attempt_from_file(write(tmp_path / "p", signs * matrices), views()), seen
    )
    assert attempt.mirrored
    assert placed.mean == pytest.approx(coherence, abs=1e-3)
    assert "are of a left-handed world" in attempt.warnings[-1]
    assert "have z negated" in attempt.warnings[-1]
    # The file's world is the mirror image of ours, so that its mirror image is ours again.
    np.testing.assert_allclose(attempt.cameras.R.det(), 1)
    there = attempt.cameras.project(POINTS).numpy()
    np.testing.assert_allclose(there, cameras.project(POINTS).numpy(), atol=1e-6)


def test_right_handed_matrices_are_not_mirrored(tmp_path, cameras, seen):
    found = write_texts(tmp_path / "p", -cameras.projections.numpy())
    attempt, _ = settle(attempt_from_file(found, views()), seen)
    assert (attempt.mirrored, attempt.warnings) == (False, ())


def look_aside(cameras: Cameras, degrees: float) -> Cameras:
    """Cameras turned away from the object, of a part of their images about it, far off the axis."""
    angle = np.deg2rad(degrees)
    turn = torch.eye(3, dtype=torch.float64)
    turn[[0, 0, 2, 2], [0, 2, 0, 2]] = torch.tensor(
        [np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)]
    )
    K = cameras.K.clone()
    K[:, 0, 2] -= K[:, 0, 0] * np.tan(angle)
    return Cameras(cameras.views, cameras.sizes, K, turn @ cameras.R, cameras.t @ turn.T)


@pytest.mark.parametrize("left", [False, True])
@pytest.mark.parametrize("write", [write_texts, write_mat, write_npz])
def test_parts_of_photographs_far_off_their_axes_are_taken(tmp_path, cameras, write, left):
    aside = look_aside(cameras, 40)
    assert (aside.K[:, 0, 2] < -20).all()
    matrices = aside.projections.numpy()
    path = write(tmp_path / "p", matrices @ LEFT if left else matrices)
    attempt, placed = settle(attempt_from_file(path, views()), body(aside))
    assert placed.mean > 0.95
    assert attempt.mirrored == left
    assert "pass their photographs by, at (-" in attempt.warnings[-1]
    assert f"agree with them (hull IoU {placed.mean:.2f})" in attempt.warnings[-1]


def test_matrices_of_larger_photographs_are_refused_with_the_coherence(tmp_path, cameras, seen):
    large = np.diag([10, 10, 1]) @ cameras.projections.numpy()
    attempt = attempt_from_file(write_texts(tmp_path / "p", large), views())
    with pytest.raises(InputError) as error:
        settle(attempt, seen)
    assert "the axes of 12 of 12 cameras pass their photographs by, at (320, 320)" in str(
        error.value
    )
    assert "none fits" in str(error.value)
    assert "give the original ones" in str(error.value)


@pytest.mark.parametrize(
    ("flip", "said", "row"),
    [
        ([[1, 0, 0], [0, -1, SIZE], [0, 0, 1]], "rows are counted from below", 1),
        ([[-1, 0, SIZE], [0, 1, 0], [0, 0, 1]], "columns are counted from the right", 0),
    ],
)
def test_matrices_of_mirrored_pixels_are_refused_by_name(
    tmp_path, cameras, seen, coherence, flip, said, row
):
    matrices = np.array(flip, float) @ cameras.projections.numpy()
    with pytest.raises(InputError, match=f"Read as matrices whose {said}") as error:
        settle(attempt_from_file(write_texts(tmp_path / "p", matrices), views()), seen)
    named = ("first", "second")[row]
    assert f"replace the {named} row of each P" in str(error.value)
    matrices[:, row] = SIZE * matrices[:, 2] - matrices[:, row]
    mended = settle(attempt_from_file(write_texts(tmp_path / "m", matrices), views()), seen)
    assert mended[1].mean == pytest.approx(coherence, abs=1e-3)


def test_matrices_some_of_which_mirror_are_named(tmp_path, cameras, seen):
    matrices = cameras.projections.numpy().copy()
    matrices[[3, 7]] = matrices[[3, 7]] @ LEFT
    attempt = attempt_from_file(write_texts(tmp_path / "p", matrices), views())
    with pytest.raises(InputError, match="all matrices mirror, or none does") as error:
        settle(attempt, seen)
    assert "2 of 12 cameras look away from it (v3, v7)" in str(error.value)


def write_transforms(path, cameras, to_file):
    """Poses from camera to world with OpenCV's axes, as a program writes them in its own way."""
    frames = []
    for i, view in enumerate(cameras.views):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = cameras.R[i].T, cameras.centres[i]
        frames.append({"file_path": f"images/{view}.png", "transform_matrix": to_file(pose)})
    focal = float(cameras.K[0, 0, 0])
    content = {"fl_x": focal, "fl_y": focal, "w": SIZE, "h": SIZE}
    rows = [f | {"transform_matrix": f["transform_matrix"].tolist()} for f in frames]
    path.write_text(json.dumps(content | {"frames": rows}))
    return path


def with_axes(axes):
    """OpenCV's axes to those of a camera whose own lead to OpenCV's by ``axes``."""
    turn = np.eye(4)
    turn[:3, :3] = axes
    return lambda pose: pose @ turn


def transposed(pose):
    pose = with_axes(OPENGL)(pose)
    pose[:3, :3] = pose[:3, :3].T.copy()
    return pose


TO_OPENGL = with_axes(OPENGL)
CONVENTIONS = {  # how a program writes, what the message names, what mends it
    "opencv": (
        with_axes(np.eye(3)),
        "camera to world with OpenCV's axes (x right, y down, z forward)",
        ("negate columns 2 and 3 of each matrix", lambda m: m * [1, -1, -1, 1]),
    ),
    "world to camera": (
        lambda pose: np.linalg.inv(pose),
        "world to camera with OpenCV's axes",
        (
            "by its inverse, [R^T | -R^T t], then negate columns 2 and 3 of each matrix",
            lambda m: np.linalg.inv(m) * [1, -1, -1, 1],
        ),
    ),
    "opengl, world to camera": (
        lambda pose: np.linalg.inv(TO_OPENGL(pose)),
        "world to camera with OpenGL's axes (x right, y up, z back)",
        ("replace each matrix [R | t] by its inverse, [R^T | -R^T t]", np.linalg.inv),
    ),
    "transposed": (
        transposed,
        "rotations from world to camera beside the cameras' places with OpenGL's axes",
        ("transpose the rotation R of each matrix", None),
    ),
    "pytorch3d": (
        with_axes(np.diag([-1.0, -1, 1])),
        "camera to world with x left, y up, z forward",
        ("negate columns 1 and 3 of each matrix", lambda m: m * [-1, 1, -1, 1]),
    ),
    "llff": (
        with_axes(np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])),
        "camera to world with x down, y right, z back",
        ("turn the camera's axes of each matrix to OpenGL's axes", None),
    ),
    "unity": (
        with_axes(RIGHT_UP_FORWARD),
        "camera to world with x right, y up, z forward",
        ("negate column 3 of each matrix", lambda m: m * [1, 1, -1, 1]),
    ),
}


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_the_convention_that_fits_is_named(tmp_path, cameras, seen, coherence, convention):
    to_file, named, (advice, mend) = CONVENTIONS[convention]
    path = write_transforms(tmp_path / "transforms.json", cameras, to_file)
    with pytest.raises(InputError) as error:
        settle(attempt_from_file(path, views()), seen)
    assert f"Read as {named}" in str(error.value)
    assert advice in str(error.value)
    if mend:
        path = write_transforms(tmp_path / "m.json", cameras, lambda pose: mend(to_file(pose)))
        mended = settle(attempt_from_file(path, views()), seen)[1]
        assert mended.mean == pytest.approx(coherence, abs=1e-3)


def test_cameras_that_look_away_are_said_to(tmp_path, cameras, seen):
    path = write_transforms(tmp_path / "transforms.json", cameras, lambda pose: pose)
    with pytest.raises(InputError, match="the cameras look away from it"):
        settle(attempt_from_file(path, views()), seen)


@pytest.mark.parametrize("kind", ["transforms", "cameras.json"])
def test_poses_of_a_left_handed_world_are_taken_in_its_mirror_image(
    tmp_path, cameras, seen, coherence, kind
):
    path = tmp_path / f"{kind.partition('.')[0]}.json"
    if kind == "transforms":
        write_transforms(path, cameras, lambda pose: LEFT @ TO_OPENGL(pose))
    else:
        write_cameras(path, cameras.in_mirrored_world())
    attempt, placed = settle(attempt_from_file(path, views()), seen)
    assert attempt.mirrored
    assert placed.mean == pytest.approx(coherence, abs=1e-3)
    there = attempt.cameras.project(POINTS).numpy()
    np.testing.assert_allclose(there, cameras.project(POINTS).numpy(), atol=1e-6)


@pytest.mark.slow
def test_cameras_of_other_photographs_fit_no_convention(tmp_path, cameras, seen):
    far = Cameras(cameras.views, cameras.sizes, cameras.K, cameras.R, -cameras.t)
    path = write_transforms(tmp_path / "transforms.json", far, TO_OPENGL)
    shuffled = np.roll(seen, 3, axis=2)[np.random.default_rng(0).permutation(COUNT)]
    with pytest.raises(InputError, match=r"Other conventions were tried .* and none fits"):
        settle(attempt_from_file(path, views()), shuffled)


def test_a_turntable_is_placed_without_being_judged(cameras, seen):
    wrong = Attempt("turntable", cameras.select([0, 5, 10, 3, 8, 1, 6, 11, 4, 9, 2, 7]))
    assert settle(wrong, seen)[0] is wrong
