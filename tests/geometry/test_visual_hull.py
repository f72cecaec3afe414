import numpy as np
import pytest
import torch
import trimesh
from scenes import dome, silhouettes, turntable
from scipy.ndimage import distance_transform_edt as edt
from scipy.ndimage import map_coordinates

from silmesh.geometry.frame import is_cut
from silmesh.geometry.signed_distance import signed_distance
from silmesh.geometry.silhouette_iou import coherence
from silmesh.geometry.visual_hull import carve, find_outlier_views

RADIUS, CENTRE = 0.3, np.array([0.1, -0.05, 0.12])
BALL = 4 / 3 * np.pi * RADIUS**3
SIZE = 96
PIXEL = 2.732 * np.tan(np.radians(15)) * 2 / SIZE  # a pixel's size at the origin


@pytest.fixture(scope="module")
def ball():
    """Cameras all around a ball, and its silhouettes."""
    cameras = dome(40, SIZE)
    return cameras, silhouettes(cameras, [RADIUS] * 3, CENTRE)


def surface(hull):
    return trimesh.Trimesh(*hull.surface(), process=False)


def test_the_hull_of_a_ball_is_nearly_the_ball(ball):
    cameras, seen = ball
    mesh = surface(carve(seen, cameras, resolution=64))
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert 0.95 < mesh.volume / BALL < 1.05  # positive: outward
    reach = np.linalg.norm(mesh.vertices - CENTRE, axis=1)
    assert reach.min() > RADIUS - 0.5 * PIXEL  # it holds the ball
    assert reach.max() < RADIUS + 1.5 * PIXEL


def test_the_field_is_in_pixels_and_positive_inside(ball):
    cameras, seen = ball
    hull = carve(seen, cameras, resolution=33)
    index = np.indices(hull.field.shape).reshape(3, -1).T
    reach = np.linalg.norm(hull.origin + index * hull.spacing - CENTRE, axis=1)
    field = hull.field.ravel()
    assert (field[reach < RADIUS - PIXEL] > 0).all()
    assert (field[reach > RADIUS + 2 * PIXEL] < 0).all()
    near = np.abs(reach - RADIUS) < 2 * PIXEL
    np.testing.assert_allclose(field[near], (RADIUS - reach[near]) / PIXEL, atol=1.3)


def test_the_hull_is_the_same_for_any_number_of_threads(ball):
    cameras, seen = ball
    fields = []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        fields.append(carve(seen, cameras, resolution=32).field)
    np.testing.assert_array_equal(*fields)


def test_from_the_equator_a_ball_keeps_its_middle_and_gains_at_its_poles():
    cameras = turntable(24, SIZE)
    mesh = surface(carve(silhouettes(cameras, [RADIUS] * 3), cameras, resolution=64))
    around = np.linalg.norm(mesh.vertices[:, [0, 2]], axis=1)
    np.testing.assert_allclose(around.max(), RADIUS, atol=PIXEL)
    assert RADIUS - PIXEL < mesh.vertices[:, 1].max() < 1.06 * RADIUS


def test_contradicting_views_leave_nothing():
    cameras = turntable(4, SIZE)
    high = silhouettes(cameras, [0.1] * 3, [0, 0.3, 0])
    low = silhouettes(cameras, [0.1] * 3, [0, -0.3, 0])
    seen = np.concatenate([high[:2], low[2:]])
    hull = carve(seen, cameras)
    assert hull.empty
    assert coherence(hull, cameras, seen).tolist() == [0, 0, 0, 0]


def test_a_view_whose_frame_cuts_the_object_says_nothing_beyond_it(ball):
    cameras, seen = ball
    whole = carve(seen, cameras, resolution=48)
    aside = cameras.K.clone()
    aside[0, 0, 2] += SIZE / 2 - 10  # the first camera looks past the ball
    shifted = cameras.in_pixels_of(aside @ cameras.K.inverse(), cameras.sizes)
    cut = silhouettes(shifted, [RADIUS] * 3, CENTRE)
    assert 0 < cut[0].sum() < 0.9 * seen[0].sum()
    volume = surface(carve(cut, shifted, resolution=48)).volume
    assert volume == pytest.approx(surface(whole).volume, rel=0.02)


def test_a_silhouette_at_no_frame_carves_beyond_its_frame():
    """What a view does not hold is outside if its silhouette lies whole within its frame."""
    cameras = turntable(2, SIZE)  # from opposite sides, with a frame of +-0.73
    seen = silhouettes(cameras, [0.2] * 3)
    mesh = surface(carve(seen, cameras, resolution=48))
    assert np.abs(mesh.vertices[:, :2]).max() < 0.2 * 1.3 + PIXEL


def twin(seen, cameras, hull, tolerated=0):
    """The field of a grid, plainly: every view's signed distance at every sample, sorted."""
    index = np.indices(hull.field.shape).reshape(3, -1).T
    points = cameras.project(torch.as_tensor(hull.origin + index * hull.spacing)).numpy() - 0.5
    signed = np.where(seen, 1.0, -1.0)
    for i, s in enumerate(seen):
        signed[i] = np.where(s, edt(s) - 0.5, 0.5 - edt(~s)).clip(-SIZE / 16, SIZE / 16) + 0.15
    values = [
        map_coordinates(d, p[:, ::-1].T, order=1, cval=-SIZE / 16)
        for d, p in zip(signed, points, strict=True)
    ]
    return np.sort(values, axis=0)[tolerated].reshape(hull.field.shape)


