import numpy as np
import pytest

from silmesh.silhouettes.threshold import separate

ROWS, COLUMNS = np.indices((96, 128)) + 0.5
ELLIPSE = ((COLUMNS - 70) / 30) ** 2 + ((ROWS - 50) / 22) ** 2 < 1


def photograph(ground, shade, noise):
    """An ellipse, or what ``shade`` is nonzero in, on a plain noisy background."""
    rng = np.random.default_rng(0)
    grey = np.where(ELLIPSE, shade, ground) + rng.normal(0, noise, ELLIPSE.shape)
    pixels = np.repeat(grey[..., None], 3, axis=-1) + rng.normal(0, noise / 2, (96, 128, 3))
    return pixels.clip(0, 255).astype(np.uint8)


def iou(found, truth):
    return (found & truth).sum() / (found | truth).sum()


@pytest.mark.parametrize("noise", [0, 3])
@pytest.mark.parametrize(
    ("ground", "shade"),
    [(0, 60), (0, 255), (128, 40), (128, 230), (255, 20), (255, 200), (90, 130)],
)
def test_an_object_on_a_plain_noisy_background(ground, shade, noise):
    assert iou(separate(photograph(ground, shade, noise)), ELLIPSE) > 0.98


def test_an_object_with_a_light_and_a_dark_side_stays_whole():
    shade = np.where(COLUMNS < 70, 230, 50)
    assert iou(separate(photograph(5, shade, 2)), ELLIPSE) > 0.97


def test_a_colour_that_is_as_bright_as_the_background():
    pixels = np.full((96, 128, 3), 100, np.uint8)
    pixels[ELLIPSE] = (160, 70, 100)
    np.testing.assert_array_equal(separate(pixels), ELLIPSE)


def test_specks_go_and_pinholes_close_but_a_real_hole_stays():
    shape = ELLIPSE.copy()
    shape[44:56, 64:76] = False  # 7 % of the ellipse
    pixels = np.where(shape[..., None], 200, 10).astype(np.uint8).repeat(3, axis=2)
    pixels[5:8, 5:8] = 200
    pixels[50:53, 90:93] = 10
    np.testing.assert_array_equal(separate(pixels), shape)


@pytest.mark.parametrize("shade", [30, 250])
def test_uneven_light_on_the_background(shade):
    """It falls off from 190 at the upper left to 90 at the lower right, and is noisy."""
    light = 190 - 60 * (COLUMNS / 128) - 40 * (ROWS / 96) ** 2
    assert iou(separate(photograph(light, shade, 2)), ELLIPSE) > 0.97


def test_a_part_almost_as_dark_as_the_background_is_filled_and_a_hole_is_not():
    spot = ((COLUMNS - 60) / 9) ** 2 + ((ROWS - 50) / 9) ** 2 < 1
    rng = np.random.default_rng(0)
    for inside, expected in ((16, ELLIPSE), (8, ELLIPSE & ~spot)):
        grey = np.where(spot, inside, np.where(ELLIPSE, 180, 8)) + rng.normal(0, 1, spot.shape)
        pixels = np.repeat(grey[..., None], 3, axis=-1).clip(0, 255).astype(np.uint8)
        assert iou(separate(pixels), expected) > 0.98


def test_an_object_may_touch_the_border():
    shape = (ROWS > 40) & (np.abs(COLUMNS - 64) < 20)
    pixels = np.where(shape[..., None], 40, 240).astype(np.uint8).repeat(3, axis=2)
    np.testing.assert_array_equal(separate(pixels), shape)


def test_an_object_that_covers_an_eighth_of_the_border():
    """The frame cuts it below: the border's noise is not the object's contrast."""
    wide = (np.abs(COLUMNS - 64) < 28) & (ROWS > 30)
    assert 0.11 < wide[-1].sum() / (2 * (96 + 128)) < 0.13
    for noise in (0, 3):
        rng = np.random.default_rng(0)
        grey = np.where(wide, 90 + 60 * (ROWS > 60), 10) + rng.normal(0, noise, wide.shape)
        pixels = np.repeat(grey[..., None], 3, axis=-1).clip(0, 255).astype(np.uint8)
        assert iou(separate(pixels), wide) > 0.98


def test_a_blank_photograph_shows_nothing():
    assert not separate(np.full((20, 30, 3), 77, np.uint8)).any()
