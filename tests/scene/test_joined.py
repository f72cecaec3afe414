"""Sets are joined by their silhouettes, or refused with what was measured."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from turned_over import BODY, COUNT, ROD, SIZE, Q, ring, show, turn_over

from silmesh.cameras.attempt import Attempt
from silmesh.scene.calibrated_sets import calibrate_sets
from silmesh.scene.joined import join_attempts
from silmesh.views import place_view

FIRST, SECOND = ring("a", 20.0), ring("b", 35.0)
NAMES = [*FIRST.views, *SECOND.views]
VIEWS = [place_view(name, "", SIZE, SIZE, SIZE, "pad") for name in NAMES]


def join(body, other):
    """The attempt that comes of two sets of bodies, each with its true cameras."""
    seen = np.concatenate([show(FIRST, body), show(turn_over(SECOND), other)])
    attempts = [
        Attempt("calibrate", cameras, dropped={}, warnings=(f"of {cameras.views[0]}",))
        for cameras in (FIRST, SECOND)
    ]
    return join_attempts(attempts, VIEWS, seen)


@pytest.mark.slow
def test_sets_of_one_body_are_joined():
    attempt = join(BODY, BODY)
    assert attempt.refusal is None
    assert attempt.cameras.views == tuple(NAMES)
    (one,) = attempt.figures["joins"]
    off = Rotation.from_matrix(np.array(one["rotation"]).T @ Q).magnitude()
    assert np.degrees(off) < 1.5
    assert one["coherence"] > 0.95
    assert one["coherence"] > one["runner_up"]["coherence"] + 0.02
    assert (one["by"], one["ambiguous"]) == ("silhouettes", False)
    assert attempt.figures["sets"] == [list(FIRST.views), list(SECOND.views)]
    assert attempt.warnings[:2] == ("of a0", "of b0")
    assert "'b0' to 'b9' were joined to" in attempt.warnings[2]


@pytest.mark.slow
def test_sets_of_two_bodies_are_refused():
    attempt = join(BODY, ((ROD, (0, 0, 0)),))
    assert attempt.cameras is None
    assert "do not join: at best, of all rotations" in attempt.refusal
    filled, least, *alone = map(float, re.findall(r"0\.\d{3}", attempt.refusal))
    assert filled < least
    assert least == pytest.approx(1 - 2 * (1 - min(alone)) - 0.02, abs=2e-3)


@pytest.mark.slow
def test_a_body_of_revolution_is_said_to_be_ambiguous():
    egg = (((0.2, 0.4, 0.2), (0, 0.05, 0)), ((0.28, 0.1, 0.28), (0, -0.1, 0)))
    attempt = join(egg, egg)
    (one,) = attempt.figures["joins"]
    assert one["ambiguous"]
    assert one["revolution"]
    assert "of a body of revolution" in attempt.warnings[-1]


def test_a_set_of_three_views_is_refused():
    seen = show(FIRST)
    attempt = calibrate_sets(seen, VIEWS[:COUNT], [NAMES[:3], NAMES[3:COUNT]])
    assert attempt.cameras is None
    assert "the set 'a0' to 'a2' (3 views) is too short: a set that" in attempt.refusal
