import numpy as np
import pytest
from PIL import Image
from scenes import blotches
from scipy import ndimage

from silmesh.scene.colour_edges import compare, compare_all, contradict, describe_offset

ROWS, COLUMNS = np.indices((96, 128)) + 0.5
SHAPE = ((COLUMNS - 60) / 28) ** 2 + ((ROWS - 50) / 20) ** 2 < 1
SHAPE |= (np.abs(COLUMNS - 60) < 6) & (np.abs(ROWS - 25) < 12)
FRAME = (0, 0, 128, 96)
PLAIN = np.full((96, 128, 3), 225.0)
CLUTTER = np.repeat(blotches(1, (128, 96))[..., None], 3, axis=2).astype(float)


def photograph(ground, colour=(150, 90, 60)):
    """The shape before a ground, sharp and a little noisy."""
    pixels = np.where(SHAPE[..., None], colour, ground)
    noise = np.random.default_rng(0).normal(0, 2, pixels.shape)
    return (ndimage.gaussian_filter(pixels, (0.5, 0.5, 0)) + noise).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("ground", [PLAIN, 0 * PLAIN, CLUTTER])
def test_a_true_silhouette_lies_on_its_edges(ground):
    figures = compare(photograph(ground), SHAPE, FRAME)
    assert min(figures["edges"], figures["in_place"]) > 0.95
    assert abs(figures["offset"]) <= 1
    assert not contradict(figures)
    assert describe_offset([figures]) == []


@pytest.mark.parametrize("ground", [PLAIN, 0 * PLAIN, CLUTTER])
@pytest.mark.parametrize(("pixels", "side"), [(3, "outside"), (-3, "inside"), (4, "outside")])
def test_outlines_that_all_lie_beside_the_edges_are_told(ground, pixels, side):
    change = ndimage.binary_dilation if pixels > 0 else ndimage.binary_erosion
    shape = change(SHAPE, iterations=abs(pixels))
    figures = compare(photograph(ground), shape, FRAME)
    assert figures["offset"] == pytest.approx(pixels, abs=1)
    (said,) = describe_offset([figures, figures, compare(photograph(ground), SHAPE, FRAME)])
    assert f"pixels {side} the edges" in said


@pytest.mark.parametrize("ground", [PLAIN, 0 * PLAIN, CLUTTER])
@pytest.mark.parametrize("shift", [(0, 7), (7, 0), (-5, -5), (0, 30)])
def test_a_mask_beside_its_object_is_contradicted(ground, shift):
    """By a tenth of the object's diagonal, and by half an object."""
    assert contradict(compare(photograph(ground), np.roll(SHAPE, shift, (0, 1)), FRAME))


@pytest.mark.parametrize("size", [64, 128])
def test_a_shadow_that_passes_for_the_object_is_contradicted(size):
    foot = ((COLUMNS - 60) / 55) ** 2 + ((ROWS - 70) / 18) ** 2
    dark = 1 - 0.5 * ndimage.gaussian_filter((foot < 1).astype(float), 7)
    pixels = photograph(PLAIN * dark[..., None])
    height = size * 3 // 4
    pixels = np.asarray(Image.fromarray(pixels).resize((size, height), Image.Resampling.LANCZOS))
    for shape, wrong in ((SHAPE, False), (SHAPE | (dark < 0.93), True)):
        small = np.asarray(Image.fromarray(shape).resize((size, height)))
        assert contradict(compare(pixels, small, (0, 0, size, height))) == wrong


def test_nothing_is_said_of_what_has_no_outline():
    for silhouette in (np.zeros_like(SHAPE), np.ones_like(SHAPE)):
        figures = compare(photograph(PLAIN), silhouette, FRAME)
        assert np.isnan(list(figures.values())).all()
        assert not contradict(figures)


def test_a_cut_out_photograph_says_nothing():
    rgb = photograph(PLAIN)
    rgba = np.dstack([rgb, np.where(SHAPE, 255, 0).astype(np.uint8)])
    images = {name: Image.fromarray(pixels) for name, pixels in (("a", rgb), ("b", rgba))}
    shapes, frames = np.stack([SHAPE, SHAPE]), np.array([FRAME, FRAME])
    seen, cut_out = compare_all(images, ["a", "b"], shapes, frames)
    assert seen["edges"] > 0.95
    assert np.isnan(cut_out["edges"])


def test_large_images_are_looked_at_in_steps():
    large = [np.kron(a, np.ones((3, 3, 1)[: a.ndim], a.dtype)) for a in (photograph(PLAIN), SHAPE)]
    frame = [3 * side for side in FRAME]
    figures = compare(*large, frame)
    assert min(figures["edges"], figures["in_place"]) > 0.95
    assert abs(figures["offset"]) <= 2
    assert contradict(compare(large[0], np.roll(large[1], 24, 0), frame))
