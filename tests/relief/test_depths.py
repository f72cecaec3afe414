"""Which depths count, of three cameras side by side before a wall."""

import numpy as np
import pytest

from silmesh.relief.depths import Depths, confirm
from silmesh.relief.sights import Sights

SIZE, WALL = 40, 2.0
EYES = -0.2, 0.0, 0.2  # along x; all look along z


def stand_side_by_side() -> Sights:
    shape = (len(EYES), SIZE, SIZE)
    K = np.tile([[40.0, 0, SIZE / 2], [0, 40, SIZE / 2], [0, 0, 1]], (len(EYES), 1, 1))
    t = np.array([[-x, 0, 0] for x in EYES])
    R = np.tile(np.eye(3), (len(EYES), 1, 1))
    return Sights(np.zeros(shape, np.float32), np.ones(shape, bool), K, R, t, 1.0)


def count_votes(*depths: float) -> int:
    """How many others confirm the wall in the middle of the second view's image.

    Args:
        depths: that each view has found everywhere; 0 for none
    """
    sights = stand_side_by_side()
    shape = sights.images.shape
    depth = np.broadcast_to(np.float32(depths)[:, None, None], shape).copy()
    normals = np.broadcast_to(np.float32([0, 0, -1]), (*shape, 3)).copy()
    score = np.where(depth > 0, np.float32(0.9), np.float32(-2))
    others = [np.array([j for j in range(3) if j != i]) for i in range(3)]
    votes = confirm(sights, Depths(depth, normals, score), np.ones(shape, bool), others)
    return int(votes[1, SIZE // 2, SIZE // 2])


@pytest.mark.parametrize(
    ("first", "third", "votes"),
    [
        (WALL, WALL, 2),
        (WALL, 0.5 * WALL, 1),  # something stands before the wall in the third
        (WALL, 1.5 * WALL, 0),  # the third sees through it
        (WALL, 0, 0),  # the third should see it, and finds nothing there
        (0.5 * WALL, 0.5 * WALL, 0),
        (1.5 * WALL, 0.5 * WALL, 0),
    ],
)
def test_a_depth_counts_if_two_others_find_it_or_the_only_one_that_may(first, third, votes):
    assert count_votes(first, WALL, third) == votes
