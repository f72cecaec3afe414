"""Made-up objects whose hollows are known: what silhouettes cannot show, photographs can."""

from pathlib import Path

import igl
import numpy as np
import pytest
import torch
import trimesh
from PIL import Image
from skimage.measure import marching_cubes

from silmesh.geometry.camera import Cameras
from silmesh.geometry.originals import Originals
from silmesh.geometry.visual_hull import carve
from silmesh.relief.depths import cast_rays, find_neighbours, sweep
from silmesh.relief.refinement import Relief, _refuse, refine
from silmesh.relief.sights import look
from silmesh.relief.surface import PHOTOGRAPHS, simplify
from silmesh.shapes.downsample import render
from silmesh.synthetic.orbit import photograph_cameras
from silmesh.synthetic.paints import coat, rgb, speckle
from silmesh.synthetic.photograph import Paint, photograph
from silmesh.views import View

SIZE, WORKING = 192, 96
RADIUS, HOLLOW, CENTRE = 0.42, 0.26, np.array([0, 0.3, 0.1])
FLOOR = CENTRE - [0, HOLLOW, 0]  # the hollow's lowest point


def patterned(points: np.ndarray) -> np.ndarray:
    value = 0.5 + 0.2 * speckle(points, 0.06, 3) + 0.25 * speckle(points, 0.03, 4)
    return np.column_stack([value, 0.9 * value, 0.8 * value, 0.1 + 0 * value]).astype(np.float32)


def plain(points: np.ndarray) -> np.ndarray:
    return coat(points, rgb("b0a090"), 0.05)


def glossy(points: np.ndarray) -> np.ndarray:
    return coat(points, rgb("803030"), 1.0)


def hollow_ball() -> trimesh.Trimesh:
    """A ball out of whose top a smaller one is cut."""
    grid = np.linspace(-0.5, 0.5, 81)
    points = np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1)
    ball = np.linalg.norm(points, axis=-1) - RADIUS
    cut = HOLLOW - np.linalg.norm(points - CENTRE, axis=-1)
    spacing = (grid[1] - grid[0],) * 3
    verts, faces, _, _ = marching_cubes(
        np.maximum(ball, cut), 0, spacing=spacing, gradient_direction="ascent"
    )
    mesh = trimesh.Trimesh(verts - 0.5, faces, process=False)
    mesh.fix_normals()
    return mesh


def stand_about(size: int) -> Cameras:
    """Two rings of 16 cameras, of which one looks into the hollow."""
    rings = [
        photograph_cameras([f"{up}-{i:02d}" for i in range(16)], (size, size), elevation=up)
        for up in (10, 55)
    ]
    views = sum((ring.views for ring in rings), ())
    return Cameras(
        *(views, *(torch.cat([getattr(r, k) for r in rings]) for k in ["sizes", "K", "R", "t"]))
    )


class Scene:
    """A hollow ball's photographs, its silhouettes and its hull."""

    def __init__(self, folder: Path, paint: Paint):
        self.truth, cameras = hollow_ball(), stand_about(SIZE)
        self.cameras, masks, views = stand_about(WORKING), [], []
        shots = photograph(self.truth, cameras, paint, seed=7)
        for name, (image, mask) in zip(cameras.views, shots, strict=True):
            path = folder / f"{name}.png"
            Image.fromarray(image).save(path)
            frame = (WORKING, 0, 0, WORKING, WORKING)
            views.append(View(name, str(path), SIZE, SIZE, *frame))
            masks.append(mask.reshape(WORKING, 2, WORKING, 2).mean(axis=(1, 3)) >= 0.5)
        self.silhouettes = np.stack(masks)
        self.originals = Originals(self.cameras, views)
        hull = trimesh.Trimesh(*carve(self.silhouettes, self.cameras, 64).surface(), process=False)
        self.hull = simplify(hull, 3000)

    def refine(self) -> Relief:
        return refine(self.hull, self.originals, self.silhouettes, self.cameras)


@pytest.fixture(scope="module")
def textured(tmp_path_factory) -> Scene:
    return Scene(tmp_path_factory.mktemp("textured"), patterned)


@pytest.fixture(scope="module")
def refined(textured) -> Relief:
    return textured.refine()


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
    found = sweep(sights, cast_rays(scene.hull, sights), find_neighbours(sights), 4, seed=0)
    true = cast_rays(scene.truth, sights).front
    hidden = (true - cast_rays(scene.hull, sights).front > 0.05) & (found.depth > 0)
    off = np.abs(found.depth - true)[hidden]
    assert hidden.sum() > 10_000
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
    again = textured.refine()
    assert np.array_equal(again.verts, refined.verts)
    assert np.array_equal(again.faces, refined.faces)


@pytest.mark.slow
@pytest.mark.parametrize("paint", [plain, glossy])
def test_without_texture_the_surface_stays_as_it_is(tmp_path, paint):
    scene = Scene(tmp_path, paint)
    relief = scene.refine()
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
