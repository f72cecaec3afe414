import numpy as np
import pytest
from scenes import dome, silhouettes, turntable

from silmesh.scene.outliers import area_jumps, describe, find_outliers

SIZE, COUNT = 64, 24
AXES = [0.45, 0.25, 0.3]


@pytest.fixture(scope="module")
def scene():
    cameras = dome(COUNT, SIZE)
    return silhouettes(cameras, AXES), cameras


def without_upper_half(seen, views):
    for i in views:
        rows = np.nonzero(seen[i])[0]
        seen[i, : int(np.median(rows))] = False


def test_good_silhouettes_are_inliers(scene):
    verdict = find_outliers(*scene)
    assert verdict.reasons == [""] * COUNT
    assert verdict.refusal is None
    assert max(row["unexplained"] for row in verdict.rows) < 0.1


def test_a_plate_beside_the_object_makes_an_outlier(scene):
    seen, cameras = scene[0].copy(), scene[1]
    bad = [1, 2, 3, 4, 15, 16, 17]
    for i in bad:
        seen[i, 40:60, 4:60] = True
    verdict = find_outliers(seen, cameras)
    assert verdict.outliers == bad
    assert "other views deny" in verdict.reasons[1]


@pytest.mark.parametrize("bad", [[7], [2, 9, 20], [0, 3, 8, 13, 18, 21]])
def test_a_view_that_lacks_a_half_is_an_outlier_and_not_those_that_show_it(scene, bad):
    seen, cameras = scene[0].copy(), scene[1]
    without_upper_half(seen, bad)
    verdict = find_outliers(seen, cameras)
    assert verdict.outliers == bad
    assert "lacks" in verdict.reasons[bad[0]]


def test_an_empty_silhouette_is_an_outlier_without_a_vote(scene):
    seen, cameras = scene[0].copy(), scene[1]
    seen[5] = False
    verdict = find_outliers(seen, cameras)
    assert (verdict.outliers, verdict.reasons[5]) == ([5], "empty")


@pytest.mark.parametrize("count", [4, 5])
def test_few_views_do_not_say_what_one_lacks(count):
    """Two that are opposite allow a whole rod."""
    cameras = turntable(count, SIZE)
    seen = silhouettes(cameras, AXES)
    seen[1] = False
    assert find_outliers(seen, cameras).outliers == [1]
    seen[1, 10:30, 4:60] = True  # what others deny they still say
    verdict = find_outliers(seen, cameras)
    assert verdict.outliers == [1]
    assert "other views deny" in verdict.reasons[1]


def test_wrong_cameras_make_no_view_doubtful():
    """All contradict each other, and none more than the others."""
    right = turntable(12, SIZE, elevation=25)
    seen = silhouettes(right, [0.45, 0.2, 0.15], [0.05, 0.1, 0])
    assert len(find_outliers(seen, turntable(12, SIZE, elevation=-25)).outliers) <= 1


def test_what_a_silhouette_shows():
    shape = np.zeros((10, 20), bool)
    shape[2:7, 0:5] = True
    shape[4, 2] = False
    shape[8, 15] = True
    assert describe(shape, np.array([0, 0, 20, 10])) == {
        "area": 25 / 200,
        "centroid_u": pytest.approx((24 * 2.5 + 15.5) / 25),
        "centroid_v": pytest.approx((24 * 4.5 + 8.5) / 25),
        "on_frame": 5,
        "pieces": 2,
        "holes": 1,
    }


def test_the_edge_is_the_photographs_and_not_the_padded_images():
    shape = np.zeros((10, 20), bool)
    shape[2:5, 6:9] = True
    assert describe(shape, np.array([0, 0, 20, 10]))["on_frame"] == 0
    assert describe(shape, np.array([0, 2, 20, 8]))["on_frame"] == 3


def test_an_area_jumps_where_neither_neighbour_has_it():
    assert area_jumps(np.array([1.0, 2, 8, 2, 2])).tolist() == pytest.approx([2, 2, 4, 1, 1])
