"""Silhouettes of an ellipsoid, damaged on purpose, solved with colours that are known."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import dome, silhouettes

from silmesh.geometry.overlap import iou
from silmesh.scene.outliers import find_outliers
from silmesh.scene.policy import DROPPED, decide
from silmesh.scene.resegmentation import find_specks, solve_jointly

COUNT, SIZE = 24, 96
OBJECT, BEHIND = (150, 90, 60), (190, 190, 185)


@pytest.fixture(scope="module")
def scene():
    """Cameras, true silhouettes, and the photographs of a brown thing before a grey wall."""
    cameras = dome(COUNT, SIZE)
    truth = silhouettes(cameras, [0.4, 0.25, 0.3])
    noise = np.random.default_rng(0).normal(0, 8, (COUNT, SIZE, SIZE, 3))
    pixels = np.where(truth[..., None], OBJECT, BEHIND) + noise
    return cameras, truth, pixels.clip(0, 255).astype(np.uint8)


def solve(scene, found, **options):
    cameras, _, pixels = scene
    verdict = find_outliers(found, cameras)
    return solve_jointly(pixels.__getitem__, found, cameras, verdict, **options)


def test_a_plate_is_cut_away_by_the_other_views_and_the_colours(scene):
    found = scene[1].copy()
    found[3, 60:90, 10:80] = True
    told = []
    solved = solve(scene, found, progress=told.append)
    assert list(solved.reasons) == [3]
    assert told == sorted(told)
    assert iou(solved.silhouettes[3], scene[1][3]) > 0.98


def test_bites_and_blobs_are_mended_and_the_rest_stays_to_the_pixel(scene):
    truth = scene[1]
    found = truth.copy()
    rows = np.flatnonzero(truth[5].any(axis=1))
    found[5, rows.min() : rows.min() + 9] = False
    found[11, 4:20, 4:20] = True
    solved = solve(scene, found)
    assert sorted(solved.reasons) == [5, 11]
    assert not solved.left
    assert iou(solved.silhouettes, truth).min() > 0.98
    others = [i for i in range(COUNT) if i not in (5, 11)]
    np.testing.assert_array_equal(solved.silhouettes[others], truth[others])
    middle = np.s_[rows.min() + 20 :]  # far from the bite
    np.testing.assert_array_equal(solved.silhouettes[5][middle], truth[5][middle])


def test_what_is_empty_or_another_thing_is_found_anew(scene):
    cameras, truth, _ = scene
    found = truth.copy()
    found[[2, 9]] = False
    found[[14, 20]] = silhouettes(cameras, [0.1, 0.45, 0.1], [0.2, 0.1, 0])[[14, 20]]
    solved = solve(scene, found)
    assert sorted(solved.reasons) == [2, 9, 14, 20]
    assert iou(solved.silhouettes, truth).min() > 0.95


def test_right_silhouettes_stay_as_they_are(scene):
    solved = solve(scene, scene[1])
    assert not solved.reasons
    assert solved.silhouettes is scene[1]


def test_without_its_photograph_a_view_stays_and_is_left(scene):
    found = scene[1].copy()
    found[2] = False
    solved = solve(scene, found, unreadable=[2])
    assert list(solved.reasons) == list(solved.left) == [2]
    assert not solved.silhouettes[2].any()


def test_where_colours_say_nothing_the_hull_decides(scene):
    cameras, truth, pixels = scene
    found = truth.copy()
    found[2] = False
    grey = np.full_like(pixels, 128)
    solved = solve_jointly(grey.__getitem__, found, cameras, find_outliers(found, cameras))
    assert iou(solved.silhouettes[2], truth[2]) > 0.9


def test_specks_are_small_parts_of_either_kind():
    #  # # # # # . .
    #  # . # # # . #     a pinhole, a speck of one pixel, and one of four, which is too large
    #  # # # # # . .
    #  . . . . . . .
    #  # # . . . . .
    #  # # . . . . .
    silhouette = np.zeros((6, 7), bool)
    silhouette[:3, :5] = silhouette[4:, :2] = silhouette[1, 6] = True
    silhouette[1, 1] = False
    specks, count = find_specks(silhouette)
    assert np.argwhere(specks).tolist() == [[1, 1], [1, 6]]
    assert count == 2


def test_specks_go_and_pinholes_are_filled(scene):
    truth = scene[1]
    found = truth.copy()
    rng = np.random.default_rng(4)
    for part in (truth[7], ~truth[7]):
        found[7].flat[rng.choice(np.flatnonzero(part), 15, replace=False)] ^= True
    solved = solve(scene, found)
    assert list(solved.reasons) == [7]
    assert solved.reasons[7].startswith("specks are ")
    assert iou(solved.silhouettes[7], truth[7]) > 0.99


@pytest.mark.parametrize("shift", [0.05, 0.3])
def test_right_silhouettes_outlast_wrong_cameras(scene, shift):
    """A fifth of the cameras stand beside where they were: by a tenth of the radius, or by more."""
    cameras, truth, pixels = scene
    wrong, t = [1, 6, 11, 16, 21], cameras.t.clone()
    t[wrong, 0] += shift
    cameras = replace(cameras, t=t)

    def solve(verdict):
        return solve_jointly(pixels.__getitem__, truth, cameras, verdict)

    decision = decide("repair", 3, truth, cameras, solve)
    assert decision.verdict.outliers == wrong
    assert iou(decision.silhouettes, truth).min() > 0.98
    dropped = [i for i, fate in enumerate(decision.fates) if fate == DROPPED]
    assert dropped == (wrong if shift > 0.1 else [])
