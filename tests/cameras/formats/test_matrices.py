"""Projection matrices: text files, .mat, .npz, and how one comes apart; Middlebury's _par.txt."""

import io
import zipfile

import numpy as np
import pytest
import torch
from scipy.io import savemat
from shots import HEIGHT, NAMES, POINTS, WIDTH, assert_seen, by_definition, cameras, views

from silmesh.cameras.formats import attempt_from_file, mat
from silmesh.cameras.formats.projection import decompose
from silmesh.errors import InputError

GIVEN = cameras()
P = GIVEN.projections.numpy()


def project(matrices: np.ndarray) -> np.ndarray:
    """By depth (u, v, 1) = P (X, 1): [views, points, 2]."""
    seen = np.c_[POINTS, np.ones(len(POINTS))] @ np.swapaxes(matrices, 1, 2)
    return seen[..., :2] / seen[..., 2:]


def write_texts(folder, matrices, names=NAMES):
    folder.mkdir(exist_ok=True)
    for name, matrix in zip(names, matrices, strict=True):
        np.savetxt(folder / f"{name}.txt", matrix)
    return folder


@pytest.mark.parametrize("factor", [1, -1, 1e-3, -250])
def test_a_matrix_comes_apart_whatever_its_factor(factor):
    K, R, t = decompose(P[1] * factor, "it")
    np.testing.assert_allclose(K, GIVEN.K[1], atol=1e-9)
    np.testing.assert_allclose(R, GIVEN.R[1], atol=1e-12)
    np.testing.assert_allclose(t, GIVEN.t[1], atol=1e-9)


def test_a_skew_is_kept():
    K = np.array([[700, 12, 331], [0, 690, 228], [0, 0, 1]])
    pose = np.c_[GIVEN.R[2], GIVEN.t[2]]
    np.testing.assert_allclose(decompose(K @ pose, "it")[0], K, atol=1e-9)


def test_a_folder_of_texts(tmp_path):
    folder = write_texts(tmp_path / "projections", P * [[[3]], [[-1]], [[1]], [[0.1]]])
    np.savetxt(folder / "shot_1.txt", np.r_[P[0], [[0, 0, 0, 1]]])
    np.savetxt(folder / "shot_2.txt", P[1], header="CONTOUR", comments="")
    attempt = attempt_from_file(folder, views())
    assert attempt.figures["format"] == "3x4 matrices in text files"
    assert_seen(attempt.cameras, project(P))


@pytest.mark.parametrize("form", ["cells", "array"])
def test_a_mat_file_as_oxfords(tmp_path, form):
    """Its pixels have their centres at integers: ours are 0.5 further."""
    cells = np.empty((1, 4), object)
    for i in range(4):
        cells[0, i] = P[i] * (i + 1)
    savemat(tmp_path / "dino_Ps.mat", {"P": cells if form == "cells" else np.moveaxis(P, 0, 2)})
    attempt = attempt_from_file(tmp_path / "dino_Ps.mat", views())
    assert attempt.cameras.views == NAMES
    assert_seen(attempt.cameras, project(P) + 0.5)


def test_an_npz_as_neus_has_it(tmp_path):
    homogeneous = np.concatenate([P, np.tile([[[0, 0, 0, 1]]], (4, 1, 1))], axis=1)
    values = {f"world_mat_{i}": homogeneous[i].astype(np.float32) for i in range(4)}
    values |= {f"scale_mat_{i}": np.diag([60.0, 60, 60, 1]) for i in range(4)}
    values |= {f"camera_mat_{i}": np.eye(4) for i in range(4)}
    np.savez(tmp_path / "cameras_sphere.npz", **values)
    found = attempt_from_file(tmp_path, views()).cameras
    pixels = found.project(torch.tensor(POINTS)).numpy()
    expected = (project(P) + 0.5) / 10 + [0, 8]
    np.testing.assert_allclose(pixels, expected, atol=1e-3)  # single precision


