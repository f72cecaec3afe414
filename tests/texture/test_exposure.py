"""Gains that made-up photographs were multiplied by are found again."""

import numpy as np
import pytest

from silmesh.texture.exposure import find_gains

GAINS = np.array([[1.2, 1, 0.9], [1, 1, 1], [0.8, 1.1, 1], [1, 0.9, 1.15]])


@pytest.fixture
def scene():
    """Colours [views, points, 3] of which each view sees two thirds; their weights."""
    random = np.random.default_rng(5)
    paint = random.uniform(60, 180, (300, 3))
    weights = (random.random((4, 300)) < 0.66) * random.uniform(0.2, 1, (4, 300))
    return paint * GAINS[:, None], weights


def relative(gains):
    """But for what all views share, which nothing tells."""
    return gains / np.exp(np.log(gains).mean(axis=0))


def test_gains_are_found(scene):
    found = find_gains(*scene)
    assert relative(found * GAINS) == pytest.approx(1, abs=0.02)


def test_highlights_do_not_count(scene):
    colours, weights = scene
    colours[2, :60] = 245
    found = find_gains(colours, weights)
    assert relative(found * GAINS) == pytest.approx(1, abs=0.04)


def test_equal_views_keep_their_exposure(scene):
    colours, weights = scene
    found = find_gains(np.repeat(colours[:1], 4, axis=0), weights)
    assert found == pytest.approx(1, abs=1e-6)


def test_a_view_that_sees_nothing_keeps_its_exposure(scene):
    colours, weights = scene
    weights[1] = 0
    assert np.isfinite(find_gains(colours, weights)).all()
