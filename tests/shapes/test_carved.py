import numpy as np
import pytest
import trimesh
from scenes import dome, silhouettes, turntable

from silmesh.geometry.overlap import mean_iou
from silmesh.geometry.visual_hull import Hull
from silmesh.shapes.carved import EmptyHull, choose_tolerated, draw, hull_mesh, prism_mesh
from silmesh.shapes.downsample import render

SIZE = 96
PIXEL = 2.732 * np.tan(np.radians(15)) * 2 / SIZE  # a pixel's size at the origin


def is_closed(mesh):
    edges = np.unique(np.sort(mesh.edges, axis=1), axis=0, return_counts=True)[1]
    return (edges == 2).all() and mesh.is_winding_consistent and mesh.volume > 0


def see(mesh, cameras):
    return render(mesh, cameras, (SIZE, SIZE))


def genus_of(carved):
    """Tunnels through a carved mesh."""
    return 1 - carved.mesh.euler_number // 2


@pytest.fixture(scope="module")
def ring():
    """A torus about z, as a mug's handle, and its silhouettes from all around."""
    torus = trimesh.creation.torus(0.3, 0.1, major_sections=64, minor_sections=32)
    cameras = dome(30, SIZE)
    return cameras, see(torus, cameras), torus


def test_a_handle_keeps_its_hole(ring):
    cameras, seen, torus = ring
    carved = hull_mesh(seen, cameras, 700, "keep")
    assert genus_of(carved) == 1
    assert len(carved.mesh.vertices) == 700
    assert len(carved.mesh.faces) == 1400
    assert is_closed(carved.mesh)
    assert mean_iou(see(carved.mesh, cameras), seen) > 0.93
    assert carved.mesh.volume == pytest.approx(torus.volume, rel=0.12)
    assert not carved.mesh.contains([[0, 0, 0]])[0]


def test_the_hole_is_closed_where_a_sphere_is_asked_for(ring):
    cameras, seen, _ = ring
    carved = hull_mesh(seen, cameras, 500, "sphere")
    assert genus_of(carved) == 0
    assert len(carved.mesh.vertices) == 500
    assert is_closed(carved.mesh)
    assert carved.mesh.contains([[0, 0, 0]])[0]


def test_triangles_are_even(ring):
    cameras, seen, _ = ring
    mesh = hull_mesh(seen, cameras, 700, "keep").mesh
    edges = mesh.edges_unique_length
    assert edges.std() < 0.25 * edges.mean()
    assert np.degrees(np.percentile(mesh.face_angles.min(axis=1), 5)) > 35


def field_of(distance):
    """A sampled field on 40 samples a side of a cube of half-length 0.5."""
    steps = np.linspace(-0.5, 0.5, 40)
    points = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
    spacing = np.full(3, steps[1] - steps[0])
    return Hull(distance(points).astype(np.float32), np.full(3, -0.5), spacing)


def ball(points, centre, radius):
    return radius - np.linalg.norm(points - np.array(centre), axis=-1)


def test_of_several_pieces_the_largest_is_kept():
    hull = field_of(lambda p: np.maximum(ball(p, [-0.2, 0, 0], 0.2), ball(p, [0.25, 0, 0], 0.1)))
    carved = draw(hull, 200, "keep")
    assert carved.pieces == 2
    assert carved.lost == pytest.approx(1 / 9, abs=0.01)  # 0.1^3 of 0.1^3 + 0.2^3
    np.testing.assert_allclose(carved.mesh.centroid, [-0.2, 0, 0], atol=0.01)


def test_a_hollow_inside_is_no_piece():
    hull = field_of(lambda p: np.minimum(ball(p, [0, 0, 0], 0.4), -ball(p, [0, 0, 0], 0.2)))
    carved = draw(hull, 200, "keep")
    assert carved.pieces == 1
    assert genus_of(carved) == 0
    assert carved.mesh.volume == pytest.approx(4 / 3 * np.pi * 0.4**3, rel=0.05)


def test_a_tunnel_narrower_than_an_edge_is_closed():
    def drilled(points):
        return np.minimum(
            ball(points, [0, 0, 0], 0.4), np.linalg.norm(points[..., :2], axis=-1) - 0.03
        )

    assert genus_of(draw(field_of(drilled), 200, "keep")) == 0


def test_an_empty_hull_names_the_views_that_empty_it():
    cameras = turntable(5, SIZE)  # so few that none may disagree
    seen = silhouettes(cameras, [0.2] * 3)
    seen[3] = np.roll(seen[3], 45, axis=0)  # below the others
    with pytest.raises(EmptyHull, match=r"contradict each other, most of all in v3$"):
        hull_mesh(seen, cameras, 200, "keep")


def test_one_of_many_views_may_disagree():
    cameras = turntable(24, SIZE, elevation=10)
    seen = silhouettes(cameras, [0.2, 0.3, 0.2])
    assert choose_tolerated(seen, cameras) == 0
    seen[4] = np.roll(seen[4], 60, axis=0)
    assert choose_tolerated(seen, cameras) == 1
    mesh = hull_mesh(seen, cameras, 300, "keep").mesh
    good = np.delete(np.arange(24), 4)
    assert mean_iou(see(mesh, cameras)[good], seen[good]) > 0.93


def test_a_prism_is_extruded_along_its_view():
    """A box that stands square before the first camera is its own prism, but for perspective."""
    cameras = turntable(8, SIZE)
    box = trimesh.creation.box([0.5, 0.3, 0.2])
    seen = see(box, cameras)
    carved = prism_mesh(seen, cameras, 600, "keep")
    assert is_closed(carved.mesh)
    assert len(carved.mesh.vertices) == 600
    assert carved.mesh.volume == pytest.approx(box.volume, rel=0.25)
    assert mean_iou(see(carved.mesh, cameras), seen) > 0.85
    np.testing.assert_allclose(carved.mesh.centroid, [0, 0, 0], atol=1.5 * PIXEL)


def test_a_prism_keeps_the_hole_of_its_silhouette(ring):
    cameras, seen, _ = ring
    assert genus_of(prism_mesh(seen, cameras, 600, "sphere")) == 0
    level = turntable(8, SIZE)
    torus = trimesh.creation.torus(0.3, 0.1, major_sections=64, minor_sections=32)
    assert genus_of(prism_mesh(see(torus, level), level, 600, "keep")) == 1
