import json
import struct

import numpy as np
import pytest
import torch
import trimesh

from silmesh.errors import InputError
from silmesh.geometry.mesh_files import (
    read_mesh,
    refuse_flat,
    to_tensors,
    write_coloured,
    write_mesh,
)
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


def test_a_glb_of_triangles_without_vertices_is_refused(tmp_path):
    raw = trimesh.creation.box().export(file_type="glb")
    length = int.from_bytes(raw[12:16], "little")
    tree = json.loads(raw[20 : 20 + length])
    place = tree["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    tree["accessors"][place]["count"] = 0
    changed = json.dumps(tree, separators=(",", ":")).encode().ljust(length)
    assert len(changed) == length
    (tmp_path / "truth.glb").write_bytes(raw[:20] + changed + raw[20 + length :])
    with pytest.raises(InputError, match=r"truth\.glb: "):
        read_mesh(tmp_path / "truth.glb")


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


PLY = """ply
format ascii 1.0
element vertex 3
property double x
property double y
property double z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
{far} 0 0
0 1 0
3 0 1 {last}
"""


@pytest.mark.parametrize(
    ("far", "last", "message"),
    [
        ("1", "3", "holds a face of vertex 3; should be 0 to 2"),
        ("1", "-1", "holds a face of vertex -1; should be 0 to 2"),
        ("1e300", "2", r"holds a vertex at 1e\+300; coordinates should be at most 1e\+12"),
        ("nan", "2", "holds a vertex that is not finite"),
    ],
)
def test_numbers_that_no_mesh_has_are_refused(tmp_path, far, last, message):
    (tmp_path / "a.ply").write_text(PLY.format(far="1", last="2"))
    assert len(read_mesh(tmp_path / "a.ply").faces) == 1
    (tmp_path / "a.ply").write_text(PLY.format(far=far, last=last))
    with pytest.raises(InputError, match=rf"a\.ply: {message}"):
        read_mesh(tmp_path / "a.ply")


@pytest.mark.parametrize("name", ["a.ply", "a.off"])
def test_counts_that_lie_take_no_memory(tmp_path, name):
    binary = PLY.partition("end_header")[0].replace("ascii", "binary_little_endian")
    counts = {"a.ply": binary.replace("vertex 3", "vertex 2000000000") + "end_header\n", "a.off": (
        "OFF\n1000000000 1000000000 0\n0 0 0\n")}  # fmt: skip
    (tmp_path / name).write_text(counts[name])
    with pytest.raises(InputError, match=f"{name}: cannot be read as a mesh"):
        read_mesh(tmp_path / name)


def test_a_scene_of_too_many_nodes_is_refused(tmp_path):
    """Each of 200,000 may show the same mesh again."""
    text = json.dumps({"nodes": [{"mesh": 0}] * 200_000}).encode()
    head = struct.pack("<4s4I", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A)
    (tmp_path / "a.glb").write_bytes(head + text)
    with pytest.raises(InputError, match=r"it has 200,000 nodes; should have at most 2,000"):
        read_mesh(tmp_path / "a.glb")


def test_vertices_of_one_number_each_are_refused(tmp_path):
    (tmp_path / "a.obj").write_text("v 1\nv 2\nv 3\nf 1 2 3\n")
    with pytest.raises(InputError, match=r"a\.obj: (holds vertices of 1 coord|cannot be read)"):
        read_mesh(tmp_path / "a.obj")


@pytest.mark.parametrize("name", ["a.3mf", "a.dae", "a.gltf", "a.zip", "a"])
def test_other_formats_are_not_tried(tmp_path, name):
    (tmp_path / name).touch()
    with pytest.raises(InputError, match=r"as a mesh: should end in \.ply, \.obj, \.glb, \.stl"):
        read_mesh(tmp_path / name)


def test_no_other_file_is_read(tmp_path):
    """A GLB that names another file as its buffer, an OBJ that names its materials."""
    (tmp_path / "secret.bin").write_bytes(np.eye(3, dtype=np.float32).tobytes())
    content = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "secret.bin", "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4s4I", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A)
    (tmp_path / "a.glb").write_bytes(head + text)
    with pytest.raises(InputError, match=r"a\.glb: cannot be read as a mesh"):
        read_mesh(tmp_path / "a.glb")
    (tmp_path / "a.obj").write_text("mtllib secret.bin\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert read_mesh(tmp_path / "a.obj").faces.tolist() == [[0, 1, 2]]
