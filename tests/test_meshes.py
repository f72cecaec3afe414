import numpy as np
import pytest
import torch
import trimesh

from silmesh.errors import InputError
from silmesh.meshes import read_mesh, refuse_flat, to_tensors, write_mesh
from silmesh.shapes.sphere import unit_sphere


@pytest.mark.parametrize("ending", ["ply", "obj", "glb"])
def test_a_mesh_is_read_as_it_was_written(tmp_path, ending):
    verts, faces = to_tensors(unit_sphere(100))
    path = tmp_path / f"mesh.{ending}"
    write_mesh([path], verts.double(), faces)
    read_verts, read_faces = to_tensors(read_mesh(path))
    assert (read_verts.dtype, read_faces.dtype) == (torch.float32, torch.int64)
    torch.testing.assert_close(read_verts, verts, rtol=0, atol=1e-6)
    assert torch.equal(read_faces, faces)
    assert list(tmp_path.iterdir()) == [path]


def test_equal_vertices_are_not_merged(tmp_path):
    verts = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]).repeat(2, 1)
    write_mesh([tmp_path / "mesh.ply"], verts, torch.tensor([[0, 1, 2], [5, 4, 3]]))
    assert len(read_mesh(tmp_path / "mesh.ply").vertices) == 6


@pytest.mark.parametrize("text", [None, "", "ply\nnonsense"])
def test_what_is_no_mesh_is_named(tmp_path, text):
    path = tmp_path / "truth.ply"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=r"truth\.ply: "):
        read_mesh(path)


def test_a_vertex_that_is_not_finite_is_refused(tmp_path):
    (tmp_path / "truth.obj").write_text("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match=r"truth\.obj: holds a vertex that is not finite"):
        read_mesh(tmp_path / "truth.obj")


def test_a_mesh_without_area_is_refused(tmp_path):
    flat = trimesh.Trimesh([[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 1, 2]], process=False)
    with pytest.raises(InputError, match=r"truth\.ply: its 1 triangles have no area"):
        refuse_flat(tmp_path / "truth.ply", flat)


def test_points_alone_are_no_mesh(tmp_path):
    trimesh.PointCloud(np.eye(3)).export(tmp_path / "points.ply")
    with pytest.raises(InputError, match=r"points\.ply: holds no triangle"):
        read_mesh(tmp_path / "points.ply")
