from pathlib import Path

import numpy as np
import pytest
from scenes import save

from silmesh.report.gallery import Shot
from silmesh.report.sheet import CELL, GAP, MARK, _part_shown, draw_sheet


@pytest.fixture
def photograph(tmp_path):
    return save(tmp_path / "a.png", np.full((64, 64, 3), 90, np.uint8))


def cell(photograph: Path, rows: slice, columns: slice, doubt: str = "") -> Shot:
    silhouette = np.zeros((64, 64), bool)
    silhouette[rows, columns] = True
    return Shot("a", photograph, silhouette, None, "dropped" if doubt else "kept", doubt)


def test_the_part_that_is_shown_holds_the_silhouettes_of_all_views(photograph):
    cells = [
        cell(photograph, slice(20, 30), slice(34, 44)),
        cell(photograph, slice(24, 30), slice(40, 54)),
    ]
    # Rows 20 to 30, columns 34 to 54: a square of 1.3 times 20 about (44, 25).
    assert _part_shown(cells) == pytest.approx((31, 12, 26))


def test_the_part_that_is_shown_lies_within_the_photographs(photograph):
    assert _part_shown([cell(photograph, slice(0, 20), slice(0, 10))]) == pytest.approx((0, 0, 26))
    assert _part_shown([cell(photograph, slice(0, 64), slice(5, 9))]) == (0, 0, 64)
    assert _part_shown([cell(photograph, slice(0, 0), slice(0, 0))]) == (0, 0, 64)


def test_a_doubtful_view_is_framed_and_its_row_is_higher(photograph):
    sound = cell(photograph, slice(20, 40), slice(20, 40))
    outlier = cell(photograph, slice(20, 40), slice(20, 40), "other views deny 40% of it")
    plain, marked = draw_sheet([sound] * 2), draw_sheet([sound, outlier])
    assert plain.width == marked.width == 3 * GAP + 2 * CELL
    assert marked.height > plain.height
    frame = np.asarray(marked)[GAP + CELL + 1, GAP + CELL : GAP + 2 * CELL]
    assert (frame == MARK).all(axis=-1).sum() > CELL - GAP - 5
    assert not (np.asarray(plain) == MARK).all(axis=-1).any()
