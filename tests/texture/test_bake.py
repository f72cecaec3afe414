"""Textures of a ball whose paint is a formula, from photographs that rays have drawn."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from balls import GROUND, RADIUS, draw, meet
from PIL import Image
from scenes import dome
from scipy.spatial.transform import Rotation

from silmesh.geometry.originals import Originals
from silmesh.texture.atlas import Atlas, find_texels
from silmesh.texture.bake import bake
from silmesh.texture.rendering import render, render_vertex_colours
from silmesh.texture.vertex_colours import colour_vertices
from silmesh.views import place_view

WORKING, LARGE, VIEWS = 64, 256, 14
MESH = trimesh.creation.icosphere(3, RADIUS)


def paint(points):
    """Broad colours with fine waves upon them: [n, 3] of 0 to 255."""
    x, y, z = (points / RADIUS).T
    fine = 30 * np.sin(17 * x + 3 * y) * np.sin(19 * z - 2 * x) + 25 * np.sin(15 * y + 4 * z)
    return np.stack([130 + 50 * x, 130 + 50 * y, 130 + 50 * z], axis=1) + fine[:, None]


class Ball:
    """Photographs of the ball in a folder, which a test may spoil."""

    def __init__(self, folder, views=VIEWS):
        self.cameras, large = dome(views, WORKING), dome(views, LARGE)
        self.files = [folder / f"{name}.png" for name in self.cameras.views]
        for i, file in enumerate(self.files):
            Image.fromarray(draw(large, i, paint)).save(file)
        self.silhouettes = np.stack([meet(self.cameras, i)[0] for i in range(views)])

    def originals(self, cameras=None):
        views = [
            place_view(name, str(file), LARGE, LARGE, WORKING, "pad")
            for name, file in zip(self.cameras.views, self.files, strict=True)
        ]
        return Originals(cameras or self.cameras, views)

    def change(self, i, how):
        image = np.asarray(Image.open(self.files[i])).astype(float)
        Image.fromarray(how(image).round().clip(0, 255).astype(np.uint8)).save(self.files[i])

    def bake(self, cameras=None, **options):
        return bake(MESH, self.originals(cameras), self.silhouettes, **options)


@pytest.fixture
def ball(tmp_path):
    return Ball(tmp_path)


def errors(texture, seen=True):
    """Mean difference of the channels to the paint at each texel on the mesh."""
    side = len(texture.image)
    atlas = Atlas(texture.origin, texture.faces, texture.uv, 0)
    texels = find_texels(atlas, side)
    corners = texture.verts[texture.faces[texels.faces]]
    points = np.einsum("nk,nkc->nc", texels.weights, corners)
    points *= RADIUS / np.linalg.norm(points, axis=1, keepdims=True)
    chosen = texture.seen.ravel()[texels.at] == seen
    found = texture.image.reshape(-1, 3)[texels.at].astype(float)
    return np.abs(found - paint(points)).mean(axis=1)[chosen]


def test_the_paint_is_found_again_texel_by_texel(ball):
    texture = ball.bake()
    assert (texture.verts == MESH.vertices[texture.origin]).all()
    assert (texture.origin[texture.faces] == MESH.faces).all()
    error = errors(texture)
    assert len(error) > 10_000
    assert error.mean() < 5
    assert np.quantile(error, 0.95) < 14
    assert texture.notes["views"] == VIEWS


def test_large_photographs_are_first_glanced_at_in_small_ones(ball, monkeypatch):
    """Lengths are kept in pixels of the large ones, whose detail ends up in the texture."""
    whole = ball.bake()
    monkeypatch.setattr("silmesh.texture.bake.GLANCE", 150)
    texture = ball.bake()
    assert errors(texture).mean() < 1.25 * errors(whole).mean()
    assert texture.notes["unseen"] == pytest.approx(whole.notes["unseen"], abs=0.01)
    assert len(texture.image) == len(whole.image)


def test_a_view_that_was_kept_out_is_shown_far_better_than_by_colours_of_vertices(ball):
    kept = [i for i in range(VIEWS) if i != 5]
    originals = ball.originals()
    pictures = np.stack(
        [np.asarray(Image.fromarray(originals.read(i)).resize((WORKING, WORKING))) for i in kept]
    )
    colours = colour_vertices(
        MESH.vertices, MESH.faces, ball.cameras.select(kept), pictures, ball.silhouettes[kept]
    )
    camera, photograph = originals.cameras.select([5]), originals.read(5).astype(float)
    texture = ball.bake(kept=kept)
    ((textured, covered),) = render(texture, camera)
    ((plain, _),) = render_vertex_colours(MESH.vertices, MESH.faces, colours, camera)
    squares = [((a - photograph)[covered] ** 2).mean() for a in (plain, textured)]
    assert 10 * np.log10(squares[0] / squares[1]) > 6


def test_what_no_view_sees_is_marked_and_filled(ball):
    texture = ball.bake(kept=[3])
    assert 0.5 < texture.notes["unseen"] < 0.85
    assert errors(texture).mean() < 6
    unseen = errors(texture, seen=False)
    assert len(unseen) > 5_000
    assert unseen.mean() < 70  # no background, no black
    assert texture.image[~texture.seen].min() > GROUND


def test_exposures_are_evened_out(ball):
    ball.change(4, lambda image: image * 0.7)
    texture = ball.bake()
    gains = {view: np.mean(gain) for view, gain in texture.notes["gains"].items()}
    assert gains.pop("v4") == pytest.approx(1 / 0.7, abs=0.15)
    assert list(gains.values()) == pytest.approx([1] * (VIEWS - 1), abs=0.06)
    assert errors(texture).mean() < 6


def test_a_camera_that_is_astray_is_brought_back(ball):
    turn = Rotation.from_rotvec([0.004, -0.005, 0.01]).as_matrix()
    R, t = ball.cameras.R.clone(), ball.cameras.t.clone()
    R[6], t[6] = torch.tensor(turn) @ R[6], torch.tensor(turn) @ t[6]
    astray = replace(ball.cameras, R=R, t=t)
    refined, plain = ball.bake(astray), ball.bake(astray, refine=False)
    assert refined.notes["cameras"]["moved"] >= 1
    assert plain.notes["cameras"] == {}
    assert errors(refined).mean() < errors(plain).mean()


def test_a_hand_in_one_view_is_outvoted_where_several_see_what_it_hides(tmp_path):
    ball = Ball(tmp_path, 40)

    def cover(image):
        image[90:170, 90:170] = 250
        return image

    ball.change(20, cover)
    assert np.quantile(errors(ball.bake()), 0.97) < 30


def test_the_side_is_that_of_the_photographs_pixels_or_as_asked(ball):
    assert ball.bake(size=300).image.shape == (300, 300, 3)
    small = ball.bake(size=128)  # the mean of what is finer
    assert small.image.shape == (128, 128, 3)
    assert errors(small).mean() < 12
    ours = ball.bake()
    across = 2 * RADIUS * ours.notes["size"]
    assert 256 <= ours.notes["size"] <= 768
    assert across > 150


def test_without_anything_seen_all_is_grey(ball):
    ball.silhouettes[:] = False
    texture = ball.bake()
    assert np.abs(texture.image.astype(int) - 124).max() <= 1
    assert not texture.seen.any()
    assert texture.notes["unseen"] == 1


def test_cameras_stay_where_photographs_show_nothing(ball):
    for i in range(VIEWS):
        ball.change(i, lambda image: np.full_like(image, 255))
    moves = ball.bake().notes["cameras"]
    assert moves["moved"] == moves["pixels"] == 0
    assert moves["error_after"] == moves["error_before"]
