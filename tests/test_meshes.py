import json

import numpy as np
import pytest
import torch
import trimesh

from silmesh.errors import InputError
from silmesh.meshes import read_mesh, refuse_flat, to_tensors, write_coloured, write_mesh
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


def test_a_glb_has_linear_colours_and_no_metal(tmp_path):
    mesh = trimesh.creation.box()
    colours = np.tile(np.array([[188, 0, 255]], np.uint8), (8, 1))
    write_coloured([tmp_path / "m.glb", tmp_path / "m.obj"], mesh, colours)
    raw = (tmp_path / "m.glb").read_bytes()
    length = int.from_bytes(raw[12:16], "little")
    tree = json.loads(raw[20 : 20 + length])
    primitive = tree["meshes"][0]["primitives"][0]
    accessor = tree["accessors"][primitive["attributes"]["COLOR_0"]]
    assert (accessor["componentType"], accessor["type"], accessor["count"]) == (5126, "VEC4", 8)
    start = 20 + length + 8 + tree["bufferViews"][accessor["bufferView"]].get("byteOffset", 0)
    values = np.frombuffer(raw[start : start + 8 * 16], "<f4").reshape(8, 4)
    np.testing.assert_allclose(values, [[0.5029, 0, 1, 1]] * 8, atol=1e-4)  # 188 of 255 is half
    surface = tree["materials"][primitive["material"]]["pbrMetallicRoughness"]
    assert (surface["metallicFactor"], surface["roughnessFactor"]) == (0, 1)
    assert not any(key.startswith("_") for key in primitive["attributes"])
    assert len(read_mesh(tmp_path / "m.glb").vertices) == 8


def test_an_obj_has_its_colours_as_they_are(tmp_path):
    colours = np.arange(24, dtype=np.uint8).reshape(8, 3)
    write_coloured([tmp_path / "m.obj"], trimesh.creation.box(), colours)
    rows = [line.split() for line in (tmp_path / "m.obj").read_text().splitlines()]
    found = np.array([row[4:7] for row in rows if row and row[0] == "v"], float)
    np.testing.assert_allclose(found * 255, colours, atol=0.01)
