"""Arguments of the Python API that cannot be: each is refused by its name, before any work."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from scenes import silhouettes, turntable

import silmesh
from silmesh.errors import InputError

TURN = {"source": "turntable", "turntable": "2.732,10,60"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """An orange ellipsoid on a turntable."""
    folder = tmp_path_factory.mktemp("photographs")
    for i, shown in enumerate(silhouettes(turntable(6, 32, elevation=10), (0.45, 0.3, 0.2))):
        pixels = np.where(shown[..., None], (200, 120, 40), (20, 20, 20)).astype(np.uint8)
        Image.fromarray(pixels).save(folder / f"r{i}.png")
    return folder


@pytest.fixture(scope="module")
def photographs(folder):
    return silmesh.read_photographs(folder, size=32)


@pytest.fixture(scope="module")
def found(photographs):
    return silmesh.find_silhouettes(photographs)


@pytest.fixture(scope="module")
def scene(photographs, found):
    return silmesh.find_cameras(photographs, found, **TURN)


@pytest.fixture(scope="module")
def fitted(scene):
    return silmesh.fit(silmesh.initial_mesh(scene, vertices=162), scene, iterations=2, device="cpu")


def ball(radius=1.0):
    return trimesh.creation.icosphere(subdivisions=2, radius=radius)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            np.zeros((6, 32, 32, 3)),
            "photographs: should be str or Path or several of .*not ndarray",
        ),
        ([np.zeros((32, 32, 3))], "photographs: .*, not list of ndarray"),
        (None, "photographs: .*, not NoneType"),
        (b"photos", "photographs: .*, not bytes"),
        ("x" * 5000, "is not there"),
        ({}, "photographs: .*, not dict"),
    ],
)
def test_photographs_are_paths(given, message):
    with pytest.raises(InputError, match=message):
        silmesh.read_photographs(given)


def test_a_closed_file_is_no_path(folder):
    with (folder / "r0.png").open("rb") as file:
        pass
    with pytest.raises(InputError, match=r"photographs: .*, not BufferedReader"):
        silmesh.read_photographs(file)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"masks": []}, "masks: none are named"),
        ({"masks": np.zeros((6, 32, 32), bool)}, "masks: .*, not ndarray"),
        ({"source": 3}, "source: should be str or None, not int"),
        ({"source": "threshold", "sise": 3}, "'threshold' take no settings, but sise is given"),
        ({"progress": None}, "progress: should be a function, not NoneType"),
    ],
)
def test_silhouettes_are_asked_for_in_their_words(photographs, given, message):
    with pytest.raises(InputError, match=message):
        silmesh.find_silhouettes(photographs, **given)


def test_stages_take_what_the_one_before_gives(photographs, found, scene, fitted):
    calls = {
        "photographs: should be Photographs, as silmesh.read_photographs gives, not str": (
            lambda: silmesh.find_silhouettes("photos")
        ),
        "silhouettes: should be Silhouettes, as silmesh.find_silhouettes gives, not ndarray": (
            lambda: silmesh.find_cameras(photographs, found.silhouettes)
        ),
        "scene: should be Scene, as silmesh.find_cameras gives, not NoneType": (
            lambda: silmesh.initial_mesh(None)
        ),
        "mesh: should be Trimesh or Initial, .* not Scene": lambda: silmesh.fit(scene, ball()),
        "fitted: should be Fitted, as silmesh.fit gives, not Trimesh": (
            lambda: silmesh.colour(ball(), scene)
        ),
        "truth: should be .*, not ndarray": (
            lambda: silmesh.evaluate(fitted, scene, truth=np.zeros((3, 3)))
        ),
        "truth: should be a mesh with faces": (
            lambda: silmesh.evaluate(fitted, scene, truth=trimesh.Trimesh())
        ),
    }
    for message, call in calls.items():
        with pytest.raises(InputError, match=message):
            call()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda shown: shown[:3], r"silhouettes: should be bool \[6, 32, 32\].* not bool \[3, 32"),
        (lambda shown: shown[:, :16], r"not bool \[6, 16, 32\]"),
        (lambda shown: shown.astype(np.uint8) * 255, r"not uint8 \[6, 32, 32\]"),
    ],
)
def test_silhouettes_are_of_the_photographs(photographs, found, change, message):
    with pytest.raises(InputError, match=message):
        silmesh.find_cameras(
            photographs, replace(found, silhouettes=change(found.silhouettes)), **TURN
        )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: {"K": c.K * float("nan")}, "cameras: K: should be finite"),
        (lambda c: {"K": c.K * 0}, "cameras: K: should have positive focal lengths"),
        (lambda c: {"K": c.K.numpy()}, r"cameras: K: should be a tensor \[6, 3, 3\]"),
        (lambda c: {"t": c.t[:3]}, r"cameras: t: should be a tensor \[6, 3\]"),
        (lambda c: {"R": 2 * c.R}, "cameras: R: should be rotations"),
    ],
)
def test_cameras_in_memory_belong_together(photographs, found, change, message):
    cameras = turntable(6, 32, elevation=10).named([view.view for view in photographs.views])
    silmesh.find_cameras(photographs, found, cameras)
    with pytest.raises(InputError, match=message):
        silmesh.find_cameras(photographs, found, replace(cameras, **change(cameras)))


def test_a_mesh_of_ones_own_is_a_body(scene):
    broken = ball()
    broken.vertices[3] = np.nan
    wrong = {
        "mesh: gives a vertex that is not finite": broken,
        "mesh: gives a mesh that is not closed": trimesh.Trimesh(ball().vertices, ball().faces[1:]),
        "mesh: gives a mesh without volume": trimesh.Trimesh(
            ball().vertices * (1, 0, 1), ball().faces, process=False
        ),
        r"mesh: gives a mesh that reaches 1e\+09": ball(1e9),
    }
    for message, mesh in wrong.items():
        with pytest.raises(InputError, match=message):
            silmesh.fit(mesh, scene, iterations=2, device="cpu")


def test_a_fit_is_measured_by_its_own_scene(folder, fitted):
    few = silmesh.read_photographs(sorted(folder.iterdir())[:4], size=32)
    other = silmesh.find_cameras(few, silmesh.find_silhouettes(few), **TURN)
    for stage in (silmesh.evaluate, silmesh.colour):
        with pytest.raises(InputError, match="scene: should have the 6 views that were fitted"):
            stage(fitted, other)


def test_a_truth_that_is_not_there_is_missed_before_the_work(folder):
    with pytest.raises(InputError, match=r"no\.ply"):
        silmesh.reconstruct(folder, truth=Path("no.ply"), progress=lambda *told: 1 / 0)
