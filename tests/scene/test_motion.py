"""Which of two models is taken: the completed one, or the one that it was made of."""

from dataclasses import replace

import numpy as np
import PIL.Image  # noqa: F401, before pycolmap
import pycolmap
import pytest
import torch
import turned_over
from scenes import names, silhouettes, turntable

from silmesh.cameras.stages import APART, LARGEST, MODEL, Report, make_stage
from silmesh.scene.motion import judge_model
from silmesh.scene.sparing import spare
from silmesh.views import place_view

SIZE, COUNT, KEPT = 64, 12, 8
NAMES = tuple(names(COUNT))
VIEWS = [place_view(name, "", SIZE, SIZE, SIZE, "pad") for name in NAMES]
POINTS = np.random.default_rng(0).uniform(-0.3, 0.3, (80, 3))


@pytest.fixture(scope="module")
def ring():
    cameras = turntable(COUNT, SIZE, elevation=15)
    return cameras, silhouettes(cameras, [0.45, 0.12, 0.1], [0.1, 0.1, 0])


def write_model(folder, cameras):
    """A model of these cameras, which see all points where they are."""
    model = pycolmap.Reconstruction()
    focal, _, middle = cameras.K[0, 0].tolist()
    camera = pycolmap.Camera(
        camera_id=1,
        model="SIMPLE_PINHOLE",
        width=SIZE,
        height=SIZE,
        params=[focal, middle, middle],
    )
    model.add_camera_with_trivial_rig(camera)
    for number, name in enumerate(cameras.views, start=1):
        pose = np.column_stack([cameras.R[number - 1].numpy(), cameras.t[number - 1].numpy()])
        seen = cameras.select([number - 1]).project(torch.as_tensor(POINTS))[0].numpy()
        image = pycolmap.Image(name=name, keypoints=seen, camera_id=1, image_id=number)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose))
    for j, point in enumerate(POINTS):
        elements = [pycolmap.TrackElement(i, j) for i in range(1, len(cameras) + 1)]
        model.add_point3D(point, pycolmap.Track(elements))
    model.update_point_3d_errors()
    folder.mkdir()
    model.write(folder)


def make_model(folder, completed, largest, views=NAMES):
    """The stage of a model of ``completed`` cameras that was made of one of ``largest``."""

    def work(part, report):
        write_model(part / MODEL, completed)
        write_model(part / LARGEST, largest)
        return report

    figures = {
        "features": dict.fromkeys(views, 100),
        "linked": dict.fromkeys(views, 5),
        "models": [len(completed)],
        "closest": {},
    }
    make_stage(folder, Report(figures=figures), work)
    return folder


@pytest.mark.slow
def test_a_model_of_other_views_is_joined_to_the_largest(tmp_path):
    """As COLMAP leaves two models where the object was turned over between two sets."""
    first, second = turned_over.ring("a", 20.0), turned_over.ring("b", 35.0)
    seen = np.concatenate(
        [turned_over.show(first), turned_over.show(turned_over.turn_over(second))]
    )
    views = [*first.views, *second.views]
    stage = make_model(tmp_path / "m", first, first, views)
    (stage / APART).mkdir()
    write_model(stage / APART / "0", second)
    shown = [place_view(view, "", SIZE, SIZE, SIZE, "pad") for view in views]
    attempt = judge_model("colmap", stage, shown, seen)
    assert attempt.cameras.views == tuple(views)
    assert attempt.dropped == {}
    assert attempt.figures["joins"][0]["coherence"] > 0.95


def test_a_completed_model_that_the_silhouettes_agree_with_is_taken(ring, tmp_path):
    cameras, seen = ring
    model = make_model(tmp_path / "m", cameras, cameras.select(range(KEPT)))
    attempt = judge_model("colmap", model, VIEWS, seen)
    assert attempt.cameras.views == tuple(names(COUNT))
    assert attempt.figures["coherence"] > 0.95


def test_a_wrong_completion_is_not_taken(ring, tmp_path):
    """Four views that were joined a quarter of a turn off, as by a pattern that repeats."""
    cameras, seen = ring
    elsewhere = [*range(KEPT), *((i + COUNT // 4) % COUNT for i in range(KEPT, COUNT))]
    wrong = cameras.select(elsewhere)
    wrong = replace(wrong, views=tuple(names(COUNT)))
    model = make_model(tmp_path / "m", wrong, cameras.select(range(KEPT)))
    attempt = judge_model("colmap", model, VIEWS, seen)
    assert attempt.cameras.views == tuple(names(KEPT))
    assert attempt.figures["coherence"] > 0.95 > attempt.figures["coherence_completed"]
    assert "the model that was completed to 12 views is not taken" in attempt.warnings[-1]
    assert list(attempt.dropped) == names(COUNT)[KEPT:]


def test_cameras_that_the_background_drew_aside_spare_no_other_source(ring, tmp_path):
    """Two of twelve stand a quarter of a turn off: the hull of the others fills the rest."""
    cameras, seen = ring
    aside = [*range(COUNT - 2), *((i + COUNT // 4) % COUNT for i in range(COUNT - 2, COUNT))]
    wrong = replace(cameras.select(aside), views=cameras.views)
    right, drawn = (
        judge_model("colmap", make_model(tmp_path / name, made, made), VIEWS, seen)
        for name, made in (("right", cameras), ("wrong", wrong))
    )
    spared = spare("calibrate", [drawn, right], COUNT)
    assert spared.cameras is None
    assert spared.refusal.startswith("not tried, for by 'colmap' all have a camera, hull IoU 0.9")
    assert drawn.figures["contradicted"] == names(COUNT)[-2:]
    assert spare("calibrate", [drawn], COUNT) is None
    assert spare("calibrate", [right], COUNT + 1) is None
