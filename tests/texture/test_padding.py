"""Gaps between charts take colours of what is near."""

import numpy as np

from silmesh.texture.padding import fill_gaps


def test_what_is_known_stays_and_the_rest_is_near():
    known = np.zeros((13, 10), bool)
    known[:4], known[9:] = True, True
    image = np.zeros((13, 10, 3), np.float32)
    image[:4], image[9:] = 50, 200
    filled = fill_gaps(image, known)
    assert (filled[known] == image[known]).all()
    assert (filled[4] < 130).all()
    assert (filled[8] > 120).all()
    assert filled.min() >= 50
    assert filled.max() <= 200


def test_nothing_known_stays_as_it_is():
    image = np.full((4, 4, 3), 7, np.float32)
    assert (fill_gaps(image, np.zeros((4, 4), bool)) == 7).all()
