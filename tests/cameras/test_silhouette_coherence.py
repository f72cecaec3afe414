import numpy as np
import pytest
import torch
from scenes import silhouettes, turntable

from silmesh.cameras.silhouette_coherence import (
    DEPTHS,
    HALVINGS,
    find_misses,
    make_pose,
    measure_at,
    trace,
)
from silmesh.errors import InputError

SIZE, COUNT, RADIUS = 64, 6, 0.5


@pytest.fixture(scope="module")
def ellipsoid():
    """Outlines of an ellipsoid off the axis, and its cameras' K, R and t."""
    cameras = turntable(COUNT, SIZE, elevation=15)
    outlines = trace(silhouettes(cameras, (0.3, 0.15, 0.2), (0.1, -0.05, 0.05)), 12, cameras.views)
    return outlines, cameras.K[0].numpy(), cameras.R.numpy(), cameras.t.numpy()


def leaned(R, t, outlines, K):
    """The cameras leaning by ten degrees, so that they contradict the silhouettes."""
    c, s = np.cos(np.radians(10)), np.sin(np.radians(10))
    lean = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return make_pose(K, lean @ R, t, outlines.points)


def bilinear(image, x, y):
    """The distance at a pixel, None beyond the frame."""
    x, y = x - 0.5, y - 0.5
    height, width = image.shape
    if not (0 <= x < width - 1 and 0 <= y < height - 1):
        return None
    c, r = int(x), int(y)
    weights = np.outer([1 - (y - r), y - r], [1 - (x - c), x - c])
    return float((image[r : r + 2, c : c + 2] * weights).sum())


def least_of_others(outlines, pose, v, point):
    values = [0.0]
    for j, P in enumerate(pose.P):
        if j != v:
            u, w, depth = P @ [*point, 1]
            value = bilinear(outlines.distances[j], u / depth, w / depth)
            beyond = 0.0 if outlines.cut[j] else outlines.distances.min()
            values.append(beyond if value is None else value)
    return min(values)


def plain_misses(outlines, pose):
    """What the kernel finds, by loops over every view at every depth."""
    missed = np.zeros(outlines.known.shape)
    for v, s in np.argwhere(outlines.known):

        def at(depth, v=v, s=s):
            point = pose.centres[v] + (pose.middle[v] + depth) * pose.rays[v, s]
            return least_of_others(outlines, pose, v, point)

        step = 2 * RADIUS / DEPTHS
        depths = step * (np.arange(DEPTHS) + 0.5) - RADIUS
        values = [at(depth) for depth in depths]
        best, depth = max(values), depths[int(np.argmax(values))]
        for _ in range(HALVINGS):
            step /= 2
            tried = [(best, depth), *((at(near), near) for near in (depth - step, depth + step))]
            best, depth = max(tried, key=lambda pair: pair[0])
        missed[v, s] = best
    return missed


def test_the_kernel_finds_what_plain_loops_find(ellipsoid):
    outlines, K, R, t = ellipsoid
    pose = leaned(R, t, outlines, K)
    missed = find_misses(outlines, pose, RADIUS)
    assert missed.pixels.min() < -0.5
    np.testing.assert_allclose(missed.pixels, plain_misses(outlines, pose), atol=1e-5)


def test_true_cameras_miss_by_less_than_the_pixels_hide(ellipsoid):
    outlines, K, R, t = ellipsoid
    missed = find_misses(outlines, make_pose(K, R, t, outlines.points), RADIUS).pixels
    assert (missed <= 0).all()
    assert missed.min() > -0.75


def test_the_depth_and_the_view_are_where_it_misses(ellipsoid):
    outlines, K, R, t = ellipsoid
    pose = leaned(R, t, outlines, K)
    missed = find_misses(outlines, pose, RADIUS)
    at = measure_at(outlines, missed, pose, pose)
    np.testing.assert_allclose(at, missed.pixels, atol=1e-6)
    assert (missed.view != np.arange(COUNT)[:, None]).all()
    assert ((missed.view < 0) == (missed.pixels == 0)).all()


def test_the_threads_do_not_matter(ellipsoid):
    outlines, K, R, t = ellipsoid
    pose = leaned(R, t, outlines, K)
    found = []
    for threads in (1, 2, 5):
        torch.set_num_threads(threads)
        found.append(find_misses(outlines, pose, RADIUS))
    for other in found[1:]:
        np.testing.assert_array_equal(found[0].pixels, other.pixels)
        np.testing.assert_array_equal(found[0].view, other.view)


def test_points_lie_evenly_on_the_outline():
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    disc = (x - 30) ** 2 + (y - 34) ** 2 < 20**2
    outlines = trace(disc[None], 40, ["a"])
    radius = np.linalg.norm(outlines.points[0] - [30, 34], axis=1)
    np.testing.assert_allclose(radius, 20, atol=0.6)
    gaps = np.linalg.norm(np.diff(outlines.points[0], axis=0), axis=1)
    np.testing.assert_allclose(gaps, 2 * np.pi * 20 / 40, rtol=0.15)
    assert outlines.known.all()
    assert not outlines.cut.any()


@pytest.mark.parametrize("pixels", [1, 2, 4, 6])
def test_what_the_blur_would_erase_has_an_outline_around_it(pixels):
    speck = np.zeros((1, 64, 64), bool)
    speck[0, 30, 30 : 30 + pixels] = True
    (points,) = trace(speck, 8, ["a"]).points
    assert (points >= (30, 30)).all()
    assert (points <= (30 + pixels, 31)).all()


def test_an_outline_at_the_frame_is_not_the_objects():
    half = np.zeros((1, SIZE, SIZE), bool)
    half[0, 10:50, :30] = True
    outlines = trace(half, 140, ["a"])
    assert outlines.cut.all()
    at_frame = outlines.points[0, :, 0] < 1
    assert 30 < at_frame.sum() < 50  # of 40 + 40 + 30 + 30 pixels around
    np.testing.assert_array_equal(outlines.known[0], ~at_frame)


@pytest.mark.parametrize(
    ("fill", "words"), [(False, "view 'b' is empty"), (True, "view 'b' fills")]
)
def test_no_outline(fill, words):
    seen = np.zeros((3, 16, 16), bool)
    seen[:, 5:9, 5:9] = True
    seen[1] = fill
    with pytest.raises(InputError, match=words):
        trace(seen, 8, ["a", "b", "c"])
