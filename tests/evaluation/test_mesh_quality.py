"""Quality of meshes whose soundness is known by hand."""

import numpy as np
import pytest
import trimesh

from silmesh.evaluation.mesh_quality import count_intersections, measure_quality


def joined(*meshes):
    """Meshes side by side, no vertex shared between them."""
    return trimesh.util.concatenate(meshes)


def test_a_sphere_is_sound():
    quality = measure_quality(trimesh.creation.icosphere(3))
    assert quality["watertight"]
    assert quality["manifold"]
    assert (quality["components"], quality["genus"]) == (1, 0)
    assert quality["self_intersections"] == 0
    assert 40 < quality["smallest_angle"] <= quality["small_angle"] <= 60
    assert 0 < quality["edge_length_spread"] < 0.15


def test_even_triangles_have_sixty_degrees_and_no_spread():
    quality = measure_quality(trimesh.creation.icosahedron())
    assert quality["smallest_angle"] == pytest.approx(60, abs=1e-4)
    assert quality["edge_length_spread"] == pytest.approx(0, abs=1e-6)


def test_a_box_by_hand():
    """Twelve edges of 1 and six diagonals of sqrt 2, angles of 45 degrees."""
    quality = measure_quality(trimesh.creation.box())
    lengths = np.array([1.0] * 12 + [2**0.5] * 6)
    assert quality["edge_length_spread"] == pytest.approx(lengths.std() / lengths.mean())
    assert quality["smallest_angle"] == pytest.approx(45)


def test_handles_and_pieces_are_counted():
    ring = trimesh.creation.torus(1, 0.3)
    apart = trimesh.creation.icosphere(1).apply_translation([5, 0, 0])
    assert measure_quality(ring)["genus"] == 1
    both = measure_quality(joined(ring, apart))
    assert (both["components"], both["genus"]) == (2, 1)


def test_a_hole_is_seen():
    ball = trimesh.creation.icosphere(2)
    holed = trimesh.Trimesh(ball.vertices, ball.faces[1:], process=False)
    quality = measure_quality(holed)
    assert (quality["watertight"], quality["manifold"], quality["genus"]) == (False, True, None)


def test_two_cones_that_share_a_tip_are_not_manifold():
    one = trimesh.creation.icosphere(1)
    other = one.copy().apply_translation(2 * one.vertices[0])
    tip = int(np.linalg.norm(other.vertices - one.vertices[0], axis=1).argmin())
    faces = other.faces + len(one.vertices)
    faces[other.faces == tip] = 0
    both = trimesh.Trimesh(
        np.concatenate([one.vertices, other.vertices]),
        np.concatenate([one.faces, faces]),
        process=False,
    )
    quality = measure_quality(both)
    assert (quality["watertight"], quality["manifold"]) == (True, False)
    assert quality["components"] == 1


def test_three_faces_at_an_edge_are_not_manifold():
    verts = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 1, 0], [-1, -1, 0]], float)
    fin = trimesh.Trimesh(verts, [[0, 1, 2], [0, 1, 3], [0, 1, 4]], process=False)
    assert not measure_quality(fin)["manifold"]


def test_a_face_turned_round_is_not_watertight():
    ball = trimesh.creation.icosphere(1)
    ball.faces[3] = ball.faces[3][::-1]
    turned = trimesh.Trimesh(ball.vertices, ball.faces, process=False)
    assert not measure_quality(turned)["watertight"]


def count(mesh):
    return count_intersections(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def crossing(offset):
    """A triangle in the plane z = 0, and an upright one whose tip is at z = -offset."""
    flat = [[-2, -2, 0], [2, -2, 0], [0, 3, 0]]
    upright = [[0, 0, -offset], [1, 0.1, 1], [-1, 0.2, 1]]
    return trimesh.Trimesh(np.array(flat + upright, float), [[0, 1, 2], [3, 4, 5]], process=False)


@pytest.mark.parametrize(("offset", "expected"), [(0.5, 1), (-0.5, 0), (0, 0)])
def test_two_triangles_cut_or_touch_or_miss(offset, expected):
    assert count(crossing(offset)) == expected


def test_triangles_that_share_a_vertex_may_cut():
    #  both begin at 0; the second passes through the first, or only leaves from its tip
    verts = np.array([[0, 0, 0], [2, -1, 0], [2, 1, 0], [1, 0, 1], [1, 0, -1], [-1, 0, 1]], float)
    assert count_intersections(verts, np.array([[0, 1, 2], [0, 3, 4]])) == 1
    assert count_intersections(verts, np.array([[0, 1, 2], [0, 3, 5]])) == 0


def test_against_every_pair_by_another_way():
    """Random triangles, against sampling each pair's common line."""
    generator = np.random.default_rng(0)
    triangles = generator.uniform(-1, 1, (60, 1, 3)) + generator.normal(0, 0.35, (60, 3, 3))
    verts, faces = triangles.reshape(-1, 3), np.arange(180).reshape(-1, 3)
    expected = sum(meet(triangles[i], triangles[j]) for i in range(60) for j in range(i + 1, 60))
    assert expected > 10
    assert count_intersections(verts, faces) == expected


def meet(one, other):
    """Whether the intervals overlap in which the planes' common line crosses two triangles."""
    normals = [np.cross(t[1] - t[0], t[2] - t[0]) for t in (one, other)]
    along = np.cross(*normals)
    intervals = []
    for triangle, base, normal in ((one, other[0], normals[1]), (other, one[0], normals[0])):
        height = (triangle - base) @ normal
        crossings = []
        for k in range(3):
            p, q = height[k], height[(k + 1) % 3]
            if p * q < 0:
                s = p / (p - q)
                point = triangle[k] + s * (triangle[(k + 1) % 3] - triangle[k])
                crossings.append(point @ along)
        if len(crossings) < 2:
            return False
        intervals.append((min(crossings), max(crossings)))
    (a, b), (c, d) = intervals
    return max(a, c) < min(b, d)


def test_a_ball_that_passes_through_itself():
    ball = trimesh.creation.icosphere(3)
    moved = ball.copy().apply_translation([0.3, 0.21, 0.13])
    assert count(joined(ball, moved)) > 100
    assert count(joined(ball, ball.copy().apply_scale(0.5))) == 0
