"""When a turntable is not sought because other cameras show that there was none."""

import numpy as np
import pytest
from scenes import names, orbit, silhouettes, turntable

from silmesh.cameras.attempt import Attempt
from silmesh.scene.agreement import refuse_incoherent
from silmesh.scene.sparing import spare, spare_turntable

SIZE, COUNT, WRONG = 128, 16, 4


def judge(cameras, wrong=WRONG):
    """Right cameras, before silhouettes of which the first ``wrong`` hold a part of the table."""
    seen = silhouettes(cameras, [0.45, 0.2, 0.15], [0.05, 0.1, 0])
    seen[:wrong, 80:110, 10:118] = True
    return refuse_incoherent(Attempt("colmap", cameras), seen)


@pytest.fixture(scope="module")
def walk():
    """A camera in a hand: even steps around the object, up and down by a few degrees."""
    height = np.random.default_rng(0).normal(20, 4, COUNT)
    return orbit(COUNT, SIZE, height)


def test_a_turntable_is_not_sought_where_the_camera_walked(walk):
    attempt = judge(walk)
    assert attempt.figures["contradicted"] == names(COUNT)[:WRONG]
    assert attempt.figures["coherence"] < 0.9 < 0.97 < attempt.figures["coherence_uncontradicted"]
    assert spare("calibrate", [attempt], COUNT) is None
    spared = spare_turntable("calibrate", [attempt], COUNT)
    assert spared.cameras is None
    assert "by 'colmap' 12 of 16 views agree" in spared.refusal
    assert "their turns leave one axis by" in spared.refusal


def test_it_is_sought_where_most_views_took_turns_about_one_axis():
    attempt = judge(turntable(COUNT, SIZE, elevation=20))
    assert len(attempt.figures["contradicted"]) == WRONG
    assert spare_turntable("calibrate", [attempt], COUNT) is None


def test_it_is_sought_where_half_of_the_views_contradict_the_cameras(walk):
    attempt = judge(walk, wrong=COUNT // 2)
    assert spare_turntable("calibrate", [attempt], COUNT) is None


def test_it_is_sought_where_a_view_has_no_camera(walk):
    assert spare_turntable("calibrate", [judge(walk)], COUNT + 1) is None


def test_it_is_sought_where_cameras_were_refused():
    refused = Attempt("colmap", None, refusal="no two photographs match")
    assert spare_turntable("calibrate", [refused], COUNT) is None
