"""What is found in small images of large silhouettes is what the large ones say."""

import numpy as np
import pytest
from scenes import silhouettes, turntable

from silmesh.geometry.silhouette_iou import as_sharp, coherence
from silmesh.geometry.small_images import LARGEST, shrink, shrink_frames
from silmesh.geometry.visual_hull import carve

AXES = (0.4, 0.22, 0.3)


def scene(size):
    cameras = turntable(6, size, 20.0)
    return silhouettes(cameras, AXES), cameras


def test_the_hull_of_large_silhouettes_lies_where_theirs_does():
    large, own = (carve(*scene(size), 48) for size in (2 * LARGEST, LARGEST))
    assert large.spacing == pytest.approx(own.spacing, rel=0.01)
    ends = [np.ptp(hull.surface()[0], axis=0) for hull in (large, own)]
    np.testing.assert_allclose(*ends, rtol=0.01)
    middle = tuple(n // 2 for n in large.field.shape)
    # the field is in pixels of the images that were given
    assert large.field[middle] == pytest.approx(2 * own.field[middle], rel=0.05)


def test_coherence_of_large_silhouettes_is_that_of_small_ones():
    (seen, cameras), few = scene(2 * LARGEST), scene(LARGEST)
    hull = carve(*few, 64)
    expected = coherence(hull, few[1], few[0])
    # a pixel of which half is inside counts as outside: the small silhouettes are a little thinner
    assert coherence(hull, cameras, seen) == pytest.approx(expected, abs=5e-3)


def test_frames_shrink_with_the_silhouettes_that_they_cut():
    seen, cameras = scene(100)
    frames = np.tile([0, 0, 100, 100], (6, 1))
    assert shrink_frames(seen, 50, frames) is None
    frames[2] = [11, 0, 60, 100]
    small, _ = shrink(seen, cameras, 50)
    found = shrink_frames(seen, 50, frames)
    assert small.shape == (6, 50, 50)
    assert found[2].tolist() == [6, 0, 30, 50]
    assert found[0].tolist() == [0, 0, 50, 50]


def test_a_rendering_is_as_sharp_in_pixels_in_large_images():
    assert as_sharp(1e-6, (256, 200)) == as_sharp(1e-6, (64, 64)) == 1e-6
    assert as_sharp(1e-6, (512, 1024)) == pytest.approx(1e-6 / 16)
