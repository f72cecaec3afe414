import numpy as np
import pytest
import torch
from scenes import turntable

from silmesh.fitting.image_pyramid import build_pyramid


def test_levels_halve_the_images_down_to_32_pixels():
    for size, factors in ((256, [4, 2, 1]), (64, [2, 1]), (48, [1]), (100, [2, 1])):
        levels = build_pyramid(turntable(3, size), torch.zeros(3, size, size), 1e-5, True)
        assert [level.factor for level in levels] == factors
        assert levels[-1].sigma == 1e-5
        for level in levels:
            assert level.silhouettes.shape == (3, size // level.factor, size // level.factor)
            assert level.sigma == pytest.approx(1e-5 * level.factor**3)
    assert len(build_pyramid(turntable(3, 64), torch.zeros(3, 64, 64), 1e-5, False)) == 1


def test_a_coarse_pixel_is_the_mean_of_those_that_it_covers():
    seen = torch.zeros(1, 64, 64)
    seen[0, :2, 0] = 1
    coarse = build_pyramid(turntable(1, 64), seen, 1e-5, True)[0].silhouettes
    assert coarse[0, 0, 0] == 0.5
    assert coarse.sum() == 0.5


def test_a_levels_cameras_see_a_point_where_its_images_show_it():
    cameras = turntable(3, 64)
    level = build_pyramid(cameras, torch.zeros(3, 64, 64), 1e-5, True)[0]
    point = torch.tensor([[0.1, 0.2, -0.3]], dtype=torch.float64)
    np.testing.assert_allclose(
        level.scale_cameras(cameras).project(point), cameras.project(point) / 2, rtol=1e-12
    )
    assert level.scale_cameras(cameras).sizes.tolist() == [[32, 32]] * 3
    assert level.pixel == pytest.approx(2 * 2.732 / float(cameras.K[0, 0, 0]))