def test_an_npz_of_eleven_views_is_in_the_order_of_their_numbers(tmp_path):
    order = [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 3]
    np.savez(tmp_path / "c.npz", **{f"world_mat_{i}": P[j] for i, j in enumerate(order)})
    names = tuple(f"v{i}" for i in range(11))
    found = attempt_from_file(tmp_path / "c.npz", views(names)).cameras
    np.testing.assert_allclose(found.centres, GIVEN.centres[order], atol=1e-9)


@pytest.mark.parametrize("pixels", [True, False])
def test_an_npz_as_dvr_has_it(tmp_path, pixels):
    """[R | t] apart from K, which leads to pixels, or to [-1, 1] over the photograph."""
    to_unit = np.array([[2 / (WIDTH - 1), 0, -1], [0, 2 / (HEIGHT - 1), -1], [0, 0, 1]])
    K = GIVEN.K[0].numpy() if pixels else to_unit @ GIVEN.K[0].numpy()
    values = {}
    for i in range(4):
        values[f"camera_mat_{i}"] = np.eye(4)
        values[f"camera_mat_{i}"][:3, :3] = K
        values[f"world_mat_{i}"] = np.eye(4)
        values[f"world_mat_{i}"][:3] = np.c_[GIVEN.R[i], GIVEN.t[i]]
    np.savez(tmp_path / "cameras.npz", **values)
    assert_seen(attempt_from_file(tmp_path, views()).cameras, project(P) + 0.5)


def write_middlebury(path, change=lambda row: row):
    rows = []
    for i, name in enumerate(NAMES):
        numbers = [*GIVEN.K[i].flatten(), *GIVEN.R[i].flatten(), *GIVEN.t[i]]
        rows.append(change([f"{name}.png", *(f"{float(n):.9f}" for n in numbers)]))
    path.write_text(f"{len(rows)}\n" + "".join(" ".join(row) + "\n" for row in rows))
    return path


def test_middlebury(tmp_path):
    attempt = attempt_from_file(write_middlebury(tmp_path / "temple_par.txt").parent, views())
    assert attempt.figures["format"] == "Middlebury's _par.txt"
    expected = [by_definition(GIVEN.K[i], GIVEN.R[i], GIVEN.t[i]) + 0.5 for i in range(4)]
    assert_seen(attempt.cameras, np.stack(expected))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda row: row[:-1], r"camera 0 \(shot_1.png\): K, R and t: should be finite numbers"),
        (lambda row: [*row[:5], "0", *row[6:]], "has no inverse"),
        (lambda row: [*row[:4], "5", *row[5:]], "K should be upper triangular"),
        (lambda row: [*row[:10], *["0"] * 9, *row[19:]], "R should be a rotation"),
        (lambda row: [*row[:21], "nan"], "should be finite numbers"),
    ],
)
def test_a_wrong_par_file_is_named(tmp_path, change, message):
    with pytest.raises(InputError, match=message):
        attempt_from_file(write_middlebury(tmp_path / "a_par.txt", change), views())


def test_a_par_file_that_lacks_cameras(tmp_path):
    path = write_middlebury(tmp_path / "a_par.txt")
    path.write_text(path.read_text().replace("4\n", "5\n", 1))
    with pytest.raises(InputError, match="should hold 5 cameras, as its first line says, not 4"):
        attempt_from_file(path, views())


@pytest.mark.parametrize("flips", [(1, 1), (-1, -1)])
def test_a_par_file_with_negative_focal_lengths(tmp_path, flips):
    """Those of both axes are a camera that is turned by 180 degrees about its own axis."""

    def change(row):
        numbers = np.array(row[1:], float)
        numbers[[0, 4]] *= flips
        numbers[9:15] *= flips[0]
        numbers[18:20] *= flips[0]
        return [row[0], *map(str, numbers)]

    attempt = attempt_from_file(write_middlebury(tmp_path / "a_par.txt", change), views())
    expected = [by_definition(GIVEN.K[i], GIVEN.R[i], GIVEN.t[i]) + 0.5 for i in range(4)]
    assert_seen(attempt.cameras, np.stack(expected))


