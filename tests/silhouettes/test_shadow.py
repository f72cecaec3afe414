import numpy as np
import pytest
from PIL import Image
from scenes import save
from scipy import ndimage

from silmesh.silhouettes import read_silhouettes, write_silhouettes
from silmesh.silhouettes.shadow import find_shadow
from silmesh.silhouettes.threshold import find_ground, separate
from silmesh.views import write_views

ROWS, COLUMNS = np.indices((192, 256)) + 0.5
BODY = (np.abs(COLUMNS - 120) < 34) & (np.abs(ROWS - 95) < 62)
BODY |= ((COLUMNS - 120) / 55) ** 2 + ((ROWS - 70) / 30) ** 2 < 1
BROWN, BLACK, GREY = (150, 90, 60), (30, 30, 32), (110, 112, 110)
WHITE, BLUE, GREEN = (238, 238, 238), (120, 150, 210), (150, 200, 160)


def scene(ground, colour, strength, softness=8, uneven=0.0, seed=0):
    """A body with a soft shadow about its foot, shaded from left to right: [192, 256, 3] uint8."""
    foot = ((COLUMNS - 125) / 75) ** 2 + ((ROWS - 152) / 16) ** 2 < 1
    dark = ndimage.gaussian_filter(foot.astype(float), softness)
    light = (1 - strength * dark / dark.max()) * (1 - uneven * COLUMNS / 256)
    paper = light[..., None] * np.array(ground, float)
    shaded = np.array(colour) * (1.15 - 0.3 * COLUMNS / 256)[..., None]
    pixels = ndimage.gaussian_filter(np.where(BODY[..., None], shaded, paper), (0.5, 0.5, 0))
    noise = np.random.default_rng(seed).normal(0, 1.2, pixels.shape)
    return (pixels + noise).clip(0, 255).astype(np.uint8)


def iou(found):
    return (found & BODY).sum() / (found | BODY).sum()


def without_shadow(pixels):
    found = separate(pixels)
    return found, found & ~find_shadow(pixels, find_ground(pixels), found)


@pytest.mark.parametrize("uneven", [0, 0.25])
@pytest.mark.parametrize(("strength", "softness"), [(0.25, 6), (0.5, 8), (0.6, 5)])
@pytest.mark.parametrize("colour", [BROWN, BLACK])
@pytest.mark.parametrize("ground", [WHITE, BLUE, GREEN])
def test_a_soft_shadow_is_left_out(ground, colour, strength, softness, uneven):
    found, kept = without_shadow(scene(ground, colour, strength, softness, uneven))
    assert iou(found) < 0.9
    assert iou(kept) > 0.96


@pytest.mark.parametrize("uneven", [0, 0.25])
@pytest.mark.parametrize("colour", [BROWN, BLACK, GREY, (190, 190, 190)])
@pytest.mark.parametrize("ground", [WHITE, BLUE, (140, 140, 140), (20, 20, 20)])
def test_an_object_without_a_shadow_stays_as_it_is(ground, colour, uneven):
    """Also one that is grey as the ground, only darker: its outline is a step."""
    found, kept = without_shadow(scene(ground, colour, 0, uneven=uneven))
    np.testing.assert_array_equal(found, kept)


def test_a_grey_object_is_not_taken_for_its_shadow():
    """Where the two cannot be told apart, both stay."""
    for strength in (0.3, 0.5, 0.6):
        _, kept = without_shadow(scene(WHITE, GREY, strength))
        assert (kept & BODY).sum() > 0.97 * BODY.sum()


@pytest.mark.parametrize("size", [64, 256])
def test_small_working_images_lose_the_shadow_too(tmp_path, size):
    pixels = scene(WHITE, BROWN, 0.5)
    views = write_views([save(tmp_path / "a.png", pixels)], size, "pad", tmp_path / "views")
    write_silhouettes("threshold", views, tmp_path / "views", [], tmp_path / "out")
    found = read_silhouettes(tmp_path / "out", ["a"])[0]
    truth = views[0].into_square(Image.fromarray(BODY).convert("L"), Image.Resampling.BOX)
    truth = np.asarray(truth) > 127
    assert (found & truth).sum() / (found | truth).sum() > 0.93
