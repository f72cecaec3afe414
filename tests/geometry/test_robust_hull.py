"""Of an ellipsoid, whose volume and outlines are formulas, and masks damaged by hand."""

import numpy as np
import pytest
import torch
import trimesh
from scenes import dome, silhouettes, turntable

from silmesh.geometry import robust_hull
from silmesh.geometry.robust_hull import (
    explains,
    find_uncovered,
    predict_held_out,
    robust_carve,
)
from silmesh.geometry.visual_hull import carve

AXES, CENTRE = (0.3, 0.4, 0.2), (0.05, -0.03, 0.02)
VOLUME = 4 / 3 * np.pi * np.prod(AXES)
SIZE = 96


@pytest.fixture(scope="module")
def egg():
    cameras = dome(24, SIZE)
    return cameras, silhouettes(cameras, AXES, CENTRE)


def volume(hull):
    return trimesh.Trimesh(*hull.surface(), process=False).volume


def bite(silhouette, share=0.15):
    """Without the so many of its pixels that are nearest to its leftmost one."""
    bitten = silhouette.copy()
    pixels = np.argwhere(silhouette)
    first = pixels[pixels[:, 1].argmin()]
    nearest = ((pixels - first) ** 2).sum(axis=1).argsort()[: round(share * len(pixels))]
    bitten[tuple(pixels[nearest].T)] = False
    return bitten


def test_of_sound_silhouettes_it_is_the_exact_hull(egg):
    cameras, seen = egg
    found = robust_carve(seen, cameras, resolution=64)
    np.testing.assert_array_equal(found.hull.field, carve(seen, cameras, 64).field)
    assert found.explained
    assert (found.reliability == 1).all()
    assert not found.disbelieved.any()
    assert found.distrusted == found.corrected == []
    np.testing.assert_array_equal(found.believed(seen, cameras)[0], seen)


def test_bites_are_filled_and_named(egg):
    cameras, seen = egg
    wrong, damaged = [2, 9, 10, 17, 20], seen.copy()
    damaged[wrong] = [bite(seen[i]) for i in wrong]
    strict = volume(carve(damaged, cameras, 64))
    found = robust_carve(damaged, cameras, resolution=64)
    assert strict < 0.8 * VOLUME
    assert volume(found.hull) == pytest.approx(VOLUME, rel=0.05)
    assert volume(found.hull) == pytest.approx(volume(carve(seen, cameras, 64)), rel=0.01)
    assert found.corrected == wrong
    assert found.distrusted == []
    lacking = seen & ~damaged
    assert (found.disbelieved & lacking).sum() > 0.95 * lacking.sum()
    assert not (found.disbelieved & damaged).any()
    assert (found.reliability[wrong] < 0.9).all()
    assert (np.delete(found.reliability, wrong) > 0.97).all()


@pytest.mark.parametrize("wrong", [[1, 3, 4, 5, 16], [0, 11, 13, 16, 18], [11, 14, 19, 21, 22]])
def test_of_two_bites_of_which_either_explains_a_loss_both_are_found(egg, wrong):
    """Judged all at once neither is blamed while both are filled, and sound views are accused."""
    cameras, seen = egg
    damaged = seen.copy()
    damaged[wrong] = [bite(seen[i], 0.08) for i in wrong]
    found = robust_carve(damaged, cameras, resolution=64)
    assert found.corrected == wrong
    assert not (found.disbelieved & damaged).any()
    assert volume(found.hull) == pytest.approx(volume(carve(seen, cameras, 64)), rel=0.01)


def test_silhouettes_that_are_wholly_wrong_lose_their_weight(egg):
    cameras, seen = egg
    damaged = seen.copy()
    damaged[3], damaged[8] = False, True
    damaged[15] = silhouettes(cameras, [0.1, 0.1, 0.45], [-0.2, 0.2, 0])[15]
    assert carve(damaged, cameras, 48).empty
    found = robust_carve(damaged, cameras, resolution=64)
    assert found.distrusted == [3, 8, 15]
    assert found.corrected == []
    assert found.disbelieved[[3, 8, 15]].all()
    believed, kept, frames = found.believed(damaged, cameras)
    assert kept.views == tuple(v for i, v in enumerate(cameras.views) if i not in (3, 8, 15))
    np.testing.assert_array_equal(believed, np.delete(seen, [3, 8, 15], axis=0))
    assert frames.tolist() == [[0, 0, SIZE, SIZE]] * 21
    assert volume(found.hull) == pytest.approx(VOLUME, rel=0.06)


