"""PSNR and SSIM inside the object, by hand; a texture is judged by photographs it has not seen."""

import numpy as np
import pytest
import trimesh
from balls import GROUND, LARGE, RADIUS, photograph_ball
from PIL import Image

from silmesh.errors import InputError
from silmesh.evaluation.appearance import compare
from silmesh.evaluation.texturing import make_texture
from silmesh.settings.texture import Texture

COUNT = 8
BALL = trimesh.creation.icosphere(3, RADIUS)


def test_psnr_is_of_the_pixels_inside():
    photograph = np.full((40, 40, 3), 100, np.uint8)
    inside = np.zeros((40, 40), bool)
    inside[10:30, 10:30] = True
    image = np.where(inside[..., None], photograph, 0)
    image[10:20, 10:30, 0] += 12  # half of the pixels, one channel of three: 144 / 6 = 24
    psnr, ssim = compare(image, photograph, inside)
    assert psnr == pytest.approx(10 * np.log10(255**2 / 24))
    assert 0 < ssim < 1
    assert compare(photograph, photograph, inside)[1] == 1


def test_a_mask_of_one_pixel_is_compared():
    photograph = np.zeros((5, 5, 3), np.uint8)
    inside = np.zeros((5, 5), bool)
    inside[2, 2] = True
    assert compare(photograph, photograph, inside)[1] == 1
    assert compare(photograph + np.uint8(51), photograph, inside)[0] == pytest.approx(13.979, 1e-3)


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    return photograph_ball(tmp_path_factory.mktemp("ball"), COUNT)


def bake(ball, holdout: int = 0, size: int = 256):
    cameras, views, silhouettes = ball
    return make_texture(
        BALL, cameras, views, None, silhouettes, Texture(size=size), holdout=holdout
    )


def test_a_texture_shows_photographs_that_it_has_not_seen(ball):
    held = bake(ball, holdout=4).notes
    assert list(held["held_out"]["views"]) == ["v3", "v7"]
    assert held["views"] == COUNT - 2
    assert held["held_out"]["psnr"] > 30
    assert held["held_out"]["ssim"] > 0.9
    assert held["size"] == 256


def test_held_out_photographs_have_no_part_in_it(ball, tmp_path):
    cameras, views, silhouettes = photograph_ball(tmp_path, COUNT)
    before = bake((cameras, views, silhouettes), holdout=4)
    for view in ("v3", "v7"):
        Image.new("RGB", (LARGE, LARGE), (255, 0, 255)).save(tmp_path / f"{view}.png")
    after = bake((cameras, views, silhouettes), holdout=4)
    assert (after.image == before.image).all()
    assert after.notes["held_out"]["psnr"] < 15


def test_without_held_out_photographs_nothing_is_measured_and_it_is_the_same_each_time(ball):
    one, other = bake(ball), bake(ball)
    assert one.notes["held_out"] is None
    assert one.notes == other.notes
    assert (one.image == other.image).all()
    assert (one.uv == other.uv).all()
    assert "no photograph shows" in one.notes["warnings"][0]  # the ball's lower side


def test_an_object_of_one_colour_has_a_texture_of_that(tmp_path):
    ball = photograph_ball(tmp_path, COUNT)
    for file in tmp_path.iterdir():
        with Image.open(file) as image:
            shown = (np.asarray(image) != GROUND).any(axis=2)
        plain = np.where(shown[..., None], (200, 120, 40), GROUND).astype(np.uint8)
        Image.fromarray(plain).save(file)
    found = bake(ball)
    assert np.abs(found.image[found.seen] - np.array([200.0, 120, 40])).max() <= 4


def test_a_photograph_that_vanished_or_changed_is_named(tmp_path):
    ball = photograph_ball(tmp_path, COUNT)
    Image.new("RGB", (LARGE, LARGE // 2)).save(tmp_path / "v2.png")
    with pytest.raises(InputError, match=r"v2\.png: has 192x96 pixels, and had 192x192 when"):
        bake(ball)
    (tmp_path / "v2.png").unlink()
    with pytest.raises(InputError, match=r"v2\.png: cannot be read as an image: No such file"):
        bake(ball)
