"""Damages have the strength that they are told, repeat by their seed, and leave what is given."""

import damage
import numpy as np
import pytest
import torch

from silmesh.cameras.turntable import turntable_cameras
from silmesh.geometry.frame import is_cut

SIZE, VIEWS = 60, 20


@pytest.fixture
def masks():
    """Twenty squares of 20 pixels, 400 in area, each at another place."""
    out = np.zeros((VIEWS, SIZE, SIZE), bool)
    for view, seen in enumerate(out):
        seen[10 + view : 30 + view, 20:40] = True
    return out


@pytest.fixture
def cameras():
    """Around the object in steps of 18 degrees."""
    return turntable_cameras([f"v{i:02}" for i in range(VIEWS)], SIZE, 2.732, 10.0, 18.0)


HARMS = {
    "bite": lambda masks, seed: damage.bite(masks, 0.15, 0.2, seed),
    "blob": lambda masks, seed: damage.add_blobs(masks, 0.15, 0.2, seed),
    "speck": lambda masks, seed: damage.add_specks(masks, 0.01, 0.2, seed),
    "grow": lambda masks, seed: damage.grow(masks, 2, 0.2, seed),
    "shrink": lambda masks, seed: damage.grow(masks, -2, 0.2, seed),
    "empty": lambda masks, seed: damage.empty(masks, 0.2, seed),
    "fill": lambda masks, seed: damage.fill(masks, 0.2, seed),
    "swap": lambda masks, seed: damage.swap(masks, ~masks, 0.2, seed),
}


@pytest.mark.parametrize("harm", HARMS.values(), ids=HARMS)
def test_just_the_named_views_are_damaged_and_a_seed_repeats(masks, harm):
    before = masks.copy()
    harmed, wrong = harm(masks, 3)
    assert len(wrong) == 4  # a fifth of twenty
    assert np.flatnonzero((harmed != before).any(axis=(1, 2))).tolist() == wrong
    np.testing.assert_array_equal(masks, before)
    again, the_same = harm(masks, 3)
    np.testing.assert_array_equal(again, harmed)
    assert the_same == wrong
    assert harm(masks, 4)[1] != wrong


@pytest.mark.parametrize(("share", "count"), [(0, 0), (0.01, 1), (0.05, 1), (0.4, 8), (1, 20)])
def test_a_share_of_the_views_is_damaged(share, count):
    assert len(damage.choose_views(VIEWS, share, 0, "bite")) == count


def test_a_bite_takes_its_part_of_the_area_off_the_outline(masks):
    bitten, wrong = damage.bite(masks, 0.15, 0.4)
    gone = masks & ~bitten
    assert not (bitten & ~masks).any()
    for view in wrong:
        assert gone[view].sum() == 60  # 0.15 of 400
        rows, columns = np.nonzero(gone[view])
        # A half disc of 60 pixels has the radius 6.2, a quarter at a corner 8.7.
        assert np.ptp(rows) <= 13
        assert np.ptp(columns) <= 13
        inner = np.zeros_like(masks[view])
        inner[11 + view : 29 + view, 21:39] = True
        assert (gone[view] & ~inner).any()  # it begins at the outline


def test_a_blob_adds_its_part_of_the_area_beside_the_object(masks):
    more, wrong = damage.add_blobs(masks, 0.1, 0.2)
    assert not (masks & ~more).any()
    assert [(more[view] & ~masks[view]).sum() for view in wrong] == [40] * 4


def test_specks_flip_as_many_pixels_on_the_object_as_beside_it(masks):
    specked, wrong = damage.add_specks(masks, 0.01, 0.2)
    for view in wrong:
        assert (masks[view] & ~specked[view]).sum() == 4
        assert (specked[view] & ~masks[view]).sum() == 4


