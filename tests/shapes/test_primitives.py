import numpy as np
import pytest
import trimesh
from scenes import dome, turntable

from silmesh.geometry.overlap import mean_iou
from silmesh.shapes.downsample import render
from silmesh.shapes.primitives import (
    PRIMITIVES,
    placed_primitive,
    plain_primitive,
    unit_primitive,
)

SIZE = 96


def is_closed(mesh):
    """Every edge has two faces, every vertex one fan of them, and the inside is inside."""
    edges = np.sort(mesh.edges, axis=1)
    twice = np.unique(edges, axis=0, return_counts=True)[1] == 2
    return twice.all() and mesh.is_winding_consistent and mesh.volume > 0


@pytest.mark.parametrize("shape", PRIMITIVES)
@pytest.mark.parametrize("vertices", [101, 642])
def test_a_primitive_is_closed_even_and_of_unit_half_lengths(shape, vertices):
    mesh = plain_primitive(shape, vertices)
    assert len(mesh.vertices) == vertices
    assert len(mesh.faces) == 2 * vertices - 4
    assert is_closed(mesh)
    np.testing.assert_allclose(mesh.bounds, [[-1] * 3, [1] * 3], atol=0.1)
    edges = mesh.edges_unique_length
    assert edges.std() < 0.25 * edges.mean()
    assert np.degrees(mesh.face_angles.min()) > 20


def test_volumes_are_those_of_the_solids():
    ball, cylinder, cube = (unit_primitive(shape, 4000).volume for shape in PRIMITIVES)
    assert ball == pytest.approx(4 / 3 * np.pi, rel=0.01)
    assert 0.9 * 2 * np.pi < cylinder < 2 * np.pi  # rounded
    assert 0.85 * 8 < cube < 8


def test_corners_lie_where_the_power_puts_them():
    # On the diagonal 3 x^8 = 1, so x = 3^(-1/8) = 0.8717; of the cylinder's rim 2 x^8 = 1.
    corner = np.array([[1.0, 1, 1]]) / np.sqrt(3)
    on_cube = corner / PRIMITIVES["cube"].level(corner, 8)[:, None]
    np.testing.assert_allclose(on_cube, [[0.8717] * 3], atol=1e-4)
    rim = np.array([[1.0, 1, 0]])
    on_cylinder = rim / PRIMITIVES["cylinder"].level(rim, 8)[:, None]
    np.testing.assert_allclose(on_cylinder, [[2 ** (-1 / 8)] * 2 + [0]], atol=1e-9)


def seen_from_all_around(mesh, cameras):
    return render(mesh, cameras, (SIZE, SIZE))


@pytest.mark.parametrize("shape", ["cylinder", "cube"])
def test_a_primitive_finds_itself(shape):
    """Turned, stretched and moved, it is found again by its silhouettes alone."""
    cameras = turntable(12, SIZE, elevation=20)
    truth = unit_primitive(shape, 1000)
    truth.apply_scale([0.15, 0.35, 0.25] if shape == "cube" else [0.15, 0.4, 0.15])
    truth.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 6, [0, 1, 0]))
    truth.apply_translation([0.05, -0.02, 0.08])
    seen = seen_from_all_around(truth, cameras)
    found = placed_primitive(shape, 300, seen, cameras)
    assert is_closed(found)
    assert mean_iou(seen_from_all_around(found, cameras), seen) > 0.94
    assert found.volume == pytest.approx(truth.volume, rel=0.06)
    np.testing.assert_allclose(found.centroid, truth.centroid, atol=0.02)


@pytest.mark.parametrize("shape", ["cylinder", "cube"])
def test_a_primitive_is_as_round_as_the_silhouettes(shape):
    """Of a box's corners, on the diagonal, the sharp one lies further out."""
    cameras, volumes = turntable(12, SIZE, elevation=20), []
    for power in (8.0, 2.5):
        truth = unit_primitive(shape, 1000, power)
        truth.apply_scale([0.15, 0.35, 0.25] if shape == "cube" else [0.2, 0.3, 0.2])
        seen = seen_from_all_around(truth, cameras)
        found = placed_primitive(shape, 300, seen, cameras)
        assert mean_iou(seen_from_all_around(found, cameras), seen) > 0.95
        volumes.append(found.volume / np.prod(found.extents))
    assert volumes[0] > 1.15 * volumes[1]


def test_a_lying_cylinder_is_found_along_its_axis():
    cameras = dome(14, SIZE)
    truth = trimesh.creation.cylinder(0.12, 0.8)
    truth.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0.4]))
    seen = seen_from_all_around(truth, cameras)
    found = placed_primitive("cylinder", 300, seen, cameras)
    assert mean_iou(seen_from_all_around(found, cameras), seen) > 0.9


def test_it_is_placed_by_contradicting_views_too():
    cameras = turntable(6, SIZE)
    high = unit_primitive("ellipsoid", 300)
    high.apply_scale(0.1)
    low = high.copy()
    high.apply_translation([0, 0.3, 0])
    low.apply_translation([0, -0.3, 0])
    seen = np.concatenate(
        [seen_from_all_around(high, cameras)[:3], seen_from_all_around(low, cameras)[3:]]
    )
    mesh = placed_primitive("ellipsoid", 162, seen, cameras)
    assert is_closed(mesh)
    assert np.isfinite(mesh.vertices).all()
    assert np.abs(mesh.vertices).max() < 1
