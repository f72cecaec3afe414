"""The meshes of an object side by side: one square, one scale, one light."""

import dataclasses

import numpy as np
import pytest
from pages import box, cameras, gallery

from silmesh.report.comparison import Fit, draw_comparison
from silmesh.report.pictures import GROUND, camera_of, trace


@pytest.fixture
def fit(tmp_path):
    gallery(tmp_path)  # writes the photographs
    shown = cameras().select([0, 2])
    mesh = box((0.5, 0.8, 0.4))
    masks = np.stack([trace(mesh, camera_of(shown, i)).mask for i in range(2)])
    return Fit(mesh, shown, [tmp_path / f"views/{v}.png" for v in shown.views], masks)


def covered(picture):
    return (np.abs(np.asarray(picture, int) - GROUND).max(axis=2) > 12).mean()


def test_a_mesh_of_half_the_size_covers_a_quarter(fit):
    half = dataclasses.replace(fit, mesh=box((0.25, 0.4, 0.2)))
    photographs, whole, small = draw_comparison([fit, half])
    assert len(photographs) == len(whole) == len(small) == 2
    assert {p.size for p in (*photographs, *whole, *small)} == {photographs[0].size}
    for i in range(2):
        assert covered(small[i]) == pytest.approx(covered(whole[i]) / 4, rel=0.1)


def test_a_mesh_that_oversteps_its_silhouette_is_seen_whole(fit):
    large = dataclasses.replace(fit, mesh=box((0.9, 0.8, 0.4)))
    before, alone = draw_comparison([fit])[1], draw_comparison([fit, large])
    assert covered(alone[1][0]) < covered(before[0])
    edge = np.asarray(alone[2][0], int)[:, [0, -1]]
    np.testing.assert_allclose(edge, np.broadcast_to(GROUND, edge.shape), atol=3)


def test_the_photograph_is_cut_as_the_mesh_is(fit):
    (photograph, _), (drawn, _) = draw_comparison([fit])
    orange = np.asarray(photograph, int)[..., 0] > 110
    mesh = np.abs(np.asarray(drawn, int) - GROUND).max(axis=2) > 12
    assert (orange & mesh).sum() / (orange | mesh).sum() > 0.9
