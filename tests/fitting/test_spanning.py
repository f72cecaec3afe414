"""The end that no view sees, after a fit: of a cylinder that stands on its base."""

import numpy as np
import pytest
import trimesh
from scenes import turntable

from silmesh.fitting.fit import fit_mesh
from silmesh.geometry.camera import Similarity
from silmesh.scene.scene import Scene
from silmesh.settings.fit import FastFit
from silmesh.settings.init import Init
from silmesh.shapes.downsample import render
from silmesh.shapes.initial import make_initial_mesh

RADIUS, HALF, ELEVATION, SIZE = 0.25, 0.3, 20.0, 128
DISTANCE = 2.732  # of ``turntable``


@pytest.fixture(scope="module")
def scene() -> Scene:
    upright = trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0])
    cylinder = trimesh.creation.cylinder(RADIUS, 2 * HALF, sections=96, transform=upright)
    cameras = turntable(24, SIZE, ELEVATION)
    seen = render(cylinder, cameras, (SIZE, SIZE))
    return Scene(cameras, Similarity.identity(), seen, np.ones(24), {})


def test_the_base_of_what_stands_is_flat_and_its_outlines_stay(scene):
    start = make_initial_mesh(Init(shape="hull"), scene.silhouettes, scene.cameras).mesh
    given = FastFit(iterations=60, device="cpu", judge_views=False)
    off = given.model_copy(update={"span_unseen": False})
    spanned, left = (fit_mesh(start, scene, settings) for settings in (given, off))
    up = np.radians(ELEVATION)  # a camera looks past the base from a little higher
    cone = RADIUS * (DISTANCE * np.sin(up) + HALF) / (DISTANCE * np.cos(up) - RADIUS)
    assert left.mesh.vertices[:, 1].min() < -HALF - 0.5 * cone
    assert spanned.mesh.vertices[:, 1].min() > -HALF - 0.35 * cone
    assert spanned.notes["iou_end"] >= left.notes["iou_end"] - 0.0002
    below = np.pi * RADIUS**2 * cone / 3
    assert 0.3 * below < left.mesh.volume - spanned.mesh.volume < below
    assert spanned.mesh.is_watertight
