"""Colours between known ones."""

import numpy as np
import pytest
import trimesh

from silmesh.texture.filling import GREY, fill_vertices

STRIP = np.array([[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])  # six vertices in a zigzag


def test_colours_change_evenly_between_those_that_are_known():
    """Equal weights of the neighbours on the zigzag 0-1-2-3-4-5 are solved by hand below."""
    colours = np.zeros((6, 3))
    colours[5] = 100
    filled = fill_vertices(colours, np.array([True, False, False, False, False, True]), STRIP)
    one, two, three, four = filled[1:5, 0]
    assert one == pytest.approx((two + three) / 3, abs=1e-3)
    assert two == pytest.approx((one + three + four) / 4, abs=1e-3)
    assert three == pytest.approx((one + two + four + 100) / 4, abs=1e-3)
    assert four == pytest.approx((two + three + 100) / 3, abs=1e-3)


def test_a_part_of_which_nothing_is_known_is_grey():
    both = trimesh.util.concatenate([trimesh.creation.icosphere(1) for _ in range(2)])
    known = np.arange(len(both.vertices)) < 5
    filled = fill_vertices(np.full((len(known), 3), 30.0), known, both.faces)
    half = len(known) // 2
    assert filled[:half] == pytest.approx(30, abs=0.1)
    assert filled[half:] == pytest.approx(GREY, abs=0.1)
