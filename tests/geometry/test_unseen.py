"""Ends of a mesh that no view sees: made-up bodies under a ring of cameras."""

from itertools import pairwise

import numpy as np
import pytest
import torch
import trimesh
from scenes import dome

from silmesh.cameras.turntable import orbit_cameras
from silmesh.geometry.camera import Cameras
from silmesh.geometry.unseen import LOST, _find_gap, find_seen, span_unseen

ELEVATION, RADIUS, HEIGHT = 15.0, 0.25, 0.3
SIZE, DISTANCE = 64, 2.732


def ring(azimuths: np.ndarray, elevation: float = ELEVATION) -> Cameras:
    """Cameras that look at the origin, by default down at it; y is up."""
    azimuths = torch.as_tensor(azimuths, dtype=torch.float64)
    elevations = torch.full_like(azimuths, elevation)
    names = [f"{a:.0f}" for a in azimuths.tolist()]
    return orbit_cameras(names, SIZE, torch.full_like(azimuths, DISTANCE), elevations, azimuths)


ALL_AROUND = ring(np.arange(0, 360, 15.0))


def turn(profile: list[tuple[float, float]], sections: int = 48) -> trimesh.Trimesh:
    """A closed body of revolution about y, of a profile of radii and heights."""
    points = []
    for (r0, y0), (r1, y1) in pairwise(profile):
        t = np.linspace(0, 1, 13)[:-1, None]
        points.append((1 - t) * [r0, y0] + t * [r1, y1])
    body = trimesh.creation.revolve(np.vstack([*points, [profile[-1]]]), sections=sections)
    body.merge_vertices()
    upright = trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0])
    return body.apply_transform(upright)


def cylinder(below: float) -> trimesh.Trimesh:
    """One that runs out below in a cone, as a visual hull does."""
    return turn([(0, -HEIGHT - below), (RADIUS, -HEIGHT), (RADIUS, HEIGHT), (0, HEIGHT)])


def agree(mesh: trimesh.Trimesh) -> float:
    return 1.0


HULL = cylinder(RADIUS * np.tan(np.radians(ELEVATION)))


def test_the_cone_below_what_stands_becomes_flat():
    mesh = span_unseen(HULL, ALL_AROUND, agree)
    below = HULL.vertices[:, 1] < -HEIGHT - 1e-9
    assert below.any()
    edge = RADIUS / 12 * np.tan(np.radians(ELEVATION))  # the first ring about it stays
    assert mesh.vertices[:, 1].min() >= -HEIGHT - edge - 1e-9
    np.testing.assert_array_equal(mesh.vertices[~below], HULL.vertices[~below])
    np.testing.assert_array_equal(mesh.faces, HULL.faces)
    assert mesh.volume == pytest.approx(cylinder(0).volume, rel=0.01)
    assert HULL.volume > 1.03 * cylinder(0).volume
    up = mesh.face_normals[(mesh.vertices[mesh.faces][..., 1] < -HEIGHT - 1e-9).all(axis=1), 1]
    assert (up < -0.999).all(), "none of its triangles is folded over"


def test_each_vertex_has_the_mean_height_of_its_neighbours_and_keeps_its_place():
    mesh = span_unseen(HULL, ALL_AROUND, agree)
    moved = np.flatnonzero((mesh.vertices != HULL.vertices).any(axis=1))
    assert len(moved) > 100
    np.testing.assert_allclose(mesh.vertices[:, [0, 2]], HULL.vertices[:, [0, 2]], atol=1e-9)
    for i in moved[::20]:
        around = mesh.vertices[mesh.vertex_neighbors[i], 1].mean()
        assert mesh.vertices[i, 1] == pytest.approx(around, abs=1e-9)


def test_a_base_that_is_not_convex_is_not_folded():
    """A bent bean, as a shoe stands on: over such an edge means of all coordinates fold."""
    verts = HULL.vertices.copy()
    verts[:, 2] += 6.0 * verts[:, 0] ** 2
    bean = trimesh.Trimesh(verts, HULL.faces, process=False)
    mesh = span_unseen(bean, ALL_AROUND, agree)
    moved = (mesh.vertices != bean.vertices).any(axis=1)
    assert moved.sum() > 100
    base = moved[mesh.faces].all(axis=1)
    assert (mesh.face_normals[base, 1] < 0).all()
    assert np.ptp(mesh.vertices[moved, 1]) < 0.3 * np.ptp(bean.vertices[moved, 1])


def test_an_end_that_takes_from_the_outlines_is_left():
    assert span_unseen(HULL, ALL_AROUND, lambda mesh: mesh.volume / HULL.volume) is HULL


@pytest.mark.parametrize("share", [0.4, 0.8])
def test_what_two_ends_take_counts_together(share):
    """Two cylinders, each of which loses that share of what may be lost."""
    apart = HULL.copy().apply_translation((0.6, 0, 0)), HULL.copy().apply_translation((-0.6, 0, 0))
    both = trimesh.util.concatenate(apart)

    def lose(mesh: trimesh.Trimesh) -> float:
        flat = (mesh.vertices != both.vertices).any(axis=1).reshape(2, -1).any(axis=1)
        return 1 - share * LOST * flat.sum()

    mesh = span_unseen(both, ALL_AROUND, lose)
    flat = (mesh.vertices != both.vertices).any(axis=1).reshape(2, -1).any(axis=1)
    assert flat.sum() == (2 if share < 0.5 else 1)


