"""Of an ellipsoid, whose silhouettes are formulas, before cameras turned by known angles."""

import numpy as np
import pytest
from scenes import dome, silhouettes

from silmesh.cameras.directions import measure_turns, turn, turn_to_agree
from silmesh.geometry.camera import Similarity
from silmesh.scene.agreement import normalise
from silmesh.scene.reorientation import Reoriented, reorient, say_open

SIZE, AXES, CENTRE = 64, (0.3, 0.4, 0.2), (0.05, -0.03, 0.02)


@pytest.fixture(scope="module")
def egg():
    cameras = dome(16, SIZE)
    return cameras, silhouettes(cameras, AXES, CENTRE)


def shake(cameras, degrees, seed=3):
    """Turn each camera by so many degrees about another axis through its centre."""
    axes = np.random.default_rng(seed).standard_normal((len(cameras), 3))
    return turn(cameras, np.radians(degrees) * axes / np.linalg.norm(axes, axis=1, keepdims=True))


def aim(cameras, others):
    """By how many degrees two cameras of a view look in other directions: roll is none."""
    cosine = (cameras.R[:, 2] * others.R[:, 2]).sum(dim=1).clamp(-1, 1)
    return np.degrees(np.arccos(cosine.numpy()))


def test_a_turn_leaves_the_centre_and_is_measured(egg):
    shaken = shake(egg[0], 2)
    np.testing.assert_allclose(shaken.centres, egg[0].centres, atol=1e-12)
    np.testing.assert_allclose(measure_turns(egg[0], shaken), 2, rtol=1e-6)


def test_shaken_cameras_turn_back_and_their_mean_stays(egg):
    cameras, seen = egg
    shaken = shake(cameras, 2)
    turned = turn_to_agree(seen, shaken)
    np.testing.assert_allclose(turned.centres, cameras.centres, atol=1e-12)
    assert np.median(aim(shaken, cameras)) > 1.2
    assert np.median(aim(turned, cameras)) < 0.5
    between = turned.R @ shaken.R.mT  # cos and sines of small turns, whose mean is none
    mean = np.degrees(np.array([between[:, i, j].mean() for i, j in ((2, 1), (0, 2), (1, 0))]))
    assert np.abs(mean).max() < 0.4


def test_shaken_cameras_are_told_and_become_coherent(egg):
    cameras, seen = egg
    found = normalise(shake(cameras, 2), seen)
    turned = reorient(found, seen)
    again, said = turned.found, turned.said
    assert found.overall < 0.9 < 0.97 < again.overall
    assert said.startswith("the cameras contradict all silhouettes a little: each was turned")
    assert f"hull IoU {found.overall:.2f} before, {again.overall:.2f} now" in said
    assert again.undistorted is found.undistorted


@pytest.mark.parametrize("turned", [0, 0.05])
def test_coherent_cameras_stay_as_they_are(egg, turned):
    found = normalise(shake(egg[0], turned), egg[1])
    assert reorient(found, egg[1]) == Reoriented(found)


def test_cameras_of_other_silhouettes_are_not_turned(egg):
    cameras, seen = egg
    wrong = silhouettes(cameras, (0.1, 0.1, 0.45), (-0.15, 0.2, 0))
    mixed = np.where((np.arange(16) % 2 == 0)[:, None, None], seen, wrong)
    found = normalise(cameras, mixed)
    assert found.overall < 0.8
    assert reorient(found, mixed) == Reoriented(found)


def test_far_too_large_turns_are_not_taken(egg):
    cameras, seen = egg
    found = normalise(shake(cameras, 20), seen)
    assert reorient(found, seen).said == ""


def test_a_long_lens_leaves_open_where_the_object_stands():
    seen = np.zeros((16, 64, 64), bool)
    seen[:, 20:40, 20:40] = True
    turns = np.full(16, 2.0)  # a focal length of 200 pixels: 6.98 each, sqrt(2/3) / 4 of it in all
    said = say_open(turns, 200, seen)
    assert "by about 1.4 pixels or 7% of its size" in said
    assert say_open(turns, 100, seen) == ""  # 3.6 %


def test_the_world_is_normalised_anew_and_the_way_back_stays(egg):
    cameras, seen = egg
    own = shake(cameras, 2).in_world_of(Similarity(cameras.centres[0], 3.0))
    again = reorient(normalise(own, seen), seen).found
    back = again.cameras.in_world_of(again.similarity.inverse)
    np.testing.assert_allclose(back.centres, own.centres, atol=1e-9)
