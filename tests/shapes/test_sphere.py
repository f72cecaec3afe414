import numpy as np
import pytest

from silmesh.errors import InputError
from silmesh.shapes.sphere import unit_sphere

COUNTS = [(642, 1280), (1352, 2700), (1922, 3840), (12, 20), (100, 196)]


@pytest.mark.parametrize(("verts", "faces"), COUNTS)
def test_a_closed_outward_sphere_of_radius_1_with_so_many_vertices(verts, faces):
    sphere = unit_sphere(verts)
    assert (len(sphere.vertices), len(sphere.faces)) == (verts, faces)
    assert len(np.unique(sphere.faces)) == verts  # each vertex has a neighbour
    assert sphere.is_watertight
    assert sphere.is_winding_consistent
    assert sphere.euler_number == 2
    np.testing.assert_allclose(np.linalg.norm(sphere.vertices, axis=1), 1, atol=1e-12)
    outwards = np.einsum("fi,fi->f", sphere.face_normals, sphere.triangles_center)
    assert (outwards > 0).all()


@pytest.mark.parametrize("verts", [642, 1352, 1922])
def test_the_volume_is_nearly_a_balls(verts):
    assert 0.985 < unit_sphere(verts).volume / (4 / 3 * np.pi) < 1


def test_the_uv_sphere_has_its_poles_on_y_and_its_rings_about_it():
    verts = unit_sphere(1922).vertices
    poles = np.abs(verts[:, 1]) > 1 - 1e-9
    np.testing.assert_allclose(np.sort(verts[poles, 1]), [-1, 1])
    # 15 parallels of 32 vertices, each edge of which is split
    equator = np.abs(verts[:, 1]) < 1e-9
    assert equator.sum() == 64


@pytest.mark.parametrize("verts", [642, 1352, 1922])
def test_spheres_are_the_same_each_time(verts):
    np.testing.assert_array_equal(unit_sphere(verts).faces, unit_sphere(verts).faces)


def test_triangles_are_even():
    areas = unit_sphere(1352).area_faces
    assert areas.std() / areas.mean() < 0.2


def test_too_few_vertices_are_refused():
    with pytest.raises(InputError, match="11 vertices: should have at least 12"):
        unit_sphere(11)


@pytest.mark.parametrize("vertices", [12, 50, 1352])
def test_even_triangles_are_nearly_equilateral(vertices):
    mesh = unit_sphere(vertices)
    longest, shortest = np.ptp(mesh.face_angles, axis=1).max(), mesh.face_angles.min()
    assert np.degrees(shortest) > 35
    assert np.degrees(longest) < 55