@pytest.mark.parametrize(
    ("azimuths", "gap"), [([0, 90, 180], 180), ([0, 120, 240], 120), ([350, 20, 100, 200], 150)]
)
def test_the_gap_between_cameras_is_the_widest_angle_about_the_axis(azimuths, gap):
    axis, turn = np.array([0.3, -0.8, 0.5]), np.radians(azimuths)
    across = np.linalg.svd(axis[None])[2][1:]
    directions = np.stack([np.cos(turn), np.sin(turn)], axis=1) @ across + 2.0 * axis
    assert _find_gap(directions, axis) == pytest.approx(gap)


def test_an_unseen_ring_is_left():
    """A collar: what is seen below it, as a stem, is not small."""
    stem = turn([(0, -0.4), (0.12, -0.4), (0.12, 0), (0.3, 0), (0.3, 0.1), (0, 0.1)])
    below = ring(np.arange(0, 360, 15.0), -2.0)
    mesh = span_unseen(stem, below, agree)
    collar = np.isclose(stem.vertices[:, 1], 0)
    np.testing.assert_array_equal(mesh.vertices[collar], stem.vertices[collar])


@pytest.mark.parametrize(("last", "spanned"), [(360, True), (150, False)])
def test_what_is_seen_from_some_sides_only_is_left(last, spanned):
    """A hat, whose top all cameras see: its base is unseen with a flat edge from wherever."""
    hat = turn([(0, -HEIGHT - 0.05), (RADIUS, -HEIGHT), (0, -HEIGHT + 0.1)])
    mesh = span_unseen(hat, ring(np.arange(0, last, 15.0), 60.0), agree)
    assert (mesh is not hat) == spanned


def test_an_edge_that_is_not_flat_is_left():
    verts = HULL.vertices.copy()
    verts[:, 1] += np.where(verts[:, 1] < 0, 2 * verts[:, 0] ** 2 - 1.5 * verts[:, 2] ** 2, 0)
    bent = trimesh.Trimesh(verts, HULL.faces, process=False)
    assert span_unseen(bent, ALL_AROUND, agree) is bent


@pytest.mark.parametrize("seen", [True, False])
def test_a_mesh_of_which_all_is_seen_or_nothing_is_left(seen):
    ball = trimesh.creation.icosphere(3, radius=0.3)
    cameras = dome(30, SIZE)
    frames = None if seen else np.zeros((30, 4))
    assert find_seen(ball, cameras, frames).all() == seen
    assert span_unseen(ball, cameras, agree, frames) is ball


def test_the_floor_of_a_hollow_that_no_view_sees_becomes_flat():
    """Views carve the inside of a cup to a cone whose tip is half as deep as its edge."""
    inner, up = RADIUS - 0.05, np.radians(ELEVATION)
    slope = (DISTANCE * np.sin(up) - HEIGHT) / (DISTANCE * np.cos(up) - inner)  # over the rim
    edge, tip = HEIGHT - 2 * inner * slope, HEIGHT - inner * slope
    outside = [(0, -HEIGHT), (RADIUS, -HEIGHT), (RADIUS, HEIGHT)]
    cup = turn([*outside, (inner, HEIGHT), (inner, edge), (0, tip)])
    mesh = span_unseen(cup, ALL_AROUND, agree)
    kept = 11 / 12  # of the cone's radius: the first of its rings stays
    cone = np.pi * (kept * inner) ** 2 * kept * (tip - edge) / 3
    assert cup.volume - mesh.volume == pytest.approx(cone, rel=0.02)
    inside = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 2]) < 0.8 * inner
    floor = inside & (mesh.vertices[:, 1] > -HEIGHT / 2)
    assert np.ptp(mesh.vertices[floor, 1]) < 0.1 * (tip - edge)


def test_a_camera_sees_what_faces_it_within_its_frame_and_is_not_hidden():
    """Two cubes behind each other before one level camera, which looks along the axis z."""
    level = orbit_cameras(["front"], SIZE, *torch.tensor([[DISTANCE], [0], [0]]).double())
    near, far = (trimesh.creation.box((0.3, 0.3, 0.1)).subdivide() for _ in range(2))
    near.apply_translation((0.1, 0, 0.2))
    far.apply_translation((0, 0, -0.2))
    both = trimesh.util.concatenate([near, far])
    front = np.isclose(both.vertices[:, 2], 0.25)
    middle = front & np.isclose(both.vertices[:, :2], (0.1, 0)).all(axis=1)  # squarely faced
    behind = np.isclose(both.vertices[:, 2], -0.25)
    left = np.isclose(both.vertices, (-0.15, 0, -0.15)).all(axis=1)  # an edge that is not hidden
    hidden = np.isclose(both.vertices, (0, 0, -0.15)).all(axis=1)
    seen = find_seen(both, level)
    assert middle.any()
    assert hidden.any()
    assert seen[middle | left].all()
    assert not seen[hidden | behind].any()
    half = find_seen(both, level, [(0, 0, SIZE // 2, SIZE)])
    assert not half[middle].any()
    assert half[left].all()
