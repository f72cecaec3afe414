"""The cameras' picture: frusta where the cameras stand, looks that look down."""

import numpy as np
import pytest
import torch
import trimesh

from silmesh.cameras.turntable import orbit_cameras, turntable_cameras
from silmesh.geometry.camera import Cameras
from silmesh.report.rings import (
    FIRST,
    LISTED,
    RING,
    draw_rings,
    frusta_of,
    look,
)


def arc(elevation=30.0, count=10, distance=3.0):
    """Cameras along a quarter of a circle, looking down."""
    angles = torch.linspace(0, 90, count, dtype=torch.float64)
    same = torch.ones_like(angles)
    names = [f"v{i}" for i in range(count)]
    return orbit_cameras(names, 64, distance * same, elevation * same, angles)


def turned(cameras, R):
    """The same in a world that was turned by R."""
    R = torch.as_tensor(R)
    return Cameras(cameras.views, cameras.sizes, cameras.K, cameras.R @ R.mT, cameras.t)


def test_frusta_stand_where_the_cameras_do_and_look_at_the_middle():
    cameras = arc(distance=1.2)
    frusta = frusta_of(cameras)
    assert frusta.nearer == 1
    np.testing.assert_allclose(frusta.apexes, cameras.centres)
    middle = frusta.corners.mean(axis=1) - frusta.apexes
    towards = -frusta.apexes
    cosine = (
        (middle * towards).sum(1) / np.linalg.norm(middle, axis=1) / np.linalg.norm(towards, axis=1)
    )
    np.testing.assert_allclose(cosine, 1, atol=1e-9)
    # The corners are those of the image: its half angle is 15 degrees.
    side = np.linalg.norm(frusta.corners[:, 1] - frusta.corners[:, 0], axis=1)
    np.testing.assert_allclose(side / np.linalg.norm(middle, axis=1), 2 * np.tan(np.radians(15)))


def test_far_cameras_come_nearer_by_one_factor():
    cameras = arc(distance=20.0)
    frusta = frusta_of(cameras)
    assert frusta.nearer == pytest.approx(RING / 20)
    np.testing.assert_allclose(frusta.apexes, RING / 20 * cameras.centres)


def test_up_is_the_tables_for_a_quarter_turn_and_in_any_world():
    np.testing.assert_allclose(arc().up, [0, 1, 0], atol=1e-9)
    R = trimesh.transformations.rotation_matrix(2.0, [1, 2, 3])[:3, :3]
    np.testing.assert_allclose(turned(arc(), R).up, R[:, 1], atol=1e-9)


def test_the_look_from_the_top_has_the_first_camera_below_and_all_in_the_picture():
    points = np.array([[0, 0.2, 1.0], [1, 0, 0], [-1, 0, 0], [0, 0, -1]])
    seen = look(np.array([0.0, 1, 0]), np.array([0.0, 0, -1]), 90.0, points, 200).project(points)
    assert (seen > 0).all()
    assert (seen < 200).all()
    assert seen[0, 1] == seen[:, 1].max()  # y down
    assert seen[1, 0] == seen[:, 0].max()  # +x is on the right: it is not mirrored


def test_the_picture_shows_the_first_camera_and_lists_what_was_dropped():
    cameras = turntable_cameras([f"a_long_name_of_a_view_{i}" for i in range(8)], 64, 2.0, 10, 45)
    ball = trimesh.creation.icosphere(2, 0.4)
    plain = draw_rings(cameras, ball)
    dropped = draw_rings(cameras, ball, {f"x{i}": "" for i in range(LISTED + 2)})
    assert plain.width == dropped.width
    assert plain.height < dropped.height
    assert (np.asarray(plain) == FIRST).all(axis=2).sum() > 20
    assert plain.tobytes() == draw_rings(cameras, ball).tobytes()


def test_two_cameras_and_no_hull():
    cameras = turntable_cameras(["a", "b"], 64, 2.0, 0, 90)
    assert np.ptp(np.asarray(draw_rings(cameras, trimesh.Trimesh()))) > 100


def test_a_camera_straight_above():
    cameras = arc(elevation=90.0, count=3)
    assert np.ptp(np.asarray(draw_rings(cameras, trimesh.creation.icosphere(1, 0.4)))) > 100
