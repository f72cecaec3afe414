"""A mesh of a person's own as the initial mesh: placed if it can be fitted, else refused."""

import numpy as np
import pytest
import trimesh
from scenes import turntable

from silmesh.errors import InputError
from silmesh.geometry.camera import INITIAL_SCALE
from silmesh.settings.init import Init
from silmesh.shapes.downsample import render
from silmesh.shapes.initial import make_initial_mesh
from silmesh.shapes.own_mesh import own_mesh, read_body
from silmesh.shapes.sphere import unit_sphere

SIZE = 96
CAMERAS = turntable(8, SIZE, elevation=25)
NONE = Init(align="none")


def wedge():
    """A solid without symmetry: an L, closed and in one piece."""
    outline = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 4], [0, 4]], float)
    mesh = trimesh.creation.extrude_triangulation(
        outline, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]), height=1.5
    )
    return mesh.subdivide().subdivide()


def shown(mesh):
    return render(mesh, CAMERAS, (SIZE, SIZE))


def write(folder, mesh, name="own.ply"):
    mesh.export(folder / name)
    return folder / name


def as_quads_with_seams(path):
    """An OBJ cube of quadrangles whose corners have several texture coordinates."""
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    quads = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", "mtllib missing.mtl"]
    lines += ["f " + " ".join(f"{v}/{i + 1}" for i, v in enumerate(quad)) for quad in quads]
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("align", ["none", "bbox"])
@pytest.mark.parametrize("vertices", [642, 1352, 1922])
def test_a_sphere_from_a_file_is_placed_as_the_reports_is(tmp_path, align, vertices):
    silhouettes = shown(trimesh.creation.icosphere(radius=0.3).apply_translation([0.1, 0.05, 0]))
    path = write(tmp_path, unit_sphere(vertices))
    asked = {"sphere": vertices, f"file:{path}": "auto"}
    ours, read = (
        make_initial_mesh(Init(shape=s, vertices=n, align=align), silhouettes, CAMERAS).mesh
        for s, n in asked.items()
    )
    assert len(read.faces) == len(ours.faces)
    order, other = (np.lexsort(m.vertices.round(4).T) for m in (ours, read))
    np.testing.assert_allclose(ours.vertices[order], read.vertices[other], atol=1e-4)


def test_a_mesh_is_moved_and_stretched_to_the_silhouettes(tmp_path):
    truth = wedge().apply_transform(np.diag([0.16, 0.2, 0.12, 1]))
    truth.apply_translation([0.06, -0.05, 0.03] - truth.bounds.mean(axis=0))
    found = own_mesh(write(tmp_path, wedge()), None, Init(align="bbox"), shown(truth), CAMERAS)
    assert np.abs(found.vertices / INITIAL_SCALE - truth.vertices).max() < 0.02


def test_a_count_of_vertices_remeshes_it(tmp_path):
    path = write(tmp_path, wedge().apply_scale(0.3))
    silhouettes = shown(wedge().apply_scale(0.15))
    assert len(own_mesh(path, 300, NONE, silhouettes, CAMERAS).vertices) == 300


def test_without_alignment_it_stays_as_it_lies(tmp_path):
    mesh = wedge().apply_scale(0.3)
    found = own_mesh(write(tmp_path, mesh), None, NONE, shown(mesh), CAMERAS)
    np.testing.assert_allclose(found.vertices, mesh.vertices, atol=1e-6)


@pytest.mark.parametrize("name", ["own.stl", "own.obj", "own.off", "own.glb"])
def test_formats_that_split_vertices_are_joined(tmp_path, name):
    mesh = read_body(write(tmp_path, wedge(), name))
    assert mesh.is_watertight
    assert len(mesh.vertices) == len(wedge().vertices)


def test_quadrangles_with_texture_seams_are_joined(tmp_path):
    mesh = read_body(as_quads_with_seams(tmp_path / "cube.obj"))
    assert (len(mesh.vertices), len(mesh.faces)) == (8, 12)
    assert mesh.volume == pytest.approx(8)


def opened():
    mesh = wedge()
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    return mesh


def flipped():
    mesh = wedge()
    mesh.faces[:5] = mesh.faces[:5, ::-1]
    return mesh


def inverted():
    mesh = wedge()
    mesh.invert()
    return mesh


def pair():
    return trimesh.util.concatenate(wedge(), wedge().apply_translation([9, 0, 0]))


def flat():
    mesh = unit_sphere(100)
    return trimesh.Trimesh(mesh.vertices * [1, 1e-9, 1], mesh.faces, process=False)


WRONG = {
    "is not closed: 3 of its": opened,
    "some of its faces look inwards": flipped,
    "is inside out": inverted,
    "comes in 2 pieces": pair,
    "no volume": flat,
}


@pytest.mark.parametrize("said", WRONG)
def test_what_cannot_be_fitted_is_refused(tmp_path, said):
    path = write(tmp_path, WRONG[said]())
    with pytest.raises(InputError, match=said) as error:
        read_body(path)
    assert str(path) in str(error.value)


def test_not_a_number_is_refused(tmp_path):
    mesh = wedge()
    mesh.vertices[3] = np.nan
    with pytest.raises(InputError, match="not finite"):
        read_body(write(tmp_path, mesh))


def test_a_template_beyond_the_parametrisation_is_refused(tmp_path):
    path = write(tmp_path, wedge())
    with pytest.raises(InputError, match=r"reaches 4 from the origin.*below 2"):
        own_mesh(path, None, NONE, shown(wedge().apply_scale(0.1)), CAMERAS)
