import numpy as np
import pytest

from silmesh.geometry.frame import count_on_frame, find_box, is_cut, whole_frames


@pytest.mark.parametrize(
    ("row", "column", "cut"),
    [(0, 4, True), (4, 0, True), (7, 5, True), (3, 9, True), (4, 5, False)],
)
def test_a_silhouette_that_reaches_the_edge_of_its_image_is_cut(row, column, cut):
    seen = np.zeros((1, 8, 10), bool)
    seen[0, row, column] = True
    assert is_cut(seen).tolist() == [cut]
    assert whole_frames(seen).tolist() == [[0, 0, 10, 8]]


def test_the_edge_is_the_photographs_where_it_does_not_fill_its_image():
    seen = np.zeros((3, 8, 8), bool)
    seen[0, 2:5, 3] = seen[1, 3:5, 3] = True  # the third shows nothing
    frames = [(0, 2, 8, 6)] * 3
    assert is_cut(seen, frames).tolist() == [True, False, False]
    assert [count_on_frame(s, f) for s, f in zip(seen, frames, strict=True)] == [1, 0, 0]


def test_a_corner_counts_once():
    assert count_on_frame(np.ones((4, 5), bool), (0, 0, 5, 4)) == 14


def test_a_box_holds_a_silhouette_as_a_frame_does():
    seen = np.zeros((8, 10), bool)
    assert find_box(seen) == (0, 0, 0, 0)
    seen[2, 7] = seen[5, 3] = True
    left, top, right, bottom = find_box(seen)
    assert (left, top, right, bottom) == (3, 2, 8, 6)
    assert seen[top:bottom, left:right].sum() == 2
