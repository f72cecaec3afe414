"""When a turntable is not sought because other cameras show that there was none."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scenes import names, orbit, silhouettes, turntable
from scipy.spatial.transform import Rotation

from silmesh.cameras.attempt import Attempt
from silmesh.scene.agreement import refuse_incoherent
from silmesh.scene.sparing import ONE_AXIS, measure_swerve, spare, spare_turntable

SIZE, COUNT, WRONG = 128, 24, 6


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
    assert "by 'colmap' 18 of 24 views agree" in spared.refusal
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


def test_it_is_sought_where_a_person_names_one(walk):
    assert spare_turntable("calibrate", [judge(walk)], COUNT, named=True) is None


def test_a_walk_leaves_its_axes_by_what_it_goes_up_and_down():
    """From view to view up by 3 degrees and down again: the axis tilts to and fro."""
    height = 20 + 3.0 * (np.arange(COUNT) // 2 % 2)
    assert measure_swerve(orbit(COUNT, SIZE, height)) > 2


def test_noise_of_a_turntable_is_no_swerve():
    cameras = turntable(36, SIZE, elevation=30)
    noise = Rotation.from_rotvec(np.random.default_rng(1).normal(0, 0.2, (36, 3)), degrees=True)
    R = torch.as_tensor(noise.as_matrix()) @ cameras.R
    assert 0 < measure_swerve(replace(cameras, R=R)) < ONE_AXIS


def test_an_object_that_was_turned_over_turned_about_one_axis_each_time():
    cameras = turntable(12, SIZE, elevation=30)
    over = torch.as_tensor(Rotation.from_euler("x", 90, degrees=True).as_matrix())
    R = torch.cat([cameras.R, cameras.R @ over])
    both = replace(cameras.select([*range(12)] * 2), R=R, views=tuple(names(24)))
    assert measure_swerve(both) < 0.01


def test_two_rounds_taken_by_turns_turn_about_one_axis():
    assert measure_swerve(orbit(36, SIZE, 10 + 30.0 * (np.arange(36) % 2))) < 0.01


def test_too_few_views_in_a_row_tell_nothing(walk):
    assert measure_swerve(walk) > ONE_AXIS
    assert measure_swerve(walk, walk.views[::3]) == 0
    assert measure_swerve(walk.select(range(13))) == 0  # of either half six views or seven
