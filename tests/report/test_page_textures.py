"""A texture on the page: as large as there is room for, and of the mesh that bears it."""

import base64
import io

import numpy as np
import pytest
import trimesh
from pages import cameras, similarity, split_glb
from PIL import Image

from silmesh.geometry.textured_mesh import texture_mesh
from silmesh.report.exhibit import describe_exhibit
from silmesh.report.packing import encode_glb, pack, unpack
from silmesh.report.page_textures import SIDES, add_texture, encode_texture

FACES = np.array([[0, 1, 2]])


def noise(side: int) -> Image.Image:
    return Image.effect_noise((side, side), 60).convert("RGB")


def lay(side: int, room: float):
    """The tree of a mesh with a picture of noise, and the picture that it has, if any."""
    packed = pack(encode_glb(np.eye(3), FACES, np.eye(3), np.eye(3), np.eye(3)[:, :2]))
    tree, content = split_glb(unpack(add_texture(packed, encode_texture(noise(side)), room)))
    if "images" not in tree:
        return tree, None
    view = tree["bufferViews"][tree["images"][0]["bufferView"]]
    jpeg = content[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    return tree, Image.open(io.BytesIO(jpeg))


@pytest.mark.parametrize(("side", "room", "shown"), [(2048, 1e7, 1024), (512, 1e7, 512)])
def test_no_texture_is_larger_than_the_page_shows_any(side, room, shown):
    tree, picture = lay(side, room)
    assert picture.size == (shown, shown)
    assert tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] == {"index": 0}


def test_where_there_is_little_room_it_is_smaller_and_where_there_is_none_it_is_left_out():
    whole = len(encode_texture(noise(1024)))
    _, picture = lay(1024, whole / 3)
    assert picture.width in SIDES[1:]
    tree, picture = lay(1024, 1000)
    assert picture is None
    assert set(tree["meshes"][0]["primitives"][0]["attributes"]) >= {"COLOR_0", "TEXCOORD_0"}


def test_an_exhibit_has_the_texture_of_its_mesh_and_colours_for_where_it_has_no_room():
    mesh = trimesh.creation.box((0.5, 0.8, 0.4))
    split = mesh.faces.ravel()  # each face by itself
    uv = np.tile([[0, 0], [1, 0], [0, 1]], (len(mesh.faces), 1)).astype(float)
    image = np.full((8, 8, 3), (200, 100, 50), np.uint8)
    faces = np.arange(len(split)).reshape(-1, 3)
    textured = texture_mesh(mesh.vertices[split], faces, uv, image)
    colours = np.arange(24).reshape(8, 3) / 24
    told = describe_exhibit(mesh, colours, mesh, cameras(), similarity(), 1e-5, textured)
    with Image.open(io.BytesIO(base64.b64decode(told["texture"]))) as picture:
        assert np.abs(np.asarray(picture).astype(int) - image).max() <= 3
    tree, content = split_glb(unpack(told["fitted"]))
    at = tree["meshes"][0]["primitives"][0]["attributes"]
    view = tree["bufferViews"][at["COLOR_0"]]
    stored = np.frombuffer(content, "<u2", 4 * len(split), view["byteOffset"]).reshape(-1, 4)
    np.testing.assert_allclose(stored[:, :3] / 65535, colours[split], atol=1e-5)
    normals = np.frombuffer(
        content, "i1", 4 * len(split), tree["bufferViews"][at["NORMAL"]]["byteOffset"]
    )
    # At a box's corner the mean of its faces' normals, the same for all of them.
    assert len(np.unique(normals.reshape(-1, 4)[:, :3], axis=0)) == 8


def test_a_mesh_without_texture_has_none():
    mesh = trimesh.creation.box((0.5, 0.8, 0.4))
    told = describe_exhibit(mesh, np.ones((8, 3)), mesh, cameras(), similarity(), 1e-5)
    assert told["texture"] is None
    assert (
        "TEXCOORD_0"
        not in split_glb(unpack(told["fitted"]))[0]["meshes"][0]["primitives"][0]["attributes"]
    )
