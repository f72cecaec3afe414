import numpy as np
import pytest
from scenes import dome, silhouettes

from silmesh.errors import InputError
from silmesh.scene.policy import decide
from silmesh.scene.resegmentation import Solved

COUNT = 16
BAD = [2, 9]


@pytest.fixture(scope="module")
def scene():
    """True silhouettes, and the same with an empty one and one that is half."""
    cameras = dome(COUNT, 48)
    truth = silhouettes(cameras, [0.45, 0.25, 0.3])
    found = truth.copy()
    found[2] = False
    found[9, :24] = False
    return truth, found, cameras


def decided(scene, policy, fewest=3, solve=None):
    return decide(policy, fewest, scene[1], scene[2], solve)


def test_kept_views_stay_as_they_are_but_for_empty_ones(scene):
    decision = decided(scene, "keep")
    assert decision.fates[9] == "kept"
    assert decision.fitted == [i for i in range(COUNT) if i != 2]  # in 2 is nothing to fit
    assert decision.verdict.outliers == BAD
    np.testing.assert_array_equal(decision.silhouettes, scene[1])


def test_dropped_views_are_not_fitted(scene):
    decision = decided(scene, "drop")
    assert decision.fitted == [i for i in range(COUNT) if i not in BAD]


def test_too_few_views_are_refused_with_what_is_wrong(scene):
    with pytest.raises(InputError, match=r"only 14 views are left.*'v2' \(empty\).*'v9' \(lacks"):
        decided(scene, "drop", fewest=15)


def test_what_cannot_be_read_is_said(scene):
    truth, found, cameras = scene
    new = found.copy()
    new[9] = truth[9]

    def solve(verdict):
        assert verdict.outliers == BAD
        return Solved(new, {2: "specks", 9: "specks"}, [2])

    lost = {2: "its photograph cannot be used"}
    decision = decide("repair", 3, found, cameras, solve, lost=lost)
    assert (decision.fates[2], decision.fates[9]) == ("dropped", "repaired")
    assert decision.verdict.reasons[2] == lost[2]
    assert decision.verdict.reasons[9].startswith("lacks ")


def test_a_repaired_view_is_fitted_and_one_that_stays_doubtful_is_dropped_as_it_was(scene):
    truth, found, _ = scene
    new = found.copy()
    new[2], new[9, 30:] = truth[2], False
    decision = decided(scene, "repair", solve=lambda verdict: Solved(new, {}, [9]))
    assert (decision.fates[2], decision.fates[9]) == ("repaired", "dropped")
    np.testing.assert_array_equal(decision.silhouettes[[2, 9]], [truth[2], found[9]])
    assert decision.changes[2] == (1, 0)  # of an empty one all is added
    assert decision.changes[9] == (0, 0)


def test_a_part_that_is_repaired_is_named_and_measured_and_one_that_stays_is_named(scene):
    truth, found, _ = scene
    new = found.copy()
    new[[2, 9]] = truth[[2, 9]]
    half = new[5] & (np.arange(48) < 24)
    area, rest = new[5].sum(), half.sum()
    new[5] = half
    solved = Solved(new, {5: "a part", 7: "another"}, [])
    decision = decided(scene, "repair", solve=lambda verdict: solved)
    assert (decision.fates[5], decision.fates[7]) == ("repaired", "kept")
    assert (decision.verdict.reasons[5], decision.verdict.reasons[7]) == ("a part", "another")
    assert decision.changes[5] == (0, pytest.approx(1 - rest / area))


@pytest.fixture(scope="module")
def halves():
    """The silhouettes of one body in every other view, and of a rod in the rest."""
    cameras = dome(24, 48)
    body = silhouettes(cameras, [0.45, 0.25, 0.3])
    rod = silhouettes(cameras, [0.12, 0.45, 0.12], [0.2, 0.1, 0])
    return np.where((np.arange(24) % 2 == 0)[:, None, None], body, rod), cameras


def test_which_half_is_wrong_something_else_decides(halves):
    suspects = list(range(0, 24, 2))
    decision = decide("keep", 3, *halves, None, suspects=suspects)
    assert decision.verdict.outliers == suspects
    assert decision.fitted == list(range(1, 24, 2))


def test_of_two_halves_none_is_named_where_nothing_decides(halves):
    decision = decide("keep", 3, *halves, None)
    assert len(decision.fitted) == 24


def test_suspects_that_the_others_do_not_contradict_stay(scene):
    truth, _, cameras = scene
    decision = decide("keep", 3, truth, cameras, None, suspects=[1, 5])
    assert decision.verdict.outliers == []
    assert decision.fitted == list(range(COUNT))
