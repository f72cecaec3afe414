"""What the stress benchmark is asked for, and what it counts."""

from argparse import ArgumentTypeError
from dataclasses import replace

import pytest
from stress import (
    INSIDE,
    count_named,
    measure_inside,
    measure_mesh,
    measure_turntable,
    parse_damage,
    shift_to_truth,
)
from stress_cases import DAMAGES, damage_case, make_clean


@pytest.fixture(scope="module")
def clean():
    """An apricot, seen from six sides."""
    return make_clean("apricot", 6, 48, ring=False)


def test_damages_are_asked_for_by_kind_or_strength():
    assert parse_damage("bite=0.1,0.3") == [("bite", (0.1, 0.3))]
    assert parse_damage("empty") == [("empty", strength) for strength in DAMAGES["empty"][1]]
    for wrong in ("bites", "bite=0.1"):
        with pytest.raises(ArgumentTypeError):
            parse_damage(wrong)


def test_the_truth_itself_measures_as_perfect(clean):
    told = measure_mesh(clean, clean.truth, calibrated=False)
    assert told["iou"] > 0.99  # another renderer made the masks
    assert told["volume_iou"] == 1
    assert told["pieces"] == 1


def test_a_mesh_that_is_only_shifted_is_as_good_where_it_is_laid_back(clean):
    shaken = damage_case(clean, "shaken", (1.0,), seed=0)
    away = clean.truth.copy().apply_translation([0.04, -0.03, 0.05])
    told = measure_mesh(shaken, away, calibrated=False)
    assert told["iou"] < 0.9
    assert told["iou_shifted"] > 0.99
    laid = shift_to_truth(shaken, away)
    assert laid.vertices.mean(axis=0) == pytest.approx(clean.truth.vertices.mean(axis=0), abs=5e-3)
    assert "iou_shifted" not in measure_mesh(clean, away, calibrated=False)


def test_few_silhouettes_fit_a_body_that_the_others_do_not(clean):
    """Of two views from one side: a body that is far too deep fills them."""
    few = damage_case(clean, "views", (2,), seed=0)
    told = measure_inside(few, "hull", steps=20)
    assert told["iou"] > 0.98
    assert told["iou_unseen"] < 0.95
    true = measure_mesh(few, few.truth, calibrated=False)
    assert true["iou_unseen"] > 0.99
    assert "iou_unseen" not in measure_mesh(clean, clean.truth, calibrated=False)


@pytest.mark.parametrize("method", INSIDE)
@pytest.mark.parametrize("damage", [("clean", ()), ("cut", (0.3,)), ("empty", (0.3,))])
def test_simpler_ways_bear_frames_and_empty_masks(clean, method, damage):
    told = measure_inside(damage_case(clean, *damage, seed=0), method, steps=20)
    assert told["verdict"] == "made"
    assert told["iou"] > 0.8


def test_recall_and_false_alarms_are_shares_of_wrong_and_right_views(clean):
    views = clean.cameras.views
    told = count_named(replace(clean, wrong=(0, 1)), [views[1], views[2]])
    assert told == {"recall": 1 / 2, "false_alarms": 1 / 4}
    assert count_named(clean, [])["recall"] is None


def test_a_turntable_is_compared_with_the_true_axis_and_elevation():
    ring = make_clean("apricot", 6, 48, ring=True)  # from 10 degrees, the axis in the middle
    told = measure_turntable(ring, {"axis": 24.5, "row": 10.0, "elevation": 8.0})
    assert told == pytest.approx({"axis_off": 0.5, "elevation_off": 2.0})