@pytest.mark.parametrize("tolerated", [0, 1, 3])
def test_the_field_is_its_plain_twins_near_the_surface(ball, tolerated):
    cameras, seen = ball
    hull = carve(seen, cameras, 30, tolerated)
    plain = twin(seen, cameras, hull, tolerated)
    near = np.abs(plain) < 1
    assert near.sum() > 500
    np.testing.assert_allclose(hull.field[near], plain[near], atol=1e-4)
    np.testing.assert_array_equal(hull.field > 0, plain > 0)


def test_distances_are_those_of_scipy():
    seen = np.random.default_rng(0).random((40, 50)) > 0.5
    seen[10:30, 5:40] = True
    plain = np.where(seen, edt(seen) - 0.5, 0.5 - edt(~seen)).clip(-4, 4)
    np.testing.assert_allclose(signed_distance(seen, 4, grace=0), plain, atol=1e-6)
    assert (signed_distance(np.ones((5, 6), bool), 4, grace=0) == 4).all()
    assert (signed_distance(np.zeros((5, 6), bool), 4, grace=0) == -4).all()


def test_a_hull_may_tolerate_a_view_that_disagrees(ball):
    cameras, seen = ball
    wrong = seen.copy()
    wrong[7] = False
    wrong[7, :5, :5] = True
    assert carve(wrong, cameras, 32).empty
    volume = surface(carve(wrong, cameras, 64, tolerated=1)).volume
    assert 0.97 < volume / BALL < 1.1


def test_where_every_view_is_cut_the_hull_does_not_go_on_into_what_none_speaks_of():
    cameras = turntable(12, SIZE, elevation=15)
    seen = silhouettes(cameras, [RADIUS] * 3)
    frame = left, top, right, bottom = 16, 20, 80, 58  # the ball's lowest part leaves it
    seen[:, bottom:] = False
    frames = np.tile(frame, (12, 1))
    assert is_cut(seen, frames).all()
    hull = carve(seen, cameras, 64, frames=frames)
    points = hull.origin + np.argwhere(hull.field > 0) * hull.spacing
    assert np.linalg.norm(points, axis=1).max() <= 0.5  # the sphere that holds the object
    pixels = cameras.project(torch.as_tensor(points)).numpy()
    spoken = ((pixels >= (left, top)) & (pixels < (right, bottom))).all(axis=2)
    assert spoken.any(axis=0).all()
    assert 1 <= len(points) * np.prod(hull.spacing) / BALL < 1.25
    assert coherence(hull, cameras, seen, frames).min() > 0.97


def test_the_view_to_doubt_is_the_one_that_cuts_off_what_no_other_does(ball):
    cameras, seen = ball
    wrong = seen.copy()
    wrong[7] &= np.arange(SIZE) < np.flatnonzero(seen[7].any(axis=0)).mean()
    assert find_outlier_views(wrong, cameras) == [7]


def test_of_an_empty_hull_those_are_outliers_that_empty_it():
    cameras = turntable(8, SIZE)
    seen = silhouettes(cameras, [0.15] * 3, [0, 0.2, 0])
    low = silhouettes(cameras, [0.15] * 3, [0, -0.2, 0])
    seen[2], seen[5] = low[2], low[5]
    assert carve(seen, cameras).empty
    assert find_outlier_views(seen, cameras) == [2, 5]


def test_a_coarser_field_is_the_same_where_it_is_sampled(ball):
    cameras, seen = ball
    hull = carve(seen, cameras, 33)
    coarser = hull.coarser(2)
    np.testing.assert_array_equal(coarser.field, hull.field[::2, ::2, ::2])
    np.testing.assert_allclose(
        coarser.origin + 16 * coarser.spacing, hull.origin + 32 * hull.spacing
    )


def test_the_field_of_views_that_their_frames_cut_is_their_plain_twins(ball):
    cameras, seen = ball
    left, top, right, bottom = frame = (30, 10, 62, 90)
    part, frames = seen.copy(), np.array([frame, (0, 0, SIZE, SIZE)] * 20)
    part[::2] = False
    part[::2, top:bottom, left:right] = seen[::2, top:bottom, left:right]
    cut = is_cut(part, frames)
    assert cut.tolist() == [True, False] * 20
    hull = carve(part, cameras, 30, frames=frames)
    index = np.indices(hull.field.shape).reshape(3, -1).T
    points = cameras.project(torch.as_tensor(hull.origin + index * hull.spacing)).numpy() - 0.5
    values = []
    for s, p, is_it in zip(part, points[:, :, ::-1], cut, strict=True):
        within = s[top:bottom, left:right] if is_it else s
        signed = np.where(within, edt(within) - 0.5, 0.5 - edt(~within)).clip(-6, 6) + 0.15
        at = p - [top, left] if is_it else p
        there = ((at >= 0) & (at < np.array(within.shape) - 1)).all(axis=1)
        between = map_coordinates(signed, at.T, order=1, mode="nearest")
        values.append(np.where(there, between, np.inf if is_it else -6))
    plain = np.min(values, axis=0).reshape(hull.field.shape)
    near = np.abs(plain) < 1
    assert near.sum() > 500
    np.testing.assert_allclose(hull.field[near], plain[near], atol=1e-4)
    np.testing.assert_array_equal(hull.field > 0, plain > 0)
