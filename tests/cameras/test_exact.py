"""Whether cameras agree with outlines, by ellipsoids whose silhouettes are a formula."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scenes import silhouettes, turntable
from scipy.spatial.transform import Rotation

from silmesh.cameras.exact import are_exact

AXES, CENTRE, VIEWS, SIZE = (0.4, 0.22, 0.3), (0.05, -0.1, 0.0), 24, 256


def see(size=SIZE, views=VIEWS):
    cameras = turntable(views, size, 20)
    return silhouettes(cameras, AXES, CENTRE), cameras


def turned(cameras, degrees):
    """Each camera turned at random about its own centre by about so many degrees."""
    turns = np.radians(degrees) * np.random.default_rng(0).standard_normal((len(cameras), 3))
    turn = torch.from_numpy(Rotation.from_rotvec(turns).as_matrix())
    return replace(cameras, R=turn @ cameras.R, t=(turn @ cameras.t[..., None])[..., 0])


@pytest.mark.parametrize("size", [64, 256, 600])
def test_the_cameras_that_the_silhouettes_were_seen_by_are_exact(size):
    assert are_exact(*see(size))


def test_cameras_that_are_a_third_of_a_degree_off_are_not():
    seen, cameras = see()
    assert are_exact(seen, turned(cameras, 0.02))
    assert not are_exact(seen, turned(cameras, 0.33))


def test_the_wrong_elevation_of_all_cameras_shows():
    seen, _ = see()
    assert not are_exact(seen, turntable(VIEWS, SIZE, 16))


def test_a_frame_that_cuts_the_object_contradicts_nothing():
    seen, cameras = see()
    frames = np.tile([0, 0, SIZE, SIZE], (VIEWS, 1))
    frames[::4, 2] = columns = [np.flatnonzero(s.any(axis=0))[-1] - 20 for s in seen[::4]]
    for i, right in zip(range(0, VIEWS, 4), columns, strict=True):
        seen[i, :, right:] = False
    assert are_exact(seen, cameras, frames)
    assert not are_exact(seen, cameras)


def test_silhouettes_without_an_outline_show_nothing():
    seen, cameras = see()
    seen[3] = False
    assert not are_exact(seen, cameras)
