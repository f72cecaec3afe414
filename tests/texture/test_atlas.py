"""Meshes laid flat: what lies where, checked against the mesh itself."""

import numpy as np
import pytest
import trimesh

from silmesh.texture.atlas import find_texels, unwrap


@pytest.fixture(scope="module", params=["ball", "box", "fine"])
def mesh(request):
    return {
        "ball": trimesh.creation.icosphere(2, 0.4),
        "fine": trimesh.creation.icosphere(5, 0.4),  # more than are cut together
        "box": trimesh.creation.box((1, 0.7, 0.4)),
    }[request.param]


def test_vertices_are_split_and_faces_keep_their_order(mesh):
    atlas = unwrap(mesh.vertices, mesh.faces)
    assert (atlas.origin[atlas.faces] == mesh.faces).all()
    assert set(atlas.origin) == set(range(len(mesh.vertices)))
    assert atlas.uv.min() >= 0
    assert atlas.uv.max() <= 1
    assert atlas.charts >= 2


def test_texels_lie_where_their_triangle_does(mesh):
    atlas = unwrap(mesh.vertices, mesh.faces)
    texels = find_texels(atlas, 128)
    corners = atlas.in_texels(128)[atlas.faces[texels.faces]]
    at = np.einsum("nk,nkc->nc", texels.weights, corners)
    expected = np.stack([texels.at % 128, texels.at // 128], axis=1) + 0.5
    assert np.abs(at - expected).max() < 1e-3
    assert texels.weights.min() > -1e-5


def test_areas_are_kept_so_that_texels_are_of_one_size(mesh):
    atlas = unwrap(mesh.vertices, mesh.faces)
    texels = find_texels(atlas, 256)
    assert len(texels.at) > 0.4 * 256**2
    above = mesh.triangles_center[texels.faces] > 0
    for axis in range(3):  # both halves of the mesh have the texels that their areas are due
        area = mesh.area_faces[mesh.triangles_center[:, axis] > 0].sum() / mesh.area
        assert above[:, axis].mean() == pytest.approx(area, abs=0.06)
