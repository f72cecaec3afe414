"""A ring whose views 8 to 11 have silhouettes with some background, which they share."""

from dataclasses import replace

import numpy as np
import PIL.Image  # noqa: F401, before pycolmap
import pycolmap
import pytest
import torch
from scenes import names, silhouettes, turntable
from scipy.spatial.transform import Rotation

from silmesh.cameras.attempt import Attempt
from silmesh.cameras.features import Photograph, _write_database
from silmesh.cameras.stages import DATABASE, Report, make_stage
from silmesh.geometry.camera import Cameras
from silmesh.scene.motion import MASKED, judge_model
from silmesh.scene.shared_background import find_elsewhere, place_by_sound_views
from silmesh.settings.cameras import Colmap
from silmesh.views import place_view

SIZE, COUNT = 256, 12
NAMES = tuple(names(COUNT))
WRONG = NAMES[8:]
VIEWS = [place_view(name, "", SIZE, SIZE, SIZE, "pad") for name in NAMES]
rng = np.random.default_rng(0)
OBJECT, SHEET = rng.uniform(-0.3, 0.3, (150, 3)), rng.uniform(-0.5, 0.5, (300, 3))


def turned(cameras: Cameras, degrees: dict[str, float]) -> Cameras:
    """Cameras about an object that some of them see turned about the vertical."""
    R = cameras.R.clone()
    for name, angle in degrees.items():
        i = cameras.views.index(name)
        R[i] = R[i] @ torch.as_tensor(Rotation.from_euler("y", angle, degrees=True).as_matrix())
    return replace(cameras, R=R)


@pytest.fixture(scope="module")
def ring():
    cameras = turntable(COUNT, SIZE, elevation=15)
    shown = silhouettes(cameras, [0.45, 0.12, 0.1], [0.1, 0.1, 0])
    shown[8:, 200:, 60:200] = True  # the sheet
    return cameras, shown


@pytest.fixture(scope="module")
def matches(ring, tmp_path_factory):
    """The stage of matches: of the object, and among the wrong views of a sheet that lags behind.

    RANSAC keeps what most matches of a pair agree on.
    """
    cameras, _ = ring
    behind = turned(cameras, {name: 10.0 * k for k, name in enumerate(WRONG)})
    seen = [cameras.project(torch.as_tensor(OBJECT)), behind.project(torch.as_tensor(SHEET))]
    points = np.concatenate([part.numpy() for part in seen], axis=1)
    focal, count = float(cameras.K[0, 0, 0]), len(OBJECT) + len(SHEET)

    def work(part, report):
        found = [
            Photograph(
                name,
                (SIZE, SIZE),
                focal,
                name,
                np.column_stack([points[i], np.ones((count, 1)), np.zeros((count, 1))]).astype(
                    np.float32
                ),
                np.zeros((count, 128), np.uint8),
                count,
            )
            for i, name in enumerate(NAMES)
        ]
        _write_database(part / DATABASE, found, NAMES)
        with pycolmap.Database.open(part / DATABASE) as database:
            for i in range(COUNT):
                for j in range(i + 1, COUNT):
                    same = np.arange(len(OBJECT)) if i < 8 else len(OBJECT) + np.arange(len(SHEET))
                    pairs = np.column_stack([same, same]).astype(np.uint32)
                    geometry = pycolmap.TwoViewGeometry()
                    geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
                    geometry.inlier_matches = pairs
                    database.write_matches(i + 1, j + 1, pairs)
                    database.write_two_view_geometry(i + 1, j + 1, geometry)
        return report

    folder = tmp_path_factory.mktemp("m") / "matches"
    counts = dict.fromkeys(NAMES, count)
    figures = {"features": counts, "pairs": 66, "pairs_verified": 66, "inliers_median": 150.0}
    make_stage(folder, Report(figures=figures), work)
    return folder


def place(cameras, shown, matches, tmp_path, contradicted=WRONG):
    attempt = Attempt(MASKED, cameras, figures={"contradicted": list(contradicted)})

    def judge(model):
        return judge_model(MASKED, model, VIEWS, shown)

    found = place_by_sound_views(attempt, matches, Colmap(), tmp_path, VIEWS, shown, judge)
    return attempt, found


def test_views_that_a_background_drew_aside_are_placed_by_the_others(ring, matches, tmp_path):
    cameras, shown = ring
    aside = turned(cameras, {name: 5.0 * k for k, name in enumerate(WRONG)})
    _, found = place(aside, shown, matches, tmp_path)
    assert found.cameras.views == NAMES
    assert find_elsewhere(cameras, found.cameras, WRONG) == []
    assert "what 4 views share" in found.warnings[-1]
    assert "places 'v9', 'v10', 'v11' elsewhere" in found.warnings[-1]


def test_cameras_that_the_others_confirm_stay(ring, matches, tmp_path):
    cameras, shown = ring
    attempt, found = place(cameras, shown, matches, tmp_path)
    assert found is attempt


def test_a_view_alone_shares_nothing(ring, matches, tmp_path):
    attempt, found = place(ring[0], ring[1], matches, tmp_path, WRONG[:1])
    assert found is attempt
    assert list(tmp_path.iterdir()) == []


def test_turned_worlds_are_laid_on_each_other(ring):
    cameras, _ = ring
    world = torch.as_tensor(Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix())
    other = turned(cameras, {NAMES[9]: 3.5, NAMES[10]: 2.5})
    other = replace(other, R=other.R @ world)
    assert find_elsewhere(cameras, other, WRONG) == [NAMES[9]]
    assert find_elsewhere(cameras, other, NAMES) == []
