"""Sheets whose sides have passed through each other, and sound bodies, which stay as they are."""

import numpy as np
import pytest
import trimesh

from silmesh.evaluation.mesh_quality import count_intersections
from silmesh.fitting.untangle import untangle
from silmesh.shapes.sphere import unit_sphere

GAP = 0.01


def winding(mesh: trimesh.Trimesh, point: np.ndarray) -> float:
    """How many times a surface goes around a point: the solid angles that its faces subtend."""
    a, b, c = np.moveaxis(np.asarray(mesh.triangles) - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    over = np.einsum("ni,ni->n", a, np.cross(b, c))
    under = la * lb * lc + lc * (a * b).sum(1) + la * (b * c).sum(1) + lb * (a * c).sum(1)
    return float(2 * np.arctan2(over, under).sum() / (4 * np.pi))


def wing(dent: float) -> trimesh.Trimesh:
    """A flat ellipsoid whose upper side is pushed down at one place, the lower one up."""
    mesh = unit_sphere(1352)
    verts = mesh.vertices * [1.0, 0.02, 0.6]
    near = np.exp(-((verts[:, 0] - 0.4) ** 2 + verts[:, 2] ** 2) / 0.02)
    verts[:, 1] -= dent * near * np.sign(verts[:, 1])
    return trimesh.Trimesh(verts, mesh.faces, process=False)


def test_sides_that_have_passed_through_each_other_come_back():
    mesh, middle = wing(0.04), np.array([0.4, 0.0, 0.0])
    assert count_intersections(mesh.vertices, mesh.faces) > 0
    assert winding(mesh, middle) == pytest.approx(-1, abs=0.01)
    verts = untangle(mesh.vertices, mesh.faces, GAP)
    assert count_intersections(verts, mesh.faces) == 0
    again = trimesh.Trimesh(verts, mesh.faces, process=False)
    assert winding(again, middle) == pytest.approx(1, abs=0.01)
    moved = np.linalg.norm(verts - mesh.vertices, axis=1)
    assert moved.max() < 0.05
    assert not moved[mesh.vertices[:, 0] < -0.3].any()


@pytest.mark.parametrize(
    "mesh", [wing(0.0), wing(0.015), unit_sphere(642), trimesh.creation.torus(0.5, 0.1)]
)
def test_a_sound_body_stays_as_it_is(mesh):
    np.testing.assert_array_equal(untangle(mesh.vertices, mesh.faces, GAP), mesh.vertices)
