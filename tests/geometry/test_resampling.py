"""Images at other places than their pixels, against torch's ``grid_sample`` and by hand."""

import numpy as np
import pytest
import torch

from silmesh.geometry.resampling import resample

HEIGHT, WIDTH = 60, 90
SHAPE = (150, 110)  # of new images, of which more than one block of rows is made


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def look_up(image, sources, mode):
    """By torch: [rows, columns, channels] float32."""
    grid = torch.as_tensor(sources / [WIDTH, HEIGHT] * 2 - 1).float().nan_to_num(nan=-3.0)
    planes = torch.as_tensor(np.moveaxis(image, -1, 0)).float()
    found = torch.nn.functional.grid_sample(planes[None], grid[None], mode, "zeros", False)
    return np.moveaxis(found[0].numpy(), 0, -1)


@pytest.mark.parametrize("cubic", [False, True])
@pytest.mark.parametrize("channels", [1, 3])
def test_each_pixel_is_looked_up_at_its_own_place(rng, cubic, channels):
    image = rng.random((HEIGHT, WIDTH, channels)).astype(np.float32)
    sources = rng.uniform(-4, [WIDTH + 4, HEIGHT + 4], (*SHAPE, 2))
    sources[3, 5], sources[149, 0] = np.nan, (0.5, 0.5)
    expected = look_up(image, sources, "bicubic" if cubic else "bilinear")
    found = resample(image, sources, SHAPE, cubic)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=2e-5)
    assert (found[3, 5] == 0).all()
    np.testing.assert_allclose(found[149, 0], image[0, 0], rtol=1e-6)


def test_between_places_one_goes_along_lines(rng):
    image = rng.random((HEIGHT, WIDTH)).astype(np.float32)
    few = rng.uniform(0, [WIDTH, HEIGHT], (4, 6, 2))
    planes = torch.as_tensor(few).permute(2, 0, 1)[None]
    all_ = torch.nn.functional.interpolate(planes, SHAPE, mode="bilinear", align_corners=True)
    expected = look_up(image[..., None], all_[0].permute(1, 2, 0).numpy(), "bilinear")
    np.testing.assert_allclose(resample(image, few, SHAPE), expected[..., 0], atol=2e-5)


def test_colours_are_rounded_and_cut_to_what_a_byte_holds():
    image = np.zeros((4, 8), np.uint8)
    image[:, 4:] = 255
    sources = np.array([[[3.9, 2.0], [4.25, 2.0], [5.5, 2.0]]])
    by_hand = 255 * np.array([0.4, 0.75, 1.0])
    assert resample(image, sources, (1, 3)).tolist() == [by_hand.round().tolist()]
    assert resample(image, sources, (1, 3), cubic=True)[0, 2] == 255  # which overshoots it


def test_a_silhouette_is_where_at_least_half_is():
    inside = np.zeros((4, 8), bool)
    inside[:, 4:] = True
    places = [[[x, 2.0] for x in (3.99, 4.0, 7.9, 8.0, 8.01)]]
    found = resample(inside, np.array(places), (1, 5))
    assert found.tolist() == [[False, True, True, True, False]]


@pytest.mark.parametrize("size", [1, 2, 65, 4001])
def test_the_last_place_is_the_last_pixels(size):
    image = np.arange(12, dtype=np.float32)[None].repeat(3, axis=0)
    places = np.array([[[1.5, 1.5], [4.5, 1.5], [9.5, 1.5]]])
    found = resample(image, places, (1, size))[0]
    assert found[0] == 1
    assert found[-1] == pytest.approx(9 if size > 1 else 1, abs=1e-5)


@pytest.mark.parametrize("cubic", [False, True])
def test_of_a_part_no_more_is_made(rng, cubic):
    image = rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    sources = rng.uniform(0, [WIDTH, HEIGHT], (9, 7, 2))
    whole = resample(image, sources, SHAPE, cubic)
    found = resample(image, sources, SHAPE, cubic, part=(20, 5, 90, 140))
    inside = np.zeros(SHAPE, bool)
    inside[5:140, 20:90] = True
    assert (found[inside] == whole[inside]).all()
    assert not found[~inside].any()
