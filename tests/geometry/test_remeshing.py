import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from silmesh.geometry.remeshing import (
    collapse_short,
    even_length,
    flip_edges,
    relax,
    remesh,
    split_long,
)


def ball(stretch=(1, 1, 1)):
    mesh = trimesh.creation.icosphere(3)
    return mesh.vertices * stretch, mesh.faces


def ring():
    mesh = trimesh.creation.torus(1, 0.35, major_sections=60, minor_sections=12)
    return mesh.vertices * (1, 1, 1.5), mesh.faces


def solid(verts, faces):
    return trimesh.Trimesh(verts, faces, process=False)


@pytest.mark.parametrize(("made", "euler"), [(ball((1, 4, 1)), 2), (ring(), 0)])
@pytest.mark.parametrize("count", [600, 5000])
def test_edges_become_even_and_the_body_stays(made, euler, count):
    before = solid(*made)
    length = even_length(*made, count)
    after = solid(*remesh(*made, length))
    assert after.is_watertight
    assert after.is_winding_consistent
    assert after.euler_number == euler
    assert after.body_count == 1
    assert len(after.faces) == pytest.approx(count, rel=0.15)
    assert after.volume == pytest.approx(before.volume, rel=0.1 if count == 600 else 0.02)
    assert after.edges_unique_length.std() < 0.2 * after.edges_unique_length.mean()
    assert np.degrees(after.face_angles.min()) > 20
    surface, _ = trimesh.sample.sample_surface(before, 200_000, seed=0)
    assert cKDTree(surface).query(after.vertices)[0].max() < 0.35 * length


def test_one_long_edge_is_halved_in_both_its_triangles():
    #     2
    #   / | \     the edge 01 is 2 long, the others 1.2; about it lie 012 and 103
    #  0--4--1
    #   \ | /
    #     3
    verts = np.array([[-1, 0, 0], [1, 0, 0], [0, 0.6, 0], [0, -0.6, 0]], float)
    faces = np.array([[0, 1, 2], [1, 0, 3]])
    new, cut = split_long(verts, faces, 1.5)
    np.testing.assert_array_equal(new[4], [0, 0, 0])
    expected = {(0, 4, 2), (4, 1, 2), (1, 4, 3), (4, 0, 3)}
    turned = {tuple(np.roll(face, -k)) for face in cut for k in range(3)}
    assert len(cut) == 4
    assert expected <= turned


def test_two_and_three_long_edges_leave_no_crack():
    verts, faces = ball((1, 3, 1))
    new, cut = split_long(verts, faces, 0.3)
    assert len(cut) > len(faces)
    assert solid(new, cut).is_watertight
    assert solid(new, cut).volume == pytest.approx(solid(verts, faces).volume, rel=1e-12)


def test_a_tetrahedron_cannot_collapse():
    mesh = trimesh.creation.icosahedron()
    tetrahedron = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
                                  [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])  # fmt: skip
    for made in (mesh, tetrahedron):
        verts, faces = collapse_short(made.vertices, made.faces, 100.0, 100.0)
        assert solid(verts, faces).is_watertight
        assert len(faces) >= 4


def test_an_edge_is_flipped_where_the_degrees_gain():
    # a flat fan of two bad triangles in a grid: the long diagonal's ends have degree 7
    verts, faces = remesh(*ball(), 0.2)
    degree = np.bincount(faces.ravel())
    worse = faces.copy()
    flipped = flip_edges(verts, worse)
    after = np.bincount(flipped.ravel())
    assert ((after - 6) ** 2).sum() <= ((degree - 6) ** 2).sum()
    assert solid(verts, flipped).is_watertight


def test_relaxing_moves_within_the_surface():
    verts, faces = ball()
    rough = verts + np.random.default_rng(0).normal(0, 0.02, verts.shape)
    rough /= np.linalg.norm(rough, axis=1, keepdims=True)
    smooth = relax(rough, faces)
    assert np.abs(np.linalg.norm(smooth, axis=1) - 1).max() < 0.01
    spread = [solid(v, faces).edges_unique_length.std() for v in (rough, smooth)]
    assert spread[1] < 0.8 * spread[0]


def test_the_same_mesh_gives_the_same_bytes():
    first, again = (remesh(*ring(), 0.15) for _ in range(2))
    assert first[0].tobytes() == again[0].tobytes()
    assert first[1].tobytes() == again[1].tobytes()
