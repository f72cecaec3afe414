"""Several rounds about one axis are found as they were made, from silhouettes of an ellipsoid."""

import math

import numpy as np
import pytest
import torch
from scenes import names, silhouettes

from silmesh.cameras.calibrate import attempt_calibration, calibrate
from silmesh.cameras.silhouette_coherence import trace
from silmesh.cameras.turntable import HALF_ANGLE, orbit_cameras
from silmesh.cameras.turntable_residuals import NAMES, ROUND, ROW, Turntable, part_of
from silmesh.geometry.camera import Cameras
from silmesh.settings.turntable import parse_turntable

SIZE, DISTANCE = 96, 2.732
AXES, CENTRE = (0.3, 0.42, 0.16), (0.12, 0.04, 0.06)


def rounds_of(*specs: tuple[float, int, float, float]) -> Cameras:
    """Elevation, views, phase and factor of the distance of each round, a full turn."""
    elevation, azimuth, distance = [], [], []
    for raised, count, phase, factor in specs:
        elevation += [raised] * count
        azimuth += list(phase + 360 / count * np.arange(count))
        distance += [DISTANCE * factor] * count
    numbers = (torch.tensor(v, dtype=torch.float64) for v in (distance, elevation, azimuth))
    return orbit_cameras(names(len(azimuth)), SIZE, *numbers)


@pytest.fixture(scope="module")
def two():
    """Fourteen views from 5 degrees and ten from 40, from a little further away."""
    cameras = rounds_of((5, 14, 0, 1), (40, 10, 75, 1.08))
    return cameras, silhouettes(cameras, AXES, CENTRE)


@pytest.fixture(scope="module")
def found(two):
    cameras, seen = two
    return calibrate(seen, cameras.views)


def turn_of(seen) -> Turntable:
    outlines = trace(seen, 48, [str(i) for i in range(len(seen))])
    return Turntable(outlines, SIZE, rounds=[np.arange(14), np.arange(14, 24)])


def truth_of(turn: Turntable) -> np.ndarray:
    """Parameters that are those of the fixture; the world's unit is the turntable's."""
    turn.row = SIZE / 2
    log_tan = math.log(math.tan(math.radians(HALF_ANGLE)))
    first = [5, 0, SIZE / 2, log_tan, 360 / 14]
    second = [40, 0, SIZE / 2, SIZE / 2, math.log(1.08), 75, 36]
    return turn.widen(np.array([*first, *second], dtype=float))


def test_parameters_of_rounds_give_the_cameras(two):
    cameras, seen = two
    turn = turn_of(seen)
    x = truth_of(turn)
    K, R, t = turn.camera(x)
    scale = t[0, 2] / DISTANCE  # of units
    assert np.abs(R - cameras.R.numpy()).max() < 1e-12
    assert np.abs(t / scale - cameras.t.numpy()).max() < 1e-9
    assert np.abs(K - cameras.K[0].numpy()).max() < 1e-9
    assert np.sqrt((turn.misses(x).pixels ** 2).mean()) < 0.3


def test_a_part_of_the_views_has_the_same_cameras(two):
    turn = turn_of(two[1])
    x = truth_of(turn)
    part = turn.select(np.array([2, 9, 15, 22]))
    _, R, t = part.camera(part.widen(x))
    assert np.array_equal(R, turn.camera(x)[1][[2, 9, 15, 22]])
    assert np.array_equal(t, turn.camera(x)[2][[2, 9, 15, 22]])


def test_the_row_of_a_round_has_the_derivative_of_its_differences(two):
    turn = turn_of(two[1])
    x, row = truth_of(turn), part_of(1).start + ROW
    assert turn.shared == len(NAMES) + len(ROUND)
    x[row] += 1.5
    slopes = turn.slopes(x, turn.misses(x))[..., row]
    step = 0.1 * np.eye(len(x))[row]
    differences = (turn.misses(x + step).pixels - turn.misses(x - step).pixels) / 0.2
    assert np.corrcoef(slopes.ravel(), differences.ravel())[0, 1] > 0.9


def test_the_mirror_image_of_the_mirror_image_is_the_turntable(two):
    turn = turn_of(two[1])
    x = truth_of(turn)
    twin = turn.mirrored(x)
    first, second = turn.parameters_of(twin, 0), turn.parameters_of(twin, 1)
    assert (first[0], second[0], second[5], second[6]) == (-5, -40, -75, -36)
    assert np.array_equal(turn.mirrored(twin), x)


@pytest.mark.slow
def test_two_rounds_are_found_where_one_does_not_explain_them(two, found):
    cameras, _ = two
    low, high = found.rounds
    assert (len(low.views), len(high.views)) == (14, 10)
    assert low.estimates["elevation"].value == pytest.approx(5, abs=1)
    assert high.estimates["elevation"].value == pytest.approx(40, abs=1)
    assert not found.disagreeing
    assert found.rms < 0.4
    assert "2 rounds, told by their silhouettes: 'v0' to 'v13' (14 views" in found.warnings[0]
    turned = found.cameras.R @ found.cameras.R[:1].mT  # by what the first view was turned
    true = cameras.R @ cameras.R[:1].mT
    cosine = ((turned @ true.mT).diagonal(dim1=1, dim2=2).sum(1) - 1) / 2
    assert torch.rad2deg(torch.arccos(cosine.clip(-1, 1))).max() < 2


@pytest.mark.slow
def test_wrong_silhouettes_of_a_round_are_named(two):
    cameras, seen = two
    wrong = seen.copy()
    wrong[[3, 8], :, : SIZE // 2] = False
    attempt = attempt_calibration(
        wrong, cameras.views, rounds=parse_turntable(",5,,14;,40,,10").rounds
    )
    assert set(attempt.figures["disagreeing"]) == {"v3", "v8"}
    assert [one["estimates"]["elevation"]["status"] for one in attempt.figures["rounds"]] == [
        "given",
        "given",
    ]
    assert attempt.figures["rounds_because"] == "as given"


def test_rounds_that_are_not_there_are_refused_at_once(two):
    cameras, seen = two
    attempt = attempt_calibration(
        seen, cameras.views, rounds=parse_turntable(",5,,8;,20,,8;,40,,9").rounds
    )
    assert "25 in all, but there are 24" in attempt.refusal
