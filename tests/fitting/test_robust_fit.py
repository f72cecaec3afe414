"""Another start where the given one leads astray, on an ellipsoid whose shape is known."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scenes import dome, silhouettes, turntable

from silmesh.errors import InputError
from silmesh.fitting.belief import find_belief
from silmesh.fitting.checkpoint import Checkpoint
from silmesh.fitting.fit import fit_mesh
from silmesh.fitting.robust_fit import fit_robustly
from silmesh.geometry.camera import INITIAL_SCALE, Similarity
from silmesh.scene.scene import Scene
from silmesh.settings.fit import FastFit, SoftRasFit
from silmesh.settings.init import Init
from silmesh.shapes.initial import make_initial_mesh

AXES = np.array([0.45, 0.3, 0.2])
FEW = FastFit(iterations=4, device="cpu")
PLAIN = FEW.model_copy(update={"judge_views": False})
LETTER = SoftRasFit(iterations=4, device="cpu")
KEPT = {"remesh": False}  # the faces of the start


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
    once, either = fit_mesh(start, scene, FEW), fit_robustly(start, scene, FEW, "hull")
    np.testing.assert_array_equal(once.mesh.vertices, either.mesh.vertices)
    assert either.notes["warnings"] == []
    assert either.notes["iou_end"] > 0.9


def test_a_splinter_is_left_for_an_ellipsoid(scene):
    splinter = ellipsoid([0.45, 0.02, 0.02])
    assert fit_mesh(splinter, scene, FEW).notes["iou_end"] < 0.5
    fitted = fit_robustly(splinter, scene, FEW, "hull")
    assert fitted.notes["iou_end"] > 0.9
    assert "began again from an ellipsoid" in fitted.notes["warnings"][0]
    assert fitted.mesh.volume == pytest.approx(4 / 3 * np.pi * AXES.prod(), rel=0.1)


def test_another_start_has_as_many_vertices_as_the_first(scene):
    fitted = fit_robustly(ellipsoid([0.45, 0.02, 0.02]), scene, FEW.model_copy(update=KEPT), "hull")
    assert "began again" in fitted.notes["warnings"][0]
    assert len(fitted.mesh.vertices) == 642


def test_an_ellipsoid_is_no_other_start_than_itself(scene):
    """Of silhouettes that no body has: each is one half of the image or the other."""
    halves = np.zeros_like(scene.silhouettes)
    halves[::2, :, :32] = halves[1::2, :, 32:] = True
    torn = replace(scene, silhouettes=halves)
    start = make_initial_mesh(Init(shape="ellipsoid", vertices=642), halves, scene.cameras).mesh
    seen = []
    fitted = fit_robustly(start, torn, PLAIN, "auto", seen.append)
    assert fitted.notes["iou_end"] < 0.9
    assert [record.iteration for record in seen] == [0, 1, 2, 3]
    assert not any("another start" in said for said in fitted.notes["warnings"])


def test_a_fit_that_is_killed_after_another_start_goes_on_there(scene, tmp_path):
    splinter, seen = ellipsoid([0.45, 0.02, 0.02]), []

    def resume(name, of):
        return Checkpoint(tmp_path / f"{name}.pt", of, every=0)

    whole = fit_robustly(splinter, scene, FEW, "hull")

    def kill(record):
        seen.append(record.iteration)
        if len(seen) == 7:  # the third step of the second fit
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_robustly(splinter, scene, FEW, "hull", kill, resume)
    assert seen == [0, 1, 2, 3, 0, 1, 2]
    left = []
    again = fit_robustly(splinter, scene, FEW, "hull", lambda r: left.append(r.iteration), resume)
    assert left == [2, 3]
    np.testing.assert_array_equal(again.mesh.vertices, whole.mesh.vertices)
    assert again.notes == whole.notes


def test_a_second_fit_that_fails_leaves_the_first(scene, monkeypatch):
    fits = []

    def fit(*given):
        fits.append(given)
        if len(fits) == 2:
            raise InputError("numbers that are not finite")
        return fit_mesh(*given)

    monkeypatch.setattr("silmesh.fitting.robust_fit.fit_mesh", fit)
    fitted = fit_robustly(ellipsoid([0.45, 0.02, 0.02]), scene, FEW, "hull")
    assert fitted.notes["iou_end"] < 0.5
    assert "in vain: numbers that are not finite" in fitted.notes["warnings"][-1]


@pytest.mark.parametrize(("shape", "settings"), [("sphere", FEW), ("", FEW), ("hull", LETTER)])
def test_a_start_or_preset_that_is_asked_for_is_kept(scene, shape, settings):
    seen = []
    fitted = fit_robustly(ellipsoid([0.45, 0.02, 0.02]), scene, settings, shape, seen.append)
    assert fitted.notes["iou_end"] < 0.5
    assert len(seen) == 4
    assert fitted.notes["warnings"] == []


def test_a_bitten_view_is_fitted_where_it_is_not_bitten(scene):
    """The fit with every view is given up for one that does not see the bite."""
    bitten = scene.silhouettes.copy()
    columns = np.flatnonzero(bitten[3].any(axis=0))
    bitten[3, :, columns[4 * len(columns) // 5] :] = False
    damaged = replace(scene, silhouettes=bitten)
    start = ellipsoid(0.95 * AXES)
    seen = []
    fitted = fit_robustly(start, damaged, FEW, "hull", seen.append)
    assert fitted.notes["corrected"] == ["v3"]
    assert len(seen) == 8
    assert fitted.notes["iou_end"] > fit_mesh(start, damaged, FEW).notes["iou_end"]
    assert "v3" in fitted.notes["warnings"][0]
    believing = fit_robustly(start, damaged, PLAIN, "hull")
    assert believing.notes["corrected"] == []


def test_a_fit_of_fewer_views_that_fails_leaves_the_first(scene, monkeypatch):
    """Then nothing is said of views that lost their weight, since they have it."""
    bitten = scene.silhouettes.copy()
    columns = np.flatnonzero(bitten[3].any(axis=0))
    bitten[3, :, columns[4 * len(columns) // 5] :] = False
    damaged, start = replace(scene, silhouettes=bitten), ellipsoid(0.95 * AXES)

    def fit(*given):
        if given[-1] is not None:  # what is believed
            raise InputError("numbers that are not finite")
        return fit_mesh(*given)

    monkeypatch.setattr("silmesh.fitting.robust_fit.fit_mesh", fit)
    fitted = fit_robustly(start, damaged, FEW, "hull")
    assert fitted.notes["corrected"] == []
    assert "in vain: numbers that are not finite" in fitted.notes["warnings"][0]


@pytest.mark.parametrize(("elevation", "exact"), [(20, True), (14, False)])
def test_cameras_that_agree_with_the_outlines_stay(elevation, exact):
    seen = silhouettes(turntable(24, 128, 20), AXES, (0.05, 0, 0.03))
    given = turntable(24, 128, elevation)
    scene = Scene(given, Similarity.identity(), seen, np.ones(24), {})
    fitted = fit_mesh(ellipsoid(0.95 * AXES), scene, FastFit(iterations=60, device="cpu"))
    assert fitted.notes["cameras_exact"] == exact
    moved = (fitted.cameras.t - given.t).abs().max(), (fitted.cameras.R - given.R).abs().max()
    assert (max(moved) == 0) == exact


def test_cameras_that_the_fit_sets_right_leave_the_silhouettes_believed():
    """Cameras that are 12 degrees too low contradict right silhouettes; refined ones do not."""
    seen = silhouettes(turntable(24, 64, 20), AXES, (0.05, 0, 0.03))
    scene = Scene(turntable(24, 64, 8), Similarity.identity(), seen, np.ones(24), {})
    assert find_belief(scene, list(range(24)), scene.cameras).contested
    settings = FastFit(iterations=200, device="cpu")
    fitted = fit_robustly(ellipsoid(0.95 * AXES), scene, settings, "hull")
    assert fitted.notes["warnings"] == []
    assert fitted.notes["iou_end"] > 0.99
