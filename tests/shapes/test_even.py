import numpy as np
import pytest
import trimesh

from silmesh.shapes.even import even_mesh


@pytest.mark.parametrize("vertices", [150, 301, 1000])
def test_the_count_is_exact_and_the_triangles_even(vertices):
    ball = trimesh.creation.icosphere(subdivisions=4)  # 2,562 vertices, many edges of one length
    mesh = even_mesh(ball, vertices)
    assert len(mesh.vertices) == vertices
    assert len(mesh.faces) == 2 * vertices - 4
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1, atol=0.01)
    edges = mesh.edges_unique_length
    assert edges.std() < 0.2 * edges.mean()
    assert np.degrees(mesh.face_angles.min()) > 25


def test_a_torus_stays_one():
    torus = trimesh.creation.torus(1.0, 0.35, major_sections=96, minor_sections=48)
    mesh = even_mesh(torus, 700)
    assert mesh.is_watertight
    assert len(mesh.vertices) == 700
    assert len(mesh.faces) == 1400  # F = 2 (V - chi), chi = 0
    around = np.hypot(np.linalg.norm(mesh.vertices[:, :2], axis=1) - 1, mesh.vertices[:, 2])
    np.testing.assert_allclose(around, 0.35, atol=0.01)


def test_it_is_the_same_each_time():
    ball = trimesh.creation.icosphere(subdivisions=3)
    np.testing.assert_array_equal(even_mesh(ball, 200).vertices, even_mesh(ball, 200).vertices)
