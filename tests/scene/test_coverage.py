import numpy as np

from silmesh.scene.coverage import keep_outline, undo_shaving

OBJECT, GROUND = (200, 40, 40), (60, 120, 60)


def square(left, top, right, bottom):
    region = np.zeros((40, 40), bool)
    region[top:bottom, left:right] = True
    return region


def paint(region):
    return np.where(region[..., None], OBJECT, GROUND).astype(np.uint8)


def test_a_strip_that_was_shaved_off_comes_back_and_one_that_was_added_goes():
    truth = square(10, 10, 30, 30)
    shifted = square(12, 10, 32, 30)
    np.testing.assert_array_equal(undo_shaving(truth, shifted, paint(truth)), truth)


def test_what_the_colours_uphold_stays_changed():
    truth = square(10, 10, 30, 30)
    found = square(12, 10, 32, 30)
    np.testing.assert_array_equal(undo_shaving(found, truth, paint(truth)), truth)


def test_a_part_too_thick_to_tell_and_colours_that_are_alike_decide_nothing():
    truth = square(4, 4, 36, 36)
    half = square(4, 4, 18, 36)
    np.testing.assert_array_equal(undo_shaving(truth, half, paint(truth)), half)
    grey = np.full((40, 40, 3), 128, np.uint8)
    shaved = square(6, 4, 36, 36)
    np.testing.assert_array_equal(undo_shaving(truth, shaved, grey), shaved)


def test_an_empty_region_becomes_what_it_becomes():
    truth, nothing = square(10, 10, 30, 30), np.zeros((40, 40), bool)
    np.testing.assert_array_equal(undo_shaving(nothing, truth, paint(truth)), truth)
    np.testing.assert_array_equal(undo_shaving(truth, nothing, paint(truth)), nothing)


def test_an_outline_that_moved_by_a_pixel_stays_and_what_was_lost_comes_back():
    truth = square(10, 10, 30, 30)
    bitten = truth & ~square(24, 10, 30, 16)
    np.testing.assert_array_equal(keep_outline(bitten, square(11, 10, 30, 29)), truth)


def test_a_limb_as_thin_as_a_pixel_comes_back_and_goes():
    truth = square(10, 10, 30, 30) | square(30, 20, 38, 21)
    body = square(10, 10, 30, 30)
    np.testing.assert_array_equal(keep_outline(body, truth), truth)
    np.testing.assert_array_equal(keep_outline(truth, body), body)
