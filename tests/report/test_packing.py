"""Packed data comes back, and the small glTF is what another reader of glTF reads."""

import numpy as np
import pytest
import trimesh
from pages import read_glb, split_glb

from silmesh.report.packing import encode_glb, pack, pack_json, unpack


def test_what_is_packed_comes_back_and_is_the_same_each_time():
    content = bytes(range(256)) * 40
    assert unpack(pack(content)) == content
    assert pack(content) == pack(content)
    assert len(pack(content)) < len(content) / 4
    assert unpack(pack_json({"a": [1, "é"]})) == b'{"a":[1,"\\u00e9"]}'


def test_another_reader_finds_the_mesh_where_it_was():
    mesh = trimesh.creation.icosphere(2, 0.3)
    verts = mesh.vertices * [1, 2, 0.5] + [5, -3, 0.25]
    read = read_glb(encode_glb(verts, mesh.faces))
    np.testing.assert_array_equal(read.faces, mesh.faces)
    np.testing.assert_allclose(read.vertices, verts, atol=1.2 / 65535)


def test_colours_are_kept_to_sixteen_bits():
    mesh = trimesh.creation.box()
    colours = np.linspace(0, 1, 24).reshape(8, 3)
    tree, content = split_glb(encode_glb(mesh.vertices, mesh.faces, colours))
    view = tree["bufferViews"][tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]
    start = view["byteOffset"]
    stored = np.frombuffer(content[start : start + view["byteLength"]], "<u2").reshape(8, 4)
    np.testing.assert_allclose(stored[:, :3] / 65535, colours, atol=0.6 / 65535)
    assert (stored[:, 3] == 65535).all()


@pytest.mark.parametrize("count", [65535, 65537])
def test_many_vertices_take_wider_indices(count):
    verts = np.random.default_rng(0).uniform(size=(count, 3))
    faces = np.array([[0, 1, count - 1]])
    read = read_glb(encode_glb(verts, faces))
    np.testing.assert_allclose(read.triangles[0], verts[faces[0]], atol=1.2 / 65535)


def test_parts_begin_at_multiples_of_four():
    tree, content = split_glb(encode_glb(np.eye(3), np.array([[0, 1, 2]])))
    assert all(view["byteOffset"] % 4 == 0 for view in tree["bufferViews"])
    assert tree["buffers"][0]["byteLength"] == len(content)
