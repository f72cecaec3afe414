"""Photo-consistency after a fit, in whatever world the cameras came in."""

import numpy as np
import pytest
import torch
import trimesh
from hollow_balls import FLOOR, HollowBall, patterned

from silmesh.fitting.photometric import refine_by_photographs
from silmesh.geometry.camera import Similarity
from silmesh.scene.scene import Scene
from silmesh.settings.fit import FastFit


@pytest.mark.slow
@pytest.mark.parametrize("outlines", [1024, 64])
def test_a_hollow_opens_in_a_world_of_another_size_far_from_its_origin(
    tmp_path, monkeypatch, outlines
):
    """Also where the silhouettes are larger than those that outlines are judged in."""
    monkeypatch.setattr("silmesh.fitting.photometric.OUTLINES", outlines)
    ball = HollowBall(tmp_path, patterned)
    afar = Similarity(torch.tensor([900.0, -400.0, 60.0], dtype=torch.float64), 7.0)
    verts = afar.apply(torch.tensor(ball.hull.vertices)).numpy()
    cameras = ball.cameras.in_world_of(afar)
    scene = Scene(cameras, Similarity.identity(), ball.silhouettes, np.ones(len(cameras)), {})
    given = trimesh.Trimesh(verts, ball.hull.faces, process=False)
    found = refine_by_photographs(given, cameras, scene, ball.views, FastFit(), {})
    assert found.notes["taken"], found.notes["because"]
    assert found.mesh.volume == pytest.approx(7**3 * ball.truth.volume, rel=0.04)
    floor = afar.apply(torch.tensor(FLOOR[None])).numpy()
    assert np.linalg.norm(found.mesh.vertices - floor, axis=1).min() < 7 * 0.02
