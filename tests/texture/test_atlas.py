"""Meshes laid flat: what lies where, checked against the mesh itself."""

import numpy as np
import pytest
import trimesh

from silmesh.texture.atlas import find_texels, unwrap


@pytest.fixture(scope="module", params=["ball", "box"])
def mesh(request):
    return {
        "ball": trimesh.creation.icosphere(2, 0.4),
        "box": trimesh.creation.box((1, 0.7, 0.4)),
    }[request.param]


def test_vertices_are_split_and_faces_keep_their_order(mesh):
    atlas = unwrap(mesh.vertices, mesh.faces)
    assert (atlas.origin[atlas.faces] == mesh.faces).all()
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
    counts = np.bincount(texels.faces, minlength=len(mesh.faces))
    density = counts.sum() / mesh.area
    assert len(texels.at) > 0.4 * 256**2
    assert np.corrcoef(counts, mesh.area_faces * density)[0, 1] > 0.6 or len(mesh.faces) > 100
    assert np.abs(counts - mesh.area_faces * density).mean() < 0.35 * counts.mean()