@pytest.mark.parametrize("flip", [np.diag([1, -1, 1]), np.diag([-1, 1, 1])])
def test_matrices_that_mirror_the_image_are_left_to_the_silhouettes(tmp_path, flip):
    """The object lies behind their cameras, as it does with matrices of a left-handed world."""
    shift = np.array(
        [[1, 0, WIDTH * (flip[0, 0] < 0)], [0, 1, HEIGHT * (flip[1, 1] < 0)], [0, 0, 1]]
    )
    attempt = attempt_from_file(write_texts(tmp_path / "p", shift @ flip @ P), views())
    assert attempt.signless
    assert (attempt.cameras.depths(torch.tensor(POINTS)) < 0).all()


def test_rotations_of_two_decimals_are_read(tmp_path):
    def change(row):
        return [*row[:10], *(f"{float(n):.2f}" for n in row[10:19]), *row[19:]]

    found = attempt_from_file(write_middlebury(tmp_path / "a_par.txt", change), views()).cameras
    np.testing.assert_allclose(found.R, GIVEN.R, atol=0.01)


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.full((3, 4), np.nan), "the matrix should be finite numbers"),
        (np.c_[np.eye(3)[[0, 1, 1]], np.ones(3)], "has no inverse .determinant 0"),
        (np.ones((3, 3)), "should hold the 12 numbers of a 3x4 matrix, not 9"),
    ],
)
def test_a_wrong_matrix_is_named(tmp_path, matrix, message):
    folder = write_texts(tmp_path / "p", P)
    np.savetxt(folder / "shot_2.txt", matrix)
    with pytest.raises(InputError, match=rf"shot_2.*{message}"):
        attempt_from_file(folder, views())


def test_a_wrong_mat_file_is_named(tmp_path):
    (tmp_path / "a.mat").write_bytes(b"nonsense")
    with pytest.raises(InputError, match=r"a.mat: cannot be read as a .mat file"):
        attempt_from_file(tmp_path / "a.mat", views())
    savemat(tmp_path / "b.mat", {"Q": P[0]})
    with pytest.raises(InputError, match="should hold a cell array P of 3x4 matrices, holds Q"):
        attempt_from_file(tmp_path / "b.mat", views())
    savemat(tmp_path / "c.mat", {"P": P[0]})
    with pytest.raises(InputError, match=r"P should be a cell array of 3x4 matrices, not \[3, 4\]"):
        attempt_from_file(tmp_path / "c.mat", views())


def test_a_wrong_npz_file_is_named(tmp_path):
    np.savez(tmp_path / "a.npz", K=np.eye(3))
    with pytest.raises(InputError, match=r"should hold world_mat_0, world_mat_1, ..., holds K"):
        attempt_from_file(tmp_path / "a.npz", views())
    data = (tmp_path / "a.npz").read_bytes()
    (tmp_path / "a.npz").write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"cannot be read as an .npz file"):
        attempt_from_file(tmp_path / "a.npz", views())


def test_a_mat_file_is_read_however_it_is_stored(tmp_path):
    """Compressed, after other variables, as whole numbers."""
    cells = np.empty((4, 1), object)
    for i in range(4):
        cells[i, 0] = np.round(P[i])
    others = {"text": "abc", "first": np.eye(30), "s": {"a": 1}}
    savemat(tmp_path / "a.mat", others | {"P": cells}, do_compression=True)
    expected = attempt_from_file(tmp_path / "a.mat", views()).cameras
    savemat(tmp_path / "b.mat", {"P": np.moveaxis(np.round(P), 0, 2).astype(np.int32)})
    found = attempt_from_file(tmp_path / "b.mat", views()).cameras
    torch.testing.assert_close(found.projections, expected.projections)
    np.testing.assert_allclose(np.stack(mat._read_matrices(tmp_path / "a.mat")), np.round(P))