def test_a_blob_beside_the_object_is_not_believed(egg):
    cameras, seen = egg
    damaged = seen.copy()
    free = np.s_[4:20, 4:20]
    assert not seen[6][free].any()
    damaged[6][free] = True
    found = robust_carve(damaged, cameras, resolution=64)
    assert found.corrected == [6]
    assert found.disbelieved[6][free].all()
    assert not (found.disbelieved[6] & seen[6]).any()
    assert volume(found.hull) == pytest.approx(volume(carve(seen, cameras, 64)), rel=0.01)


def test_what_one_view_rightly_cuts_off_alone_is_not_filled(egg):
    """A tunnel through which only one view looks: no other silhouette loses a pixel by it."""
    cameras, seen = egg
    rows, columns = np.indices((SIZE, SIZE))
    middle = np.argwhere(seen[2]).mean(axis=0)
    tunnel = np.hypot(rows - middle[0], columns - middle[1]) < 4
    damaged = seen.copy()
    damaged[2] &= ~tunnel
    damaged[9] = bite(seen[9])
    found = robust_carve(damaged, cameras, resolution=64)
    assert found.corrected == [9]
    filled = robust_carve(np.where(np.arange(24)[:, None, None] == 2, seen, damaged), cameras)
    assert volume(found.hull) < 0.985 * volume(filled.hull)


def test_few_views_are_left_as_they_are():
    cameras = turntable(5, SIZE)
    seen = silhouettes(cameras, [0.2] * 3)
    seen[3] = np.roll(seen[3], 45, axis=0)
    found = robust_carve(seen, cameras, resolution=32)
    assert found.hull.empty
    assert not found.explained
    assert (found.reliability == 1).all()


def test_the_frame_of_a_photograph_denies_nothing(egg):
    """What lies beyond the photograph is no bite, and tells nothing of what other views deny."""
    cameras, seen = egg
    frames = np.tile([0, 0, SIZE, SIZE], (24, 1))
    cut, damaged = [1, 5, 12], seen.copy()
    for i in cut:
        middle = int(np.flatnonzero(seen[i].any(axis=0)).mean()) + 8
        frames[i, 2] = middle
        damaged[i, :, middle:] = False
    damaged[7] = bite(seen[7])
    found = robust_carve(damaged, cameras, frames, resolution=48)
    assert found.corrected == [7]
    assert (found.reliability[cut] > 0.97).all()
    assert volume(found.hull) == pytest.approx(VOLUME, rel=0.08)


def test_it_is_the_same_for_any_number_of_threads(egg):
    cameras, seen = egg
    damaged = seen.copy()
    damaged[4], damaged[11] = False, bite(seen[11])
    found = []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        found.append(robust_carve(damaged, cameras, resolution=32))
    np.testing.assert_array_equal(found[0].hull.field, found[1].hull.field)
    np.testing.assert_array_equal(found[0].disbelieved, found[1].disbelieved)


def test_what_a_hull_leaves_uncovered(egg):
    """By hand: a silhouette of twice the hull's pixels is covered by half."""
    cameras, seen = egg
    hull = carve(seen, cameras)
    assert find_uncovered(hull, seen, cameras).max() < 0.01
    wider = seen.copy()
    wider[0] |= np.roll(seen[0], 1 + np.ptp(np.flatnonzero(seen[0].any(axis=0))), axis=1)
    assert wider[0].sum() == 2 * seen[0].sum()
    assert find_uncovered(hull, wider, cameras)[0] == pytest.approx(0.5, abs=0.05)
    assert explains(hull, seen, cameras)
    assert not explains(hull, wider, cameras)


def test_of_noise_no_view_is_judged(egg, monkeypatch):
    def refuse(*args):
        raise AssertionError("bites are sought although no views agree")

    monkeypatch.setattr(robust_hull, "_find_bites", refuse)
    noise = np.random.default_rng(5).random(egg[1].shape) < 0.1
    found = robust_carve(noise, egg[0], resolution=64)
    assert not found.explained
    assert found.distrusted == found.corrected == []


def test_held_out_silhouettes_are_predicted_by_the_others(egg):
    cameras, seen = egg
    damaged = seen.copy()
    damaged[7] = np.roll(seen[7], 40, axis=1)
    assert predict_held_out(seen, cameras).min() > 0.9
    assert predict_held_out(damaged, cameras)[7] < 0.3
