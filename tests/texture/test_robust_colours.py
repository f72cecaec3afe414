"""Views that differ from the others are outvoted."""

import numpy as np
import pytest

from silmesh.texture.robust_colours import agree

PAINT = np.array([120.0, 90, 60])


def test_a_view_that_sees_best_but_alone_does_not_win():
    colours = np.repeat(PAINT[None, None], 5, axis=0)
    colours[2] = 250
    weights = np.array([0.3, 0.4, 1, 0.3, 0.4])[:, None]
    mean, trust = agree(colours, weights)
    assert mean[0] == pytest.approx(PAINT, abs=3)
    assert trust[2, 0] < 0.05
    assert trust[[0, 1, 3, 4], 0] == pytest.approx([0.3, 0.4, 0.3, 0.4], rel=0.05)


def test_views_that_differ_a_little_are_averaged():
    colours = PAINT + np.array([-3.0, 0, 3])[:, None, None]
    mean, _ = agree(colours, np.ones((3, 1)))
    assert mean[0] == pytest.approx(PAINT, abs=0.1)


def test_what_no_view_sees_is_finite():
    mean, trust = agree(np.full((3, 1, 3), 80.0), np.zeros((3, 1)))
    assert np.isfinite(mean).all()
    assert (trust == 0).all()
