"""Made-up objects whose hollows are known: what silhouettes cannot show, photographs can."""

import igl
import numpy as np
import pytest
import trimesh
from hollow_balls import CENTRE, FLOOR, HOLLOW, HollowBall, glossy, patterned, plain

from silmesh.relief.depths import cast_rays, find_neighbours, sweep
from silmesh.relief.refinement import Relief, _choose_resolution, _refuse, refine
from silmesh.relief.sights import look
from silmesh.relief.surface import PHOTOGRAPHS
from silmesh.shapes.downsample import render


def refine_hull(scene: HollowBall) -> Relief:
    return refine(scene.hull, scene.originals, scene.silhouettes, scene.cameras)


@pytest.fixture(scope="module")
def textured(tmp_path_factory) -> HollowBall:
    return HollowBall(tmp_path_factory.mktemp("textured"), patterned)


@pytest.fixture(scope="module")
def refined(textured) -> Relief:
    return refine_hull(textured)


def stray(mesh: trimesh.Trimesh, truth: trimesh.Trimesh) -> float:
    """Mean distance from points of each surface to the other."""
    points = [trimesh.sample.sample_surface(m, 3000, seed=0)[0] for m in (mesh, truth)]
    return (far_from(truth, points[0]).mean() + far_from(mesh, points[1]).mean()) / 2


def far_from(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    faces = np.int64(mesh.faces)
    return np.sqrt(igl.point_mesh_squared_distance(points, np.float64(mesh.vertices), faces)[0])


def test_depths_of_a_hollow_are_the_truth(textured):
    scene = textured
    views = list(range(len(scene.cameras)))
    sights = look(scene.originals, scene.silhouettes, scene.cameras, views, 400)
    some = views[::4]
    found = sweep(sights, cast_rays(scene.hull, sights), find_neighbours(sights), 4, 0, only=some)
    true = cast_rays(scene.truth, sights).front
    hidden = (true - cast_rays(scene.hull, sights).front > 0.05) & (found.depth > 0)
    off = np.abs(found.depth - true)[hidden]
    assert hidden.sum() > 2_500
    assert np.median(off) < 0.006  # of a size of 0.84: less than one pixel
    assert np.mean(off < 0.02) > 0.85


def test_a_hollow_opens_to_its_floor(textured, refined):
    mesh = trimesh.Trimesh(refined.verts, refined.faces, process=False)
    assert refined.changed
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(textured.truth.volume, rel=0.04)
    assert far_from(mesh, FLOOR[None])[0] < 0.01
    assert stray(mesh, textured.truth) < 0.5 * stray(textured.hull, textured.truth)


def test_silhouettes_stay_as_they_are(textured, refined):
    shape = textured.silhouettes.shape[1:]
    mesh = trimesh.Trimesh(refined.verts, refined.faces, process=False)
    before, after = (render(m, textured.cameras, shape) for m in (textured.hull, mesh))
    ious = [
        (s & textured.silhouettes).sum() / (s | textured.silhouettes).sum() for s in (before, after)
    ]
    assert ious[1] > ious[0] - 0.003


def test_the_hollow_stands_on_photographs(refined):
    inside = np.linalg.norm(refined.verts - CENTRE, axis=1) < HOLLOW + 0.02
    assert np.mean(refined.standing[inside] == PHOTOGRAPHS) > 0.9
    assert refined.notes["photographs"] == pytest.approx(
        np.mean(refined.standing == PHOTOGRAPHS), abs=1e-4
    )


@pytest.mark.slow
def test_the_same_seed_gives_the_same_surface(textured, refined):
    again = refine_hull(textured)
    assert np.array_equal(again.verts, refined.verts)
    assert np.array_equal(again.faces, refined.faces)


@pytest.mark.slow
@pytest.mark.parametrize("paint", [plain, glossy])
def test_without_texture_the_surface_stays_as_it_is(tmp_path, paint):
    scene = HollowBall(tmp_path, paint)
    relief = refine_hull(scene)
    if relief.changed:  # what shading shows may be used, where it helps
        mesh = trimesh.Trimesh(relief.verts, relief.faces, process=False)
        assert stray(mesh, scene.truth) < 1.01 * stray(scene.hull, scene.truth)
    else:
        assert np.array_equal(relief.verts, scene.hull.vertices)
        assert np.array_equal(relief.faces, scene.hull.faces)
        assert "photographs agree on" in relief.notes["reason"]
        assert not (relief.standing == PHOTOGRAPHS).any()


def test_what_is_thinner_than_the_grid_stays_as_it_is(textured):
    leaf = trimesh.creation.box((0.6, 0.6, 1e-4))
    scene = textured
    relief = refine(leaf, scene.originals, scene.silhouettes, scene.cameras, kept=range(0, 32, 4))
    assert not relief.changed
    assert np.array_equal(relief.verts, leaf.vertices)


@pytest.mark.parametrize(
    ("share", "of_textured", "refused"),
    [(0.02, 0.9, True), (0.05, 0.2, True), (0.05, 0.4, False), (0.2, 0.2, False)],
)
def test_few_depths_are_gloss_but_many_are_left_to_the_judge(share, of_textured, refused):
    assert bool(_refuse(share, of_textured)) == refused


@pytest.mark.parametrize(
    ("extents", "along"), [((1, 1, 1), 144), ((1.5, 1, 1), 189), ((1, 1, 0.01), 224)]
)
def test_slim_and_flat_objects_have_finer_voxels(extents, along):
    """As many as of a cube: 144^3 of 1.5 x 1 x 1 are 189 x 126 x 126."""
    assert _choose_resolution(trimesh.creation.box(extents)) == along
