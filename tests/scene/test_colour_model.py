import numpy as np
import pytest

from silmesh.scene.colour_model import ANY, SPREAD, ColourModel


def test_the_density_of_one_colour_is_that_of_a_gaussian():
    model = ColourModel(np.tile(np.uint8([10, 20, 30]), (50, 1)))
    expected = (1 - ANY) * (2 * np.pi * SPREAD**2) ** -1.5 + ANY / 256**3
    found = model.log_density(np.uint8([[10, 20, 30], [200, 200, 200]]))
    assert found[0] == pytest.approx(np.log(expected))
    assert found[1] == pytest.approx(np.log(ANY / 256**3))


def test_two_things_are_told_apart_and_the_same_pixels_give_the_same():
    rng = np.random.default_rng(1)
    red = rng.normal((200, 40, 40), 10, (5000, 3)).clip(0, 255).astype(np.uint8)
    grey = rng.normal(100, 10, (5000, 3)).astype(np.uint8)
    both = np.concatenate([red, grey])
    asked = np.uint8([[200, 40, 40], [100, 100, 100]])
    found = [ColourModel(pixels).log_density(asked) for pixels in (red, grey, both)]
    assert found[0][0] > found[1][0] + 3
    assert found[1][1] > found[0][1] + 3
    assert (found[2] > found[0][1] + 3).all()  # neither is rare in both
    np.testing.assert_array_equal(found[2], ColourModel(both).log_density(asked))


def test_a_few_pixels_are_enough():
    assert np.isfinite(ColourModel(np.uint8([[1, 2, 3]])).log_density(np.uint8([[4, 5, 6]]))).all()
