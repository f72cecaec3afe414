"""Outlines and photographs for the page: against shapes whose outlines are known."""

import base64
import io
import re

import numpy as np
import pytest
from pages import SIZE, VIEWS, gallery
from PIL import Image

from silmesh.report.budget import choose_views, spread_evenly
from silmesh.report.outlines import UNITS, find_outlines, outline_path


def corners(path):
    """The corners of each part of a path."""
    for part in re.findall(r"M(-?\d+) (-?\d+)l([^z]*)z", path):
        steps = np.array(part[2].split(), int).reshape(-1, 2)
        start = np.array(part[:2], int)
        yield np.concatenate([[start], start + steps.cumsum(axis=0)])


def test_the_outline_of_a_square_runs_along_its_pixels_edges():
    mask = np.zeros((64, 64), bool)
    mask[10:20, 30:50] = True
    (outline,) = corners(outline_path(mask))
    scale = UNITS / 64
    assert outline.min(axis=0) == pytest.approx([30 * scale, 10 * scale])
    assert outline.max(axis=0) == pytest.approx([50 * scale, 20 * scale])
    assert len(outline) <= 8  # a corner is cut by a pixel at most


def test_a_hole_has_an_outline_of_its_own_and_nothing_has_none():
    mask = np.zeros((64, 64), bool)
    mask[5:60, 5:60] = True
    mask[20:40, 20:40] = False
    assert len(list(corners(outline_path(mask)))) == 2
    assert outline_path(np.zeros((64, 64), bool)) == ""


def test_a_soft_outline_lies_between_the_pixels():
    along = np.clip((24.3 - np.arange(64)) / 8, 0, 1)  # 1/2 at 20.3 from the first pixel's centre
    (outline,) = corners(outline_path(np.tile(along, (64, 1))))
    assert outline[:, 0].max() == pytest.approx(20.8 * UNITS / 64, abs=1)


def test_photographs_are_cut_about_the_object_with_their_fates(tmp_path):
    told = gallery(tmp_path)
    assert len(told["views"]) == VIEWS + 1
    for view in told["views"][:VIEWS]:
        points = np.concatenate(list(corners(view["silhouette"])))
        left, top, side = view["crop"]
        assert (points >= [left, top]).all()
        assert (points <= [left + side, top + side]).all()
    assert len({view["crop"][2] for view in told["views"][:VIEWS]}) == 1  # one scale
    assert side < UNITS
    assert told["views"][VIEWS]["crop"] == [0, 0, UNITS]  # what has no silhouette is shown whole
    fates = [view["fate"] for view in told["views"]]
    assert fates == ["kept", "kept", "repaired", "dropped", *["kept"] * (VIEWS - 4), "lost"]
    assert [bool(view["before"]) for view in told["views"]] == [i == 2 for i in range(VIEWS + 1)]
    with Image.open(io.BytesIO(base64.b64decode(told["views"][0]["photo"]))) as photo:
        middle = np.asarray(photo.convert("RGB"))[photo.height // 2, photo.width // 2]
    np.testing.assert_allclose(middle, (200, 120, 40), atol=12)
    assert SIZE == 64


def view(doubt=""):
    return {"photo": "x" * 3000, "silhouette": "y" * 300, "before": "", "doubt": doubt}


def test_all_views_where_there_is_room():
    assert choose_views([view()] * 72, [{}], 1) == list(range(72))


def test_doubtful_views_first_and_the_others_evenly():
    views = [view("blurred" if i in (50, 51) else "") for i in range(72)]
    chosen = choose_views(views, [{f"v{i}": "z" * 300 for i in range(72)}], 50)
    assert {50, 51} < set(chosen)
    assert chosen == sorted(chosen)
    size = len(chosen) * (3000 + 0.65 * 600)
    assert 0.8 * 1_250_000 / 50 < size <= 1_250_000 / 50
    assert np.diff([i for i in chosen if i not in (50, 51)]).max() <= 72 / (len(chosen) - 2) + 3


def test_doubtful_views_leave_half_of_the_room_to_the_others():
    chosen = choose_views([view("blurred")] * 60 + [view()] * 12, [{}], 100)
    assert sum(i >= 60 for i in chosen) == pytest.approx(len(chosen) / 2, abs=1)


def test_spread_evenly():
    assert spread_evenly(range(10), 5) == [0, 2, 4, 6, 8]
    assert spread_evenly([3, 1], 5) == [3, 1]


def test_along_the_frame_that_cuts_a_mask_there_is_no_outline():
    mask = np.zeros((64, 64), bool)
    mask[20:56, 10:30] = True  # it leaves the photograph, of rows 8 to 56, at its bottom
    mask[12:16, 40:50] = True
    cut, whole = sorted(find_outlines(mask, (0, 8, 64, 56)), key=len, reverse=True)
    assert (whole[0] == whole[-1]).all()
    assert sorted((cut[0].tolist(), cut[-1].tolist())) == [[10, 56.5], [30, 56.5]]
    assert cut[:, 1].min() == 20
    assert outline_path(mask, (0, 8, 64, 56)).count("z") == 1
    for frame in (None, (0, 8, 64, 60)):  # as padding, and as background that is seen
        assert outline_path(mask, frame) == outline_path(mask)
        assert outline_path(mask, frame).count("z") == 2
