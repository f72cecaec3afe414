"""The voxel grid of the papers: hand-computed boxes, and their formulas beside ours."""

import numpy as np
import pytest
import trimesh
from support.shapenet import BOXES, fill, render, write_class

from silmesh.cameras.turntable import turntable_cameras
from silmesh.evaluation.ground_truth import compare_to_truth
from silmesh.geometry.mesh_files import read_mesh, to_tensors
from silmesh.geometry.silhouette_iou import silhouette_iou
from silmesh.geometry.voxels import mesh_voxels, voxel_iou, voxelise
from silmesh.reading import read_voxels
from silmesh.steps import truth

OURS = np.array([1.0, 1.0, -1.0])  # from SoftRas's left-handed world


def true_mesh() -> trimesh.Trimesh:
    """The made-up object of ``support.shapenet`` in our world."""
    ours = [np.sort(np.array(box) * OURS, axis=0) for box in BOXES]
    return trimesh.util.concatenate([trimesh.creation.box(bounds=box) for box in ours])


@pytest.mark.parametrize("divided", [0, 2])
def test_a_box_fills_the_voxels_that_it_enters(divided):
    # x: 31 (-0.2) + 16 = 9.8 to 31 (0.3) + 16 = 25.3, and so on; the order is y, x, z.
    box = trimesh.creation.box(bounds=[(-0.2, -0.1, 0.05), (0.3, 0.25, 0.4)])
    for _ in range(divided):
        box = box.subdivide()
    expected = np.zeros((32, 32, 32), bool)
    expected[12:24, 9:26, 17:29] = True
    np.testing.assert_array_equal(voxelise(box), expected)


def test_what_is_enclosed_is_full_and_what_lies_outside_is_left_out():
    ball = trimesh.creation.icosphere(4, 0.4)
    full = voxelise(ball)
    middles = (np.indices((32, 32, 32)).transpose(1, 2, 3, 0) + 0.5 - 16) / 31
    assert full[np.linalg.norm(middles, axis=-1) < 0.4].all()
    assert not full[np.linalg.norm(middles, axis=-1) > 0.4 + 0.5 * np.sqrt(3) / 31].any()
    assert not voxelise(ball.apply_translation([3, 0, 0])).any()


def test_half_of_the_voxels_in_common():
    low = trimesh.creation.box(bounds=[(-0.2, -0.2, -0.2), (0.2, 0.2, 0.2)])  # 14 voxels,
    high = low.copy().apply_translation([0, 6 / 31, 0])  # from 9.8 to 22.2: 8 in common
    assert voxel_iou(low, voxelise(high)) == pytest.approx(8 / 20)


def test_the_true_object_has_the_true_voxels_by_the_formula_of_the_papers():
    assert voxel_iou(true_mesh(), fill(np.array(BOXES)).astype(bool)) == 1.0
    mirrored = true_mesh()
    mirrored.vertices *= OURS
    assert voxel_iou(mirrored, fill(np.array(BOXES)).astype(bool)) < 0.6


def test_the_true_object_has_the_outlines_of_softrass_cameras():
    images = np.stack([render(np.array(BOXES), view) for view in range(24)])
    cameras = turntable_cameras([f"{i:04d}" for i in range(24)], 64, 2.732, 30, -15)
    iou = silhouette_iou(*to_tensors(true_mesh()), cameras, images[:, 3] > 127, 1e-5)
    assert iou.min() > 0.97


def test_the_mesh_of_voxels_is_closed_and_as_large_as_they_are():
    full = fill(np.array(BOXES)).astype(bool)
    mesh = mesh_voxels(full)
    assert mesh.is_watertight
    assert mesh.volume * 31**3 == pytest.approx(full.sum(), rel=0.05)
    points = (np.argwhere(full)[::7] + 0.5 - 16) / 31
    assert mesh.contains(points[:, [1, 0, 2]]).all()


def test_the_truth_of_an_archive_and_its_metrics(tmp_path):
    write_class(tmp_path, "02691156", (0.7, 1.0))
    path = tmp_path / "02691156_test_voxels.npz#1"
    truth.main(["--mesh", str(path), "--output", str(tmp_path / "truth.ply")])
    mesh = read_mesh(tmp_path / "truth.ply")
    found = compare_to_truth(true_mesh(), mesh, read_voxels(path))
    assert found["voxel_iou"] == 1.0
    assert found["chamfer"] < 1 / 31  # half a voxel all round
    assert "voxel_iou" not in compare_to_truth(mesh, mesh)
