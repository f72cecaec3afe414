"""What the page shows of a fit: where the meshes, the outlines and the cameras lie."""

import re

import numpy as np
import pytest
import trimesh
from pages import SIZE, box, cameras, read_glb, similarity

from silmesh.report.exhibit import describe_exhibit
from silmesh.report.outlines import UNITS
from silmesh.report.packing import unpack
from silmesh.report.pictures import camera_of, trace


@pytest.fixture(scope="module")
def exhibit():
    mesh = box((0.5, 0.8, 0.4))
    colours = np.full((len(mesh.vertices), 3), 0.5)
    first = trimesh.creation.icosphere(1, 0.4)
    return describe_exhibit(mesh, colours, first, cameras(), similarity(), 1e-5)


def test_both_meshes_lie_in_the_normalised_world(exhibit):
    fitted, first = (read_glb(unpack(exhibit[name])) for name in ("fitted", "first"))
    np.testing.assert_allclose(fitted.bounds[1], [0.25, 0.4, 0.2], atol=1e-4)
    np.testing.assert_allclose(fitted.bounds.sum(axis=0), 0, atol=1e-4)
    assert first.bounds[1].max() == pytest.approx(0.2, abs=1e-4)  # halved, as the fit begins


def test_outlines_are_those_of_what_the_cameras_see(exhibit):
    mesh = box((0.5, 0.8, 0.4))
    for i, (_, path) in enumerate(exhibit["outlines"].items()):
        start = np.array(re.match(r"M(-?\d+) (-?\d+)", path).groups(), int)
        steps = np.array(re.search(r"l([^z]*)z", path)[1].split(), int).reshape(-1, 2)
        points = np.concatenate([[start], start + steps.cumsum(axis=0)]) * SIZE / UNITS
        rows, columns = np.nonzero(trace(mesh, camera_of(cameras(), i)).mask)
        seen = [columns.min(), rows.min()], [columns.max() + 1, rows.max() + 1]
        np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], seen, atol=1)


def test_the_first_camera_stands_behind_what_it_looks_ahead_of(exhibit):
    up, ahead = np.array(exhibit["up"]), np.array(exhibit["ahead"])
    np.testing.assert_allclose(up, [0, 1, 0], atol=1e-6)
    assert up @ ahead == pytest.approx(0, abs=1e-9)
    apex = np.array(exhibit["cameras"]["apexes"][0])
    assert apex @ ahead < -0.9 * np.linalg.norm(apex)
    assert exhibit["cameras"]["views"][1] == "r45"
