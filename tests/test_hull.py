import numpy as np
import pytest
import torch
import trimesh
from scenes import dome, silhouettes, turntable

from silmesh.evaluation import coherence
from silmesh.hull import carve

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
