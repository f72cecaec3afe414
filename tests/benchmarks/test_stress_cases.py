"""Cases of the stress benchmark: what their files say is what they hold."""

import json

import numpy as np
import pytest
import torch
from stress_cases import DAMAGES, damage_case, make_clean, name_cell, write_case
from stress_worker import reconstruct
from volumes import cast

import silmesh
from silmesh.geometry.camera import read_cameras
from silmesh.geometry.frame import is_cut

SIZE, VIEWS = 48, 6


@pytest.fixture(scope="module")
def clean():
    """An apricot, seen from six sides."""
    return make_clean("apricot", VIEWS, SIZE, ring=False)


@pytest.mark.parametrize("kind", ["clean", "bite", "cut", "shaken"])
def test_files_are_read_as_the_case_that_was_written(clean, kind, tmp_path):
    case = damage_case(clean, kind, DAMAGES[kind][1][-1], seed=1)
    write_case(case, tmp_path, SIZE, calibrated=False)
    read = silmesh.read_photographs(tmp_path / "photographs", size=SIZE)
    assert [view.frame for view in read.views] == [tuple(frame) for frame in case.frames.tolist()]
    found = silmesh.find_silhouettes(read, tmp_path / "masks")
    np.testing.assert_array_equal(found.silhouettes, case.given_masks)
    cameras = read_cameras(tmp_path / "cameras.json")
    point = torch.tensor([[0.1, 0.2, 0.3]], dtype=torch.float64)
    shown = cameras.project(point) + torch.from_numpy(case.frames[:, None, :2])
    torch.testing.assert_close(shown, case.given_cameras.project(point))
    assert json.loads((tmp_path / "case.json").read_text())["size"] == SIZE


def test_close_ups_show_the_truth_within_their_frames(clean):
    case = damage_case(clean, "cut", (0.5,), seed=1)
    whole = cast(case.truth, case.cameras)
    for true, seen, (left, top, right, bottom) in zip(whole, case.masks, case.frames, strict=True):
        np.testing.assert_array_equal(seen[top:bottom, left:right], true[top:bottom, left:right])
        assert seen.sum() == seen[top:bottom, left:right].sum()
    assert is_cut(case.masks, case.frames).sum() == 3
    assert not case.wrong


def test_views_that_are_not_given_are_unseen(clean):
    case = damage_case(clean, "views", (4,), seed=1)
    assert case.cameras.views == tuple(clean.cameras.views[i] for i in (0, 1, 3, 4))
    assert case.unseen.cameras.views == tuple(clean.cameras.views[i] for i in (2, 5))
    np.testing.assert_array_equal(case.unseen.masks, clean.masks[[2, 5]])


@pytest.mark.parametrize("kind", DAMAGES)
def test_every_damage_leaves_the_truth_and_names_its_cell(clean, kind):
    names = set()
    for strength in DAMAGES[kind][1]:
        if kind == "views" and strength[0] > VIEWS:
            continue
        case = damage_case(clean, kind, strength, seed=1)
        if kind not in ("cut", "views"):
            np.testing.assert_array_equal(case.masks, clean.masks)
        changed = kind not in ("clean", "views", "cut", "shaken", "misplaced")
        assert np.array_equal(case.given_masks, case.masks) == (not changed)
        names.add(name_cell(kind, strength))
    assert all(names)


@pytest.mark.parametrize("ring", [False, True])
def test_another_object_is_never_the_object_itself(ring):
    """Every other view of the two rings from which strangers are seen lies on the one ring."""
    plane = make_clean("plane", VIEWS, SIZE, ring)
    case = damage_case(plane, "other", (1.0,), seed=1)
    assert (case.given_masks != case.masks).any(axis=(1, 2)).all()


@pytest.mark.slow
def test_the_worker_makes_a_mesh_of_a_case_and_says_how_good_it_is(clean, tmp_path):
    write_case(clean, tmp_path, SIZE, calibrated=False)
    told = reconstruct(tmp_path, tmp_path / "mesh.ply")
    assert told["verdict"] == "doubtful"  # of six photographs
    assert told["named"] == []
    assert told["iou_given"] > 0.95
    assert (tmp_path / "mesh.ply").exists()


@pytest.mark.data
@pytest.mark.usefixtures("data")
def test_real_objects_come_with_their_frames():
    case = make_clean("bunny", VIEWS, SIZE, ring=False)
    assert case.masks.shape == (VIEWS, SIZE, SIZE)
    for mask, (left, top, right, bottom) in zip(case.masks, case.frames, strict=True):
        assert mask.sum() == mask[top:bottom, left:right].sum() > 0
    assert (case.frames[:, 3] - case.frames[:, 1] < SIZE).all()  # they are padded