def test_a_mat_file_of_version_7_3_is_named(tmp_path):
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n")
    with pytest.raises(InputError, match=r"version 7\.3, which cannot be read; save it again in"):
        attempt_from_file(tmp_path / "a.mat", views())


@pytest.mark.parametrize("packed", [False, True])
def test_a_damaged_mat_file_is_refused(tmp_path, packed):
    """SciPy's reader ends the process over some of these."""
    savemat(tmp_path / "a.mat", {"P": np.moveaxis(P, 0, 2)}, do_compression=packed)
    data = (tmp_path / "a.mat").read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for i in range(300):
        changed = bytearray(data)
        changed[128 + i % (len(data) - 128)] ^= int(rng.integers(1, 256))
        (tmp_path / "a.mat").write_bytes(changed)
        try:
            mat.read(tmp_path / "a.mat")
        except InputError as error:
            refused += str(error).startswith(f"{tmp_path / 'a.mat'}: ")
    assert refused > 50


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("text", r"not \[1, 4\] of char"),
        (P[0] * 1j, r"not \[3, 4\] of double complex"),
        ({"a": 1}, r"not \[1, 1\] of struct"),
        (np.empty((1, 0), object), "P is empty"),
        (np.array([[P[0], "x"]], object), r"holds one \[1, 1\] of char"),
    ],
)
def test_a_mat_file_of_other_values_is_named(tmp_path, value, message):
    savemat(tmp_path / "a.mat", {"P": value})
    with pytest.raises(InputError, match=message):
        attempt_from_file(tmp_path / "a.mat", views())


def test_of_an_npz_only_matrices_are_unpacked(tmp_path):
    """A gigabyte of zeros behind a megabyte: what is not needed stays packed."""
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("scale_mat_0.npy", "w") as member:
            for _ in range(1 << 6):
                member.write(bytes(1 << 20))
        for i in range(4):
            packed = io.BytesIO()
            np.save(packed, P[i])
            archive.writestr(f"world_mat_{i}.npy", packed.getvalue())
    assert len(attempt_from_file(tmp_path / "a.npz", views()).cameras) == 4


@pytest.mark.parametrize("shape", [(1 << 24,), (1 << 20, 1 << 20), (10**30,)])
def test_a_large_member_of_an_npz_is_refused(tmp_path, shape):
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}"
    head = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode()
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("world_mat_0.npy", head + bytes(8 * (1 << 24 if len(shape) == 1 else 4)))
    with pytest.raises(InputError, match=r"a\.npz: cannot be read as an .npz file: "):
        attempt_from_file(tmp_path / "a.npz", views())


def test_python_objects_of_an_npz_are_not_made(tmp_path):
    np.savez(tmp_path / "a.npz", world_mat_0=np.array([[{}]], object))
    with pytest.raises(InputError, match="allow_pickle=False"):
        attempt_from_file(tmp_path / "a.npz", views())


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (P[1] * 1e200, r"the matrix should be finite numbers up to 1e\+15"),
        (P[1] * 1e-200, "has no inverse"),
        (np.diag([1e9, 1, 1]) @ P[1], "its focal lengths, 7.*e.11 and 690, should be between"),
    ],
)
def test_numbers_beyond_all_sense_are_refused(tmp_path, matrix, message):
    folder = write_texts(tmp_path / "p", P)
    np.savetxt(folder / "shot_2.txt", matrix)
    with pytest.raises(InputError, match=message) as error:
        attempt_from_file(folder, views())
    assert str(folder) in str(error.value)


@pytest.mark.parametrize("first", ["4" * 5000, "²", "4 4", ""])
def test_a_wrong_count_of_middlebury(tmp_path, first):
    (tmp_path / "a_par.txt").write_text(f"{first}\nx 1 2 3\n")
    with pytest.raises(InputError, match=r"a_par\.txt: should begin with a line that says how"):
        attempt_from_file(tmp_path / "a_par.txt", views())
