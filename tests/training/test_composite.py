import math

import numpy as np
import pytest
import torch

from silmesh.training import composite
from silmesh.training.composite import (
    blur,
    compose_random,
    compose_upright,
    lay_over,
    place,
)

# A cutout, 40 wide and 20 high: red on the left half, green on the right one, all of it covered.
CUTOUT = torch.zeros(4, 20, 40, dtype=torch.uint8)
CUTOUT[0, :, :20], CUTOUT[1, :, 20:], CUTOUT[3] = 255, 255, 255


def box(coverage):
    """Left, top, right and bottom of what is covered by more than half."""
    rows, columns = (np.flatnonzero((coverage > 0.5).any(dim=axis)) for axis in (1, 0))
    return columns[0], rows[0], columns[-1] + 1, rows[-1] + 1


@pytest.mark.parametrize(
    ("longer", "angle", "stretch", "shift", "expected"),
    [
        (0.5, 0, (1, 1), (0, 0), (20, 30, 60, 50)),
        (1.0, 0, (1, 1), (0, 0), (0, 20, 80, 60)),
        (0.5, math.pi / 2, (1, 1), (0, 0), (30, 20, 50, 60)),
        (0.5, 0, (1.5, 1), (0, 0), (10, 30, 70, 50)),
        (0.5, 0, (1, 1), (0.125, -0.25), (30, 10, 70, 30)),
    ],
)
def test_a_cutout_lies_where_it_is_put(longer, angle, stretch, shift, expected):
    _, coverage = place(CUTOUT, 80, longer, angle, stretch, shift)
    assert box(coverage) == expected


@pytest.mark.parametrize(
    ("angle", "mirror", "red_at", "green_at"),
    [
        (0, 1, (40, 25), (40, 55)),
        (0, -1, (40, 55), (40, 25)),
        (math.pi / 2, 1, (25, 40), (55, 40)),  # rows and columns: x turns towards y, down
    ],
)
def test_colours_go_with_the_cutout(angle, mirror, red_at, green_at):
    colour, _ = place(CUTOUT, 80, 0.5, angle, (mirror, 1), (0, 0))
    np.testing.assert_allclose(colour[(slice(None), *red_at)], [1, 0, 0], atol=1e-5)
    np.testing.assert_allclose(colour[(slice(None), *green_at)], [0, 1, 0], atol=1e-5)


def test_an_edge_mixes_object_and_background_by_coverage():
    colour, behind = torch.full((3, 1, 3), 0.8), torch.full((3, 1, 3), 0.2)
    image = lay_over(colour, torch.tensor([[0, 0.5, 1]]), behind)
    np.testing.assert_allclose(image[0], [[0.2, 0.5, 0.8]])


def test_blur_spreads_and_keeps_the_sum():
    image = torch.zeros(2, 41, 41)
    image[:, 20, 20] = 1
    blurred = blur(image, 3.0)
    offset = torch.arange(41) - 20.0
    assert blurred[0].sum() == pytest.approx(1, abs=1e-5)
    variance = float((blurred[0].sum(dim=0) * offset**2).sum())
    assert variance == pytest.approx(9, rel=0.1)  # cut off at 2.5 standard deviations
    torch.testing.assert_close(blurred[1], blurred[0].T)


@pytest.mark.parametrize("upright", [0, 1])
def test_the_same_number_gives_the_same_composite(upright, monkeypatch):
    monkeypatch.setattr(composite, "UPRIGHT", upright)
    backgrounds = [[torch.full((3, 50, 60), 90, dtype=torch.uint8)]]
    pairs = [compose_random(CUTOUT, backgrounds, 48, np.random.default_rng(s)) for s in (3, 3, 4)]
    assert torch.equal(pairs[0][0], pairs[1][0])
    assert torch.equal(pairs[0][1], pairs[1][1])
    assert not torch.equal(pairs[0][0], pairs[2][0])
    for image, truth in pairs:
        assert image.shape == (3, 48, 48)
        assert 0 <= image.min() <= image.max() <= 1
        assert set(truth.unique().tolist()) <= {0, 1}


def test_a_test_shows_the_object_as_it_is():
    background = torch.full((3, 50, 60), 90, dtype=torch.uint8)
    image, truth = compose_upright(CUTOUT, background, 96, np.random.default_rng(0))
    assert image[2][truth > 0].max() < 0.2  # red and green; the edge takes of the grey
    np.testing.assert_allclose(image[:, truth == 0].median(), 90 / 255, atol=1e-3)
    left, top, right, bottom = box(truth)
    assert 0.48 * 96 <= right - left <= 0.87 * 96
    assert (right - left) / (bottom - top) == pytest.approx(2, rel=0.1)
