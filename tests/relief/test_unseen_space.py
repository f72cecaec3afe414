"""A well: views see its walls down to a height, and leave a mound of what they do not see."""

import numpy as np

from silmesh.relief.unseen_space import find_unseen_air

SIDE, RADIUS, LOW, TOP = 64, 18, 20, 38  # of a block and its well: where walls end, and the mound
X, Y, Z = np.indices((SIDE, SIDE, SIDE))
OUT = np.hypot(X - SIDE / 2 + 0.5, Y - SIDE / 2 + 0.5)
MOUND = LOW + (TOP - LOW) * (1 - OUT / RADIUS)
NOTHING = np.zeros(OUT.shape, bool)


def well(mound=MOUND, seen=0.0):
    """Field, weight and bound of a block with a well that is free down to ``mound``.

    Args:
        seen: weight of the mound's surface, three samples deep
    """
    bound = np.minimum.reduce([X, Y, Z, SIDE - 1 - X, SIDE - 1 - Y, SIDE - 1 - Z]).clip(0, 3) / 3
    free = (OUT < RADIUS) & (mound < Z)
    walls = (OUT >= RADIUS) & (OUT < RADIUS + 3) & (Z >= LOW)
    floor = (OUT < RADIUS) & (mound >= Z) & (mound - 3 < Z)
    field = np.where(free, -1.0, bound)
    weight = np.where(free, 9.0, np.where(walls, 5.0, np.where(floor, seen, 0.0)))
    return field, weight, bound.astype(float)


def test_a_mound_that_no_view_sees_is_cut_off_where_the_walls_end():
    field, weight, bound = well()
    air = find_unseen_air(field, weight, bound, NOTHING)
    left = (field > 0) & ~air & (OUT < RADIUS)
    assert abs(Z[air].min() - LOW) <= 2  # samples: a node of the graph
    assert abs(Z[left].max() - LOW) <= 2
    assert OUT[air].max() < RADIUS


def test_what_views_see_stays():
    assert not find_unseen_air(*well(seen=5.0), NOTHING).any()


def test_what_single_depths_pretend_does_not_stay():
    assert find_unseen_air(*well(seen=0.5), NOTHING).sum() > 4_000


def test_a_flat_floor_stays():
    assert not find_unseen_air(*well(np.full(OUT.shape, float(LOW))), NOTHING).any()


def test_a_solid_block_stays():
    _, _, bound = well()
    nothing = np.zeros(bound.shape)
    assert not find_unseen_air(bound, nothing, bound, NOTHING).any()


def test_what_has_to_stay_stays():
    held = (OUT < 6) & (Z <= TOP)
    air = find_unseen_air(*well(), held)
    assert not air[held].any()
    assert air.any()


def test_nothing_near_the_bound_is_air():
    """A well nearly as deep as the block: below its walls there are six samples."""
    deep = MOUND - LOW + 4
    air = find_unseen_air(*well(deep), NOTHING)
    assert Z[air].min() >= 3


def test_a_hidden_hollow_in_one_piece_with_the_mound_stays():
    """Deep below the mound, where no air is near: what is not reached is not asked."""
    field, weight, bound = well()
    field[30:34, 30:34, 6:10] = -0.5  # closed in all around, so free in name only
    air = find_unseen_air(field, weight, bound, NOTHING)
    assert Z[air].min() >= LOW - 2


def test_a_post_that_views_see_without_depths_is_kept():
    """A plain post on the floor of a patterned well: its surface is seen."""
    field, weight, bound = well(np.full(OUT.shape, float(LOW)), seen=5.0)
    post = (OUT < 5) & (LOW <= Z) & (Z < 40)
    field[post], weight[post] = 1.0, 0.0
    assert find_unseen_air(field, weight, bound, NOTHING)[post].all()
    surface = post & ((OUT >= 3.5) | (Z >= 38))
    assert not find_unseen_air(field, weight, bound, surface).any()


def test_what_stands_in_a_mound_is_not_severed():
    """Of a spoon that leans on nothing the lower end is hidden, as the mound about it is."""
    field, weight, bound = well()
    spoon = (OUT < 4) & (TOP - 6 <= Z) & (Z < 58)
    field[spoon], weight[spoon] = 1.0, 0.0
    seen = spoon & ((OUT >= 2.5) | (Z >= 56)) & (TOP <= Z)
    assert seen.sum() > 500
    assert not find_unseen_air(field, weight, bound, seen).any()
    speck = seen & (Z < TOP + 2)
    assert find_unseen_air(field, weight, bound, speck).any()


def test_of_nothing_nothing_is_air():
    for shape in ((1, 2, 3), (8, 8, 8)):
        free = np.full(shape, -1.0)
        assert not find_unseen_air(free, -free, free, free > 0).any()
        assert not find_unseen_air(-free, 0 * free, -free, free > 0).any()
