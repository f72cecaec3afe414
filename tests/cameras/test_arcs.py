"""Outlines whose lower arcs are all wrong: the elevation and the axis that they were made with."""

from dataclasses import replace
from functools import partial

import damage
import numpy as np
import pytest
import torch
from scenes import names, silhouettes

from silmesh.cameras.arcs import ARCS, CUT, find_without_arcs, leave_out
from silmesh.cameras.calibrate import Calibration, Estimate, calibrate
from silmesh.cameras.turntable import orbit_cameras
from silmesh.errors import InputError
from silmesh.progress import untold

COUNT, SIZE, ELEVATION = 24, 96, 20.0


def body(seed: int) -> np.ndarray:
    """Four ellipsoids in one, turning before a camera whose axis is the image's middle."""
    rng = np.random.default_rng(seed)
    azimuth = torch.tensor([40 + 360 * i / COUNT for i in range(COUNT)]).double()
    far, raised = (torch.full((COUNT,), v).double() for v in (2.732, ELEVATION))
    cameras = orbit_cameras(names(COUNT), SIZE, far, raised, azimuth)
    parts = [
        silhouettes(cameras, rng.uniform(0.1, 0.3, 3), rng.uniform(-0.2, 0.2, 3)) for _ in range(4)
    ]
    return np.any(parts, axis=0)


@pytest.mark.slow
@pytest.mark.parametrize("spoil", [damage.cut_off, damage.put_on_plate])
def test_a_turntable_is_found_though_the_lower_arcs_of_all_outlines_are_wrong(spoil):
    found = find_without_arcs(calibrate, spoil(body(2)), names(COUNT), step=360 / COUNT)
    assert abs(found.estimates["elevation"].value - ELEVATION) < 1
    assert abs(found.estimates["axis"].value - SIZE / 2) < 0.5
    assert any("lower arcs of the outlines contradict the rest" in w for w in found.warnings)


def result(rms: float, disagreeing: int = 0, *warnings: str) -> Calibration:
    wrong = {f"v{i}": "wrong" for i in range(disagreeing)}
    return Calibration(None, {}, 0.0, True, "open", rms, np.zeros(0), wrong, np.zeros(0), warnings)


def asked(whole, lower, upper):
    """A calibration that gives these or, where they are None, refuses; and what it was asked."""
    seen, calls = np.zeros((10, 64, 64), bool), []
    seen[:, 10:30, 20:40] = True

    def fake(silhouettes, views, frames=None, guess=True, progress=untold):
        progress(0.5)
        progress(1)
        assert guess == (not calls)  # two guesses at once are too many
        calls.append(frames)
        found = {1: whole, 2: lower, 3: upper}[len(calls)]
        if found is None:
            raise InputError(f"refused {len(calls)}")
        return found

    return partial(find_without_arcs, fake, seen, names(10)), calls


@pytest.mark.parametrize("whole", [result(0.1), result(0.6), None])
def test_the_progress_never_goes_back(whole):
    told = []
    asked(whole, result(0.1), result(0.5))[0](progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1


def test_outlines_that_agree_are_believed_whole():
    clean = result(0.1)
    run, calls = asked(clean, None, None)
    assert run() is clean
    assert calls == [None]


def test_the_arc_without_which_the_rest_agrees_is_left_out():
    run, calls = asked(result(0.6), result(0.1, 0, f"{CUT} 10 of 10 views"), result(0.5))
    found = run()
    assert found.rms == 0.1
    assert len(found.warnings) == 1  # that the frame cuts is said of frames alone
    assert found.warnings[0].startswith("the lower arcs")
    depth = round(20 * ARCS["lower"])
    assert calls[1].tolist() == [[0, 0, 64, 30 - depth]] * 10
    assert calls[2].tolist() == [[0, 10 + depth, 64, 64]] * 10


def test_views_that_disagree_are_no_reason_if_they_still_do_without_an_arc():
    whole = result(0.4, 4)
    run, calls = asked(whole, result(0.2, 5), result(0.2, 5))
    assert run() is whole
    assert len(calls) == 3


def test_cameras_that_nothing_shows_are_not_believed():
    whole, empty = result(0.6), replace(result(0.0), estimates={"roll": Estimate(4.6, 3, "open")})
    assert asked(whole, empty, result(0.5))[0]() is whole
    assert asked(whole, replace(empty, rms=0.1), result(0.5))[0]() is whole
    assert asked(whole, replace(empty, rms=0.1, estimates={}), result(0.5))[0]().rms == 0.1


def test_nothing_is_asked_of_views_that_cannot_agree_better():
    whole = result(0.1, 4)
    run, calls = asked(whole, None, None)
    assert run() is whole
    assert calls == [None]


def test_outlines_that_agree_better_without_either_arc_are_believed_whole():
    whole = result(0.6)
    assert asked(whole, result(0.2), result(0.2))[0]() is whole
    assert asked(whole, result(0.2), result(0.4))[0]().rms == 0.2


def test_what_whole_outlines_refuse_may_be_found_without_an_arc():
    assert asked(None, None, result(0.1))[0]().warnings[0].startswith("the upper arcs")
    with pytest.raises(InputError, match="refused 1"):
        asked(None, None, result(0.9))[0]()


def test_the_photographs_own_frames_stay():
    seen = np.zeros((2, 64, 64), bool)
    seen[0, 10:30] = True
    left = leave_out("lower", seen, np.array([[8, 0, 56, 20], [8, 0, 56, 64]]))
    assert left.tolist() == [[8, 0, 56, 20], [8, 0, 56, 64]]
