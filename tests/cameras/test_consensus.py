"""Views that disagree with a turntable are told from those that agree."""

import numpy as np
import pytest
from scenes import silhouettes, turntable

from silmesh.cameras.consensus import SAMPLES, find_consensus, judge, suspect, thin_out
from silmesh.cameras.silhouette_coherence import trace
from silmesh.cameras.turntable_residuals import Turntable

COUNT, SIZE = 16, 96
AXES, CENTRE = [0.45, 0.2, 0.15], [0.05, 0.1, 0.1]


@pytest.fixture(scope="module")
def ring():
    """A turntable seen from 15 degrees above, and parameters that are its own."""
    cameras = turntable(COUNT, SIZE, elevation=15)
    seen = silhouettes(cameras, AXES, CENTRE)
    K = cameras.K[0]
    log_tan = float(np.log(SIZE / 2 / float(K[0, 0])))
    return seen, np.array([15.0, 0, SIZE / 2, log_tan, 360 / COUNT])


def turn_of(seen):
    turn = Turntable(trace(seen, 48, [str(i) for i in range(COUNT)]), SIZE)
    turn.row = SIZE / 2  # where the true axis meets the middle of the image
    return turn


def test_all_views_agree_with_true_cameras(ring):
    seen, x = ring
    found = judge(turn_of(seen), x, np.arange(COUNT), 2.0, trusting=True)
    assert found.agrees.all()
    assert found.pixels.max() < 0.5


@pytest.mark.parametrize("trusting", [False, True])
def test_what_a_view_lacks_and_what_it_adds_is_measured_in_pixels(ring, trusting):
    seen, x = ring
    wrong = seen.copy()
    middle = np.nonzero(seen[4])[1].mean()
    wrong[4, :, : int(middle)] = False  # the left half is lacking
    wrong[11] = np.roll(seen[11], 6, axis=0)  # six pixels too low
    others = np.delete(np.arange(COUNT), [4, 11])
    found = judge(turn_of(wrong), x, others, 2.0, trusting)
    assert np.flatnonzero(~found.agrees).tolist() == [4, 11]
    assert found.pixels[4] > 1.5
    assert 2 < found.pixels[11] <= 6
    assert found.pixels[others].max() < 0.5


def test_one_wrong_judge_is_not_heard(ring):
    """A view that lacks its left half denies what all others show."""
    seen, x = ring
    wrong = seen.copy()
    wrong[4, :, : int(np.nonzero(seen[4])[1].mean())] = False
    heard = judge(turn_of(wrong), x, np.arange(COUNT), 2.0, trusting=True)
    doubted = judge(turn_of(wrong), x, np.arange(COUNT), 2.0)
    assert doubted.pixels.argmax() == 4
    assert np.delete(doubted.pixels, 4).max() < np.delete(heard.pixels, 4).max() / 2


def test_a_silhouette_that_jumps_between_its_neighbours_is_suspected():
    seen = silhouettes(turntable(COUNT, SIZE, elevation=15), [0.2, 0.3, 0.22], [0.02, 0, 0.02])
    jumped = seen.copy()
    jumped[7] = np.roll(seen[7], 9, axis=1)
    suspicion = suspect(turn_of(jumped).outlines)
    assert suspicion.argmax() == 7
    assert suspicion[7] > 2 * np.delete(suspicion, 7).max()


def test_views_are_thinned_out_evenly():
    assert thin_out(np.array([1, 3, 5]), 4).tolist() == [1, 3, 5]
    assert thin_out(np.arange(10) + 1, 5).tolist() == [1, 3, 5, 7, 9]


def test_finding_who_agrees_tells_its_progress(ring, monkeypatch):
    """Each sample tells its search's share of its own part, and none goes back."""
    seen, x = ring
    told = []

    def search(sample, progress):
        progress(0.5)
        progress(1.0)
        return x

    monkeypatch.setattr("silmesh.cameras.consensus.TIGHT", 0.0)  # draw all samples
    monkeypatch.setattr("silmesh.cameras.consensus.ROUNDS", 0)
    random = np.random.default_rng(0)
    find_consensus(turn_of(seen), search, np.arange(5), 2.0, random, told.append)
    assert told == [i / (2 * SAMPLES) for i in range(1, 2 * SAMPLES + 1)]
