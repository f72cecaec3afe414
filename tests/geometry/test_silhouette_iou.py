import numpy as np
import pytest
import torch
import trimesh
from scenes import dome, silhouettes

from silmesh.evaluation.ground_truth import compare_to_truth
from silmesh.evaluation.metrics import summarise_iou
from silmesh.geometry.mesh_files import to_tensors
from silmesh.geometry.silhouette_iou import silhouette_iou
from silmesh.softras import soft_silhouettes

SHARP = 1e-6  # sigma: SoftRas's 1e-4 widens an outline of 64 pixels by half a pixel


@pytest.fixture(autouse=True)
def _few_samples(monkeypatch):
    monkeypatch.setattr("silmesh.evaluation.ground_truth.SAMPLES", 20_000)
    monkeypatch.setattr("silmesh.evaluation.ground_truth.VOLUME_SAMPLES", 20_000)


def sphere(radius, centre=(0, 0, 0)):
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    mesh.apply_translation(centre)
    return mesh


@pytest.mark.parametrize(("radius", "f_score"), [(0.8, 0), (0.98, 1)])
def test_concentric_spheres(radius, f_score):
    """Points are near within 1 % of the diagonal, 0.01 * 2 sqrt(3) = 0.035."""
    metrics = compare_to_truth(sphere(radius), sphere(1.0))
    assert metrics["volume_iou"] == pytest.approx(radius**3, abs=0.015)
    assert metrics["chamfer"] == pytest.approx(1 - radius, abs=0.0005)
    assert metrics["f_score"] == pytest.approx(f_score, abs=0.01)
    assert metrics["normal_consistency"] > 0.995


def test_the_same_surface():
    metrics = compare_to_truth(sphere(1.0), sphere(1.0))
    assert metrics["volume_iou"] == 1
    assert metrics["f_score"] == 1
    assert metrics["chamfer"] < 1e-6


def test_spheres_apart():
    metrics = compare_to_truth(sphere(0.5), sphere(0.5, (2, 0, 0)))
    assert metrics["volume_iou"] == 0
    assert metrics["f_score"] == 0
    far = 2 + 0.5**2 / (3 * 2)  # mean distance of a sphere's points from a point 2 from its centre
    assert metrics["chamfer"] == pytest.approx(far - 0.5, abs=0.005)


def test_boxes_that_overlap_by_half():
    box = trimesh.creation.box((2, 1, 1))
    moved = box.copy().apply_translation((1, 0, 0))
    assert compare_to_truth(box, moved)["volume_iou"] == pytest.approx(1 / 3, abs=0.015)


def test_normals_at_right_angles():
    flat = trimesh.creation.box((1, 1, 1e-6))
    upright = flat.copy().apply_transform(
        trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0])
    )
    assert compare_to_truth(flat, upright)["normal_consistency"] < 0.01


def test_an_ellipsoids_mesh_covers_its_silhouettes():
    cameras = dome(20, 64)  # more than are rendered at once
    axes = [0.45, 0.25, 0.35]
    mesh = sphere(1.0)
    mesh.vertices *= axes
    iou = silhouette_iou(*to_tensors(mesh), cameras, silhouettes(cameras, axes), SHARP)
    assert iou.shape == (20,)
    assert iou.min() > 0.96


def test_iou_counts_pixels():
    """Against a silhouette that holds the mesh's and as much again."""
    cameras = dome(3, 64)
    seen = silhouettes(cameras, [0.3] * 3)
    mesh = to_tensors(sphere(0.3))
    twice = seen.copy()
    for view in twice:
        view[np.unravel_index(np.flatnonzero(~view)[: view.sum()], view.shape)] = True
    np.testing.assert_allclose(silhouette_iou(*mesh, cameras, twice, SHARP), 0.5, atol=0.02)
    assert silhouette_iou(*mesh, cameras, ~seen, SHARP).max() < 0.03


def test_a_mesh_behind_the_cameras_covers_nothing():
    cameras = dome(2, 32)
    behind = torch.tensor([[0.0, 50, 0], [1, 50, 0], [0, 51, 0]])
    seen = silhouettes(cameras, [0.3] * 3)
    iou = silhouette_iou(behind, torch.tensor([[0, 1, 2]]), cameras, seen, SHARP)
    assert iou.tolist() == [0, 0]


@pytest.mark.parametrize("sigma", [SHARP, 1e-4])
def test_a_part_of_the_image_counts_as_the_whole_does(sigma):
    """The object in a corner, and silhouettes in the middle, against the rendering of all."""
    cameras, mesh = dome(4, 96), sphere(0.2, (0.25, -0.15, 0.1))
    verts, faces = to_tensors(mesh)
    seen = silhouettes(cameras, [0.2, 0.3, 0.15])
    with torch.no_grad():
        whole = soft_silhouettes(cameras.project(verts), faces, (96, 96), sigma=sigma) > 0.5
    both, either = (whole.numpy() & seen, whole.numpy() | seen)
    found = silhouette_iou(verts, faces, cameras, seen, sigma)
    assert 0 < found.min() < 0.5
    assert found == pytest.approx(both.sum(axis=(1, 2)) / either.sum(axis=(1, 2)), abs=1e-3)


def test_held_out_views_are_told_apart():
    iou = np.array([0.9, 0.1, 0.7, 0.3])
    expected = {"iou_mean": 0.8, "iou_min": 0.7, "iou_holdout": 0.2}
    assert summarise_iou(iou, [1, 3]) == pytest.approx(expected)
    assert summarise_iou(iou, [])["iou_holdout"] is None
    assert summarise_iou(iou, [])["iou_mean"] == pytest.approx(0.5)


def test_a_torn_truth_still_has_its_volume():
    """A hole, and a seam along which the vertices are not shared."""
    ball = trimesh.creation.icosphere(4)
    half = ball.triangles_center[:, 0] < 0
    parts = [trimesh.Trimesh(ball.vertices, ball.faces[part]) for part in (half, ~half)]
    torn = trimesh.util.concatenate(
        [parts[0], trimesh.Trimesh(parts[1].vertices, parts[1].faces[9:])]
    )
    assert not torn.is_watertight
    metrics = compare_to_truth(sphere(0.9), torn)
    assert metrics["volume_iou"] == pytest.approx(0.9**3, abs=0.02)


def test_a_mesh_turned_inside_out_has_its_volume():
    ball = trimesh.creation.icosphere(3)
    turned = ball.copy()
    turned.invert()
    assert compare_to_truth(turned, ball)["volume_iou"] == 1


def test_an_open_truth_has_no_volume():
    ball = trimesh.creation.icosphere(3)
    bowl = trimesh.Trimesh(ball.vertices, ball.faces[ball.triangles_center[:, 1] < 0])
    assert compare_to_truth(ball, bowl)["volume_iou"] is None