def test_outlines_move_by_the_pixels_they_are_told(masks):
    # A square of 20 shrunk by 2 is one of 16; grown by 2 it gains four bars of 2 x 20, and at each
    # corner the pixels within 2 of it: 1 + 2 + (1, 1) = 3 and none further (2^2 + 1 > 4).
    assert damage.grow(masks, -2)[0][0].sum() == 16 * 16
    assert damage.grow(masks, 2)[0][0].sum() == 20 * 20 + 4 * 40 + 4 * 1
    assert not damage.grow(masks, -10)[0].any()


def test_full_masks_end_at_the_frame(masks):
    frames = np.tile([8, 0, 52, 60], (VIEWS, 1))
    full, wrong = damage.fill(masks, 0.1, frames=frames)
    assert [full[view].sum() for view in wrong] == [44 * 60] * 2


def test_a_shaken_camera_turns_about_its_centre_by_the_angle_told(cameras):
    shaken, wrong = damage.shake(cameras, 1.5, seed=2)
    assert wrong == list(range(VIEWS))
    torch.testing.assert_close(shaken.centres, cameras.centres)
    turn = shaken.R @ cameras.R.mT
    angle = torch.rad2deg(torch.arccos((turn.diagonal(dim1=1, dim2=2).sum(1) - 1) / 2))
    torch.testing.assert_close(angle, torch.full((VIEWS,), 1.5, dtype=torch.float64))
    torch.testing.assert_close(turn.det(), torch.ones(VIEWS, dtype=torch.float64))
    assert torch.equal(shaken.R, damage.shake(cameras, 1.5, seed=2)[0].R)


def test_a_wrong_camera_stands_where_another_one_does(cameras):
    placed, wrong = damage.misplace(cameras, 0.2)
    moved = (placed.centres - cameras.centres).norm(dim=1)
    assert np.flatnonzero(moved > 1e-9).tolist() == wrong
    assert len(wrong) == 4
    between = torch.cdist(placed.centres[wrong], cameras.centres)
    assert (between.min(dim=1).values < 1e-9).all()
    # Of twenty on a circle of radius 2.69 the further half is at least a quarter turn away.
    assert (moved[wrong] > 2.69).all()


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_the_frame_cuts_just_the_close_ups(masks, cameras, share):
    seen, nearer, frames, close = damage.close_up(masks, cameras, share, seed=1)
    assert frames.tolist() == [[7, 0, 52, 60]] * VIEWS  # 45 of 60 columns, as padding has them
    assert len(close) == round(share * VIEWS)
    assert np.flatnonzero(is_cut(seen, frames)).tolist() == close
    assert not seen[:, :, :7].any()
    assert not seen[:, :, 52:].any()
    # A world point is seen through both cameras at places that the silhouettes share.
    points = torch.rand(500, 3, generator=torch.manual_seed(0), dtype=torch.float64) - 0.5
    old, new = cameras.project(points), nearer.project(points)
    for view in range(VIEWS):
        u, v = new[view].T.floor().long()
        inside = (u >= 7) & (u < 52) & (v >= 0) & (v < 60)
        a, b = old[view].T.floor().long().clamp(0, SIZE - 1)
        agree = seen[view][v[inside], u[inside]] == masks[view][b[inside], a[inside]]
        assert agree.mean() > 0.9  # but for the rounding of pixels at outlines


def test_fewer_views_are_spread_evenly():
    assert damage.thin_out(36, 4) == [0, 9, 18, 27]
    assert damage.thin_out(10, 4) == [0, 2, 5, 7]


def test_all_masks_lose_the_same_rows_below(masks):
    cut = damage.cut_off(masks, 0.1)  # of the 39 rows from 10 to 48 that any mask has
    assert not cut[:, 44:].any()
    assert (cut[:, :44] == masks[:, :44]).all()


def test_the_plate_is_the_same_in_all_masks_and_below(masks):
    added = damage.put_on_plate(masks, 0.1) & ~masks
    plate = damage.put_on_plate(np.zeros_like(masks) | masks.any(axis=0), 0.1)
    assert added.any(axis=(1, 2)).all()
    assert not added[:, :42].any()
    assert (added <= plate).all()
