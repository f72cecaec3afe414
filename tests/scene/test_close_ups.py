"""A walk whose frames cut an ellipsoid on any side: what is known of it all around is the truth."""

import numpy as np
import pytest
import torch
from scenes import dome, silhouettes

from silmesh.cameras.attempt import Attempt
from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import is_cut, known_pixels
from silmesh.geometry.silhouette_iou import coherence, silhouette_iou
from silmesh.geometry.visual_hull import carve
from silmesh.geometry.whereabouts import find_body
from silmesh.scene.agreement import normalise
from silmesh.scene.assemble import build_scene
from silmesh.scene.outliers import find_outliers
from silmesh.scene.scene import find_similarity
from silmesh.scene.votes import count_denials
from silmesh.shapes.ellipsoid import find_ellipsoid
from silmesh.views import place_view

SIZE, FRAME = 64, (8, 0, 56, 64)  # of the working images, and of portrait photographs in them
AXES, CENTRE = np.array([0.35, 0.2, 0.25]), np.array([0.1, -0.05, 0.05])
FRAMES = np.array([FRAME] * 36)


def walk(every: int) -> tuple[Cameras, np.ndarray]:
    """36 views from all around; but for every so many-th they look close past the middle."""
    cameras = dome(36, SIZE)
    i = np.arange(36)
    close = i % every > 0
    maps = torch.eye(3, dtype=torch.float64).repeat(36, 1, 1)
    aims = 22 * np.stack([np.cos(2.4 * i), np.sin(2.4 * i)], axis=1)  # any side, in pixels
    zoom = np.where(close, 1.6, 1.0)
    maps[:, :2, :2] *= torch.tensor(zoom)[:, None, None]
    maps[:, :2, 2] = torch.tensor(
        (1 - zoom)[:, None] * SIZE / 2 + np.where(close[:, None], aims, 0)
    )
    cameras = cameras.in_pixels_of(maps, cameras.sizes)
    seen = silhouettes(cameras, AXES, CENTRE)
    left, _, right, _ = FRAME
    seen[:, :, :left] = seen[:, :, right:] = False  # padding
    return cameras, seen


@pytest.mark.parametrize(("every", "off"), [(3, 0.03), (100, 0.15)])
def test_the_world_of_a_walk_is_about_the_object_though_most_frames_cut_it(every, off):
    cameras, seen = walk(every)
    cut = is_cut(seen, FRAMES)
    assert cut.sum() >= 20
    similarity = find_similarity(cameras, seen, FRAMES)
    assert np.linalg.norm(similarity.centre.numpy() - CENTRE) < off
    assert 0.8 < similarity.scale * AXES.max() / 0.5 < 1.05


@pytest.mark.parametrize("every", [3, 100])
def test_padding_and_cut_edges_say_nothing(every):
    cameras, seen = walk(every)
    truth = 4 / 3 * np.pi * AXES.prod()
    placed = normalise(cameras, seen, frames=FRAMES)
    assert placed.mean > 0.97
    hull = carve(seen, placed.cameras, 64, frames=FRAMES)
    volume = (hull.field > 0).sum() * hull.spacing.prod() / placed.similarity.scale**3
    assert volume == pytest.approx(truth, rel=0.12)
    blind = carve(seen, placed.cameras, 64)  # takes the padding for background
    assert blind.empty or coherence(blind, placed.cameras, seen).mean() < 0.9


def test_no_view_of_a_walk_is_doubtful_for_what_its_frame_cuts_off():
    cameras, seen = walk(3)
    placed = normalise(cameras, seen, frames=FRAMES)
    assert find_outliers(seen, placed.cameras, FRAMES).outliers == []
    votes = count_denials(seen, placed.cameras, range(36), range(36), 2, 2, FRAMES)
    shown = seen[:, ::2, ::2]
    assert (votes[shown] == 0).mean() > 0.98


def test_of_a_cut_view_only_the_inside_of_the_frame_counts():
    cameras, seen = walk(3)
    known = known_pixels(seen, FRAMES)
    cut = is_cut(seen, FRAMES)
    left, _, right, _ = FRAME
    assert known[~cut].all()
    assert known[cut][:, :, left:right].all()
    assert not known[cut][:, :, :left].any()
    far = torch.tensor([[0.0, 0, 9], [0, 1, 9], [1, 0, 9]])
    none = silhouette_iou(far, torch.tensor([[0, 1, 2]]), cameras, seen, 1e-6, FRAMES)
    assert none.max() < 0.05
    assert known_pixels(seen[~cut], FRAMES[~cut]) is None


def test_the_ellipsoid_of_cut_views_alone_is_where_most_of_them_see_it():
    cameras, seen = walk(100)
    cut = np.flatnonzero(is_cut(seen, FRAMES))
    found = find_ellipsoid(seen[cut], cameras.select(cut), FRAMES[cut])
    assert np.linalg.norm(found.centre - CENTRE) < 0.15
    share = found.lengths(np.eye(3)) / AXES
    assert 0.55 < share.min() < share.max() < 1.2  # the ends, which few see, are left out


def test_the_points_of_an_attempt_place_the_scene():
    cameras, seen = walk(100)
    sphere = np.random.default_rng(0).normal(size=(300, 3))
    on = CENTRE + AXES * sphere / np.linalg.norm(sphere, axis=1, keepdims=True)
    views = [place_view(view, "", 48, 64, SIZE, "pad") for view in cameras.views]
    made = build_scene([Attempt("colmap", cameras, points=on)], views, seen).scene
    placed, carved = find_body(cameras, seen, FRAMES, on), find_body(cameras, seen, FRAMES)
    assert made.similarity.scale == pytest.approx(placed.scale)
    assert np.linalg.norm(placed.centre.numpy() - CENTRE) < 0.03
    assert np.linalg.norm(carved.centre.numpy() - CENTRE) > 0.03
    assert (made.points == on).all()


def test_views_that_have_no_place_in_common_are_refused():
    cameras, seen = walk(100)
    speck = np.zeros_like(seen)
    speck[:, :2, FRAME[0] : FRAME[0] + 2] = True  # each sees a thing in its corner alone
    with pytest.raises(InputError, match="the frame cuts the object in most photographs"):
        find_similarity(cameras, speck, FRAMES)
