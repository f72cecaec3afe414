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


def test_stripes_go_on_beside_a_chart():
    known = np.zeros((16, 9), bool)
    known[:, :4] = True
    image = np.zeros((16, 9, 3), np.float32)
    image[6, :4] = 240  # a stripe of one texel that ends at the chart's edge
    filled = fill_gaps(image, known)[..., 0]
    assert filled[6, 4] == 240 / 2  # 1 of the stripe beside it, half of each of two that are black
    assert filled[5, 4] == filled[7, 4] == 240 * 0.5 / 2
    assert (filled[[4, 8], 4] == 0).all()


def test_nothing_known_stays_as_it_is():
    image = np.full((4, 4, 3), 7, np.float32)
    assert (fill_gaps(image, np.zeros((4, 4), bool)) == 7).all()
