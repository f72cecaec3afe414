"""A texture's colours lie where they belong in what other readers read, and no file is lost."""

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual.color import uv_to_interpolated_color

from silmesh.errors import InputError
from silmesh.geometry.obj_companions import copy_obj, name_companions, try_companions
from silmesh.geometry.textured_mesh import (
    encode_png,
    read_textured,
    texture_mesh,
    write_textured_glb,
    write_textured_obj,
)

SIDE = 256


def colours_at(points: np.ndarray) -> np.ndarray:
    """What the sheets below are painted with, by where a point lies: [n, 3] of 0 to 255."""
    x, y, _ = points.T
    return np.stack([40 + 90 * x, 40 + 150 * y, 200 - 80 * x], axis=1)


def painted() -> trimesh.Trimesh:
    """Two squares that meet at x = 1 and are bent there, each a chart, the second lying turned.

      y                    v
    1 +---+---+          1 +---+---+
      | A | B |            | A |   |    B is turned by 90 degrees
    0 +---+---+            +---+---+
      0   1   2 x          |   | B |
                         0 +---+---+ u
    """
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    first = np.column_stack([corners, np.zeros(4)])
    second = np.column_stack([corners + np.array([1, 0]), 0.5 * corners[:, 0]])
    turned = np.column_stack([1 - corners[:, 1], corners[:, 0]])  # (1 + x, y) lies at (1 - y, x)
    uv = np.concatenate([0.5 * corners + [0, 0.5], 0.5 * turned + [0.5, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    return texture_mesh(np.concatenate([first, second]), faces, uv, paint())


def paint() -> np.ndarray:
    """The picture: what each texel shows is found from where it lies."""
    row, column = np.mgrid[:SIDE, :SIDE] + 0.5
    u, v = column / SIDE, 1 - row / SIDE
    upper = np.stack([2 * u, 2 * v - 1, 0 * u], axis=-1)
    lower = np.stack([1 + 2 * v, 1 - (2 * u - 1), 0 * u], axis=-1)
    points = np.where((u < 0.5)[..., None], upper, lower).reshape(-1, 3)
    return colours_at(points).round().clip(0, 255).astype(np.uint8).reshape(SIDE, SIDE, 3)


def assert_painted(mesh: trimesh.Trimesh, picture: Image.Image) -> None:
    """Sample a mesh by its reader's own rules, away from the borders of the charts."""
    rng = np.random.default_rng(3)
    shares = 0.9 * rng.dirichlet([1, 1, 1], 200) + 0.1 / 3
    face = rng.integers(len(mesh.faces), size=200)
    points = np.einsum("nk,nkc->nc", shares, mesh.triangles[face])
    uv = np.einsum("nk,nkc->nc", shares, np.asarray(mesh.visual.uv)[mesh.faces[face]])
    found = uv_to_interpolated_color(uv, picture)[:, :3].astype(float)
    np.testing.assert_allclose(found, colours_at(points), atol=2.5)


def write_obj(path, mesh: trimesh.Trimesh) -> None:
    write_textured_obj(path, mesh, encode_png(mesh), *name_companions(path))


def test_another_reader_of_glb_finds_the_colours_where_they_belong(tmp_path):
    mesh = painted()
    write_textured_glb(tmp_path / "m.glb", mesh, encode_png(mesh))
    read = trimesh.load_mesh(tmp_path / "m.glb", process=False)
    material = read.visual.material
    assert (material.metallicFactor, material.roughnessFactor) == (0, 1)
    assert_painted(read, material.baseColorTexture)


@pytest.mark.parametrize("name", ["m.obj", "my own cup.obj", "Töpfe.OBJ"])
def test_another_reader_of_obj_finds_the_colours_where_they_belong(tmp_path, name):
    write_obj(tmp_path / name, painted())
    read = trimesh.load_mesh(tmp_path / name, process=False)
    assert_painted(read, read.visual.material.image)
    assert sorted(path.suffix.lower() for path in tmp_path.iterdir()) == [".mtl", ".obj", ".png"]


def test_what_is_read_back_is_what_was_written(tmp_path):
    mesh = painted()
    write_textured_glb(tmp_path / "m.glb", mesh, encode_png(mesh))
    read = read_textured(tmp_path / "m.glb", 128)
    np.testing.assert_allclose(read.vertices, mesh.vertices, atol=1e-6)
    np.testing.assert_allclose(read.vertex_normals, mesh.vertex_normals, atol=1e-6)
    assert read.visual.material.baseColorTexture.size == (128, 128)
    assert_painted(read, read.visual.material.baseColorTexture)


def test_vertices_of_one_place_are_one_in_obj_and_have_one_normal(tmp_path):
    mesh = painted()
    write_obj(tmp_path / "m.obj", mesh)
    lines = (tmp_path / "m.obj").read_text().splitlines()
    kinds = [line.split()[0] for line in lines]
    assert [kinds.count(kind) for kind in ("v", "vt", "vn", "f")] == [6, 8, 6, 4]
    # At the fold, between normals (0, 0, 1) and (-0.5, 0, 1) of length 1.
    np.testing.assert_array_equal(mesh.vertex_normals[1], mesh.vertex_normals[4])
    assert -0.4 < mesh.vertex_normals[1][0] < -0.05
    # Of the last face the first corner, vertex 4, lies where vertex 1 does, the second of all.
    assert lines[-1].split()[1] == "2/5/2"


def test_a_copy_names_its_own_files_and_is_written_over_its_like(tmp_path):
    write_obj(tmp_path / "mesh.obj", painted())
    copy = tmp_path / "out" / "chair.obj"
    for _ in range(2):
        copy_obj(tmp_path / "mesh.obj", copy)
    assert "mtllib chair.mtl\n" in copy.read_text()
    assert copy.with_suffix(".mtl").read_text().endswith("map_Kd chair.png\n")
    read = trimesh.load_mesh(copy, process=False)
    assert_painted(read, read.visual.material.image)


@pytest.mark.parametrize("suffix", [".png", ".mtl"])
def test_a_persons_own_file_is_not_written_over(tmp_path, suffix):
    own = tmp_path / f"chair{suffix}"
    if suffix == ".png":
        Image.new("RGB", (4, 4)).save(own)
    else:
        own.write_text("newmtl mine\n")
    before = own.read_bytes()
    with pytest.raises(InputError, match=f"chair{suffix}: is there already and not made by silm"):
        try_companions(tmp_path / "chair.obj")
    assert own.read_bytes() == before


@pytest.mark.parametrize("suffix", [".png", ".mtl"])
def test_a_link_to_nothing_is_a_persons_own(tmp_path, suffix):
    (tmp_path / f"chair{suffix}").symlink_to("elsewhere")
    with pytest.raises(InputError, match="is there already and not made by silmesh"):
        try_companions(tmp_path / "chair.obj")


def test_the_same_mesh_is_the_same_bytes(tmp_path):
    assert encode_png(painted()) == encode_png(painted())
    for name in ("a", "b"):
        write_textured_glb(tmp_path / f"{name}.glb", painted(), encode_png(painted()))
    assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()


def test_a_picture_says_that_it_is_srgb(tmp_path):
    (tmp_path / "m.png").write_bytes(encode_png(painted()))
    with Image.open(tmp_path / "m.png") as picture:
        assert "srgb" in picture.info
        assert (np.asarray(picture) == paint()).all()
