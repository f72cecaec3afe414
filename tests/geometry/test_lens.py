"""Lenses: every model against COLMAP's own, their inverses, and where they turn back."""

import math

import numpy as np
import PIL.Image  # noqa: F401, before pycolmap
import pycolmap
import pytest

from silmesh.errors import InputError
from silmesh.geometry.lens import CURVED, PARAMETERS, Lens, lens_of

POINTS = np.random.default_rng(0).uniform(-0.6, 0.6, (200, 2))
MILD = {"SIMPLE_FISHEYE": [], "FISHEYE": [], "FOV": [0.7]}


def parameters(model: str) -> list[float]:
    drawn = np.random.default_rng(len(model)).uniform(-0.05, 0.05, len(PARAMETERS[model]))
    return MILD.get(model, drawn.tolist())


@pytest.mark.parametrize("model", CURVED)
def test_a_model_is_colmaps(model):
    camera = pycolmap.Camera.create_from_model_name(1, model, 1.0, 2, 2)
    values = camera.params.copy()
    values[len(values) - len(CURVED[model]) :] = parameters(model)
    camera.params = values
    expected = camera.img_from_cam(np.c_[POINTS, np.ones(len(POINTS))])
    expected = np.asarray(expected) - [camera.principal_point_x, camera.principal_point_y]
    moved = Lens(model, tuple(parameters(model))).distort(POINTS)
    np.testing.assert_allclose(moved, expected, atol=1e-12)


def test_browns_has_four_terms():
    """At (0.5, 0), with r^2 = 1/4, term by term."""
    moved = Lens("BROWN", (0.4, 0.16, 0.64, 2.56, 0.1, 0.2)).distort(np.array([[0.5, 0.0]]))
    x = 0.5 * (1 + 0.1 + 0.01 + 0.01 + 0.01) + 0.2 * (0.25 + 2 * 0.25)
    np.testing.assert_allclose(moved, [[x, 0.1 * 0.25]])


@pytest.mark.parametrize("model", PARAMETERS)
def test_undistort_is_the_inverse(model):
    lens = Lens(model, tuple(parameters(model)))
    np.testing.assert_allclose(lens.undistort(lens.distort(POINTS)), POINTS, atol=1e-7)


def test_a_barrel_turns_back_where_its_slope_is_zero():
    lens = Lens("SIMPLE_RADIAL", (-0.3,))
    turns = 1 / math.sqrt(0.9)  # 1 - 3 * 0.3 r^2 = 0
    assert lens.reach == pytest.approx(turns, abs=0.02)
    moved = lens.distort(np.array([[0.9 * turns, 0], [1.1 * turns, 0]]))
    assert np.isfinite(moved[0]).all()
    assert np.isnan(moved[1]).all()
    beyond = np.array([[turns * (1 - 0.3 * turns**2) + 0.01, 0]])  # more than it ever reaches
    assert np.isnan(lens.undistort(beyond)).all()


def test_a_fisheye_shows_all_directions():
    assert Lens("FISHEYE", ()).reach == math.inf
    seen = Lens("FISHEYE", ()).distort(np.array([[1.0, 0]]))  # at 45 degrees
    np.testing.assert_allclose(seen, [[math.pi / 4, 0]])


@pytest.mark.parametrize(
    ("model", "values", "lens"),
    [
        ("PINHOLE", [], None),
        ("SIMPLE_PINHOLE", [], None),
        ("OPENCV", [0, 0, 0, 0], None),
        ("SIMPLE_RADIAL", [0.1], Lens("SIMPLE_RADIAL", (0.1,))),
        ("FISHEYE", [], Lens("FISHEYE", ())),
        ("FOV", [0], None),
    ],
)
def test_a_lens_that_bends_nothing_is_none(model, values, lens):
    assert lens_of(model, values) == lens


@pytest.mark.parametrize(
    ("model", "values", "message"),
    [
        ("EQUIRECTANGULAR", [], "camera model 'EQUIRECTANGULAR' cannot be read; known are SIMPLE_"),
        ("OPENCV", [0.1], r"takes 4 finite parameters beyond K \(k1, k2, p1, p2\), not \[0.1\]"),
        ("SIMPLE_RADIAL", [math.nan], "takes 1 finite parameters"),
    ],
)
def test_a_wrong_lens_is_named(model, values, message):
    with pytest.raises(InputError, match=message):
        lens_of(model, values)
