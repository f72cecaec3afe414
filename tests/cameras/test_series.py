"""Rounds and order, told from made-up silhouettes of bodies on a turntable."""

import numpy as np
import pytest
from scenes import names, silhouettes
from torch import full, tensor
from turns import LONG, ROUND, SIZE, turn

from silmesh.cameras.series import (
    alternates,
    find_gaps,
    find_rounds,
    find_strays,
    is_shuffled,
    prepare,
)
from silmesh.cameras.turntable import orbit_cameras


def ends(seen: np.ndarray) -> list[tuple[int, int]]:
    return [(part.start, part.stop) for part in find_rounds(prepare(seen))]


@pytest.mark.parametrize("axes", [LONG, ROUND])
@pytest.mark.parametrize("count", [8, 12, 24, 36, 72])
@pytest.mark.parametrize("elevation", [0, 12, 40])
def test_one_round_is_one(axes, count, elevation):
    assert ends(turn(count, elevation, axes)) == [(0, count)]


@pytest.mark.parametrize("axes", [LONG, ROUND])
@pytest.mark.parametrize(("count", "way"), [(7, 1), (12, 1), (18, 1), (12, -1), (18, -1)])
def test_two_rounds_of_one_length(axes, count, way):
    seen = np.concatenate([turn(count, 5, axes), turn(count, 45, axes, way)])
    assert ends(seen) == [(0, count), (count, 2 * count)]


def test_rounds_of_several_lengths_and_three_of_them():
    unequal = np.concatenate([turn(24, 5, ROUND), turn(16, 45, ROUND)])
    assert ends(unequal) == [(0, 24), (24, 40)]
    three = np.concatenate([turn(12, e) for e in (0, 30, 60)])
    assert ends(three) == [(0, 12), (12, 24), (24, 36)]


def test_half_a_turn_and_a_walk_that_rises_are_one_series():
    assert ends(turn(36, 20)[:18]) == [(0, 18)]
    azimuth, raised = np.arange(30) * 12.0, np.linspace(5, 50, 30)
    cameras = orbit_cameras(
        names(30), SIZE, full((30,), 2.732).double(), tensor(raised), tensor(azimuth)
    )
    assert ends(silhouettes(cameras, LONG, (0.06, 0.02, 0.03))) == [(0, 30)]


def test_photographs_out_of_order():
    seen = turn(36, 15)
    assert not is_shuffled(prepare(seen))
    assert is_shuffled(prepare(seen[np.random.default_rng(0).permutation(36)]))
    assert not is_shuffled(prepare(turn(24, 15, (0.3, 0.3, 0.3))[::-1]))


def test_two_rounds_taken_together():
    low, high = turn(24, 0, ROUND), turn(24, 60, ROUND)
    assert alternates(prepare(np.stack([low, high], axis=1).reshape(48, SIZE, SIZE)))
    assert not alternates(prepare(low))


def test_one_view_that_strays_and_a_gap():
    seen = turn(36, 15)
    assert find_strays(prepare(seen)) == []
    assert find_gaps(prepare(seen)) == []
    wrong = seen.copy()
    wrong[16] = seen[7]
    assert find_strays(prepare(wrong)) == [16]
    assert find_gaps(prepare(np.delete(turn(72, 15), range(9, 18), axis=0))) == [9]
