"""Another start where the given one leads astray, on an ellipsoid whose shape is known."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scenes import dome, silhouettes

from silmesh.errors import InputError
from silmesh.fitting.fit import fit_mesh
from silmesh.fitting.restart import fit_or_restart, may_restart
from silmesh.geometry.camera import INITIAL_SCALE, Similarity
from silmesh.geometry.mesh_files import read_mesh, to_tensors, write_mesh
from silmesh.scene.scene import Scene
from silmesh.settings.fit import FastFit, SoftRasFit
from silmesh.settings.init import Init
from silmesh.shapes.initial import make_initial_mesh

AXES = np.array([0.45, 0.3, 0.2])
FEW = FastFit(iterations=4, device="cpu")


@pytest.fixture(scope="module")
def scene() -> Scene:
    cameras = dome(12, 64)
    seen = silhouettes(cameras, AXES)
    return Scene(cameras, Similarity.identity(), seen, np.ones(12), {})


def ellipsoid(axes) -> trimesh.Trimesh:
    """At unit size, as initial meshes are."""
    mesh = trimesh.creation.icosphere(subdivisions=3)
    mesh.vertices *= INITIAL_SCALE * np.asarray(axes)
    return mesh


def test_a_fit_that_ends_well_is_the_only_one(scene):
    start = ellipsoid(0.9 * AXES)
    once, either = fit_mesh(start, scene, FEW), fit_or_restart(start, scene, FEW)
    np.testing.assert_array_equal(once.mesh.vertices, either.mesh.vertices)
    assert either.notes["warnings"] == []
    assert either.notes["iou_end"] > 0.9


def test_a_splinter_is_left_for_an_ellipsoid(scene):
    splinter = ellipsoid([0.45, 0.02, 0.02])
    assert fit_mesh(splinter, scene, FEW).notes["iou_end"] < 0.5
    fitted = fit_or_restart(splinter, scene, FEW)
    assert fitted.notes["iou_end"] > 0.9
    assert "began again from an ellipsoid" in fitted.notes["warnings"][0]
    assert fitted.mesh.volume == pytest.approx(4 / 3 * np.pi * AXES.prod(), rel=0.1)


def test_an_ellipsoid_is_not_tried_twice(scene, tmp_path):
    """Silhouettes of two objects, which no fit in one piece explains."""
    half = silhouettes(scene.cameras, [0.1, 0.1, 0.1], centre=[0.35, 0, 0])
    seen = scene.silhouettes.copy()
    seen[::2] = half[::2]
    torn = replace(scene, silhouettes=seen)
    mesh = make_initial_mesh(Init(shape="ellipsoid"), seen, scene.cameras).mesh
    write_mesh([tmp_path / "first.ply"], *to_tensors(mesh))
    steps = []
    fitted = fit_or_restart(read_mesh(tmp_path / "first.ply"), torn, FEW, steps.append)
    assert fitted.notes["iou_end"] < 0.9
    assert len(steps) == FEW.iterations


def test_a_second_fit_that_fails_leaves_the_first(scene, monkeypatch):
    splinter, fits = ellipsoid([0.45, 0.02, 0.02]), []

    def fit(*given):
        fits.append(given)
        if len(fits) == 2:
            raise InputError("numbers that are not finite")
        return fit_mesh(*given)

    monkeypatch.setattr("silmesh.fitting.restart.fit_mesh", fit)
    fitted = fit_or_restart(splinter, scene, FEW)
    assert fitted.notes["iou_end"] < 0.5
    assert "in vain: numbers that are not finite" in fitted.notes["warnings"][-1]


def test_a_start_that_is_asked_for_is_kept():
    assert may_restart("hull", FEW)
    assert may_restart("auto", FEW)
    assert not may_restart("sphere", FEW)
    assert not may_restart("hull", SoftRasFit())
