"""Another start where the given one leads astray, on an ellipsoid whose shape is known."""

import numpy as np
import pytest
import trimesh
from scenes import dome, silhouettes

from silmesh.fitting.fit import fit_mesh
from silmesh.fitting.restart import fit_or_restart, may_restart
from silmesh.geometry.camera import INITIAL_SCALE, Similarity
from silmesh.scene.scene import Scene
from silmesh.settings.fit import FastFit, SoftRasFit

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


def test_a_start_that_is_asked_for_is_kept():
    assert may_restart("hull", FEW)
    assert may_restart("auto", FEW)
    assert not may_restart("sphere", FEW)
    assert not may_restart("hull", SoftRasFit())
