"""Sets of a turntable each, calibrated and joined."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image
from scipy.spatial.transform import Rotation
from turned_over import SIZE, ring, show, turn_over

from silmesh.geometry.camera import Cameras
from silmesh.scene.calibrated_sets import calibrate_sets
from silmesh.settings.turntable import parse_turntable
from silmesh.views import place_view

FARTHER = 8  # times, which leaves hardly any perspective


def from_afar(cameras: Cameras) -> Cameras:
    """Cameras so distant that a mirrored object, turned the other way, looks the same."""
    K = cameras.K.clone()
    K[:, :2, :2] *= FARTHER
    return replace(cameras, K=K, t=FARTHER * cameras.t)


@pytest.mark.slow
def test_a_set_seen_from_below_is_taken_to_turn_the_other_way():
    first, second = from_afar(ring("a", 30.0)), from_afar(ring("b", -15.0))
    seen = np.concatenate([show(first), show(turn_over(second))])
    names = [*first.views, *second.views]
    views = [place_view(name, "", SIZE, SIZE, SIZE, "pad") for name in names]
    attempt = calibrate_sets(seen, views, [first.views, second.views])
    assert attempt.refusal is None
    assert "'b0' to 'b9' (10 views) are taken to turn the other way" in attempt.warnings[0]
    above, below = attempt.figures["of_sets"]
    assert (above["mirror"], below["mirror"]) == ("table", "sets")
    assert below["estimates"]["elevation"]["value"] == pytest.approx(-15, abs=2)
    true = torch.cat([first.R, turn_over(second).R]).numpy()
    apart = true[10] @ true[0].T @ (attempt.cameras.R[10] @ attempt.cameras.R[0].T).numpy().T
    assert np.degrees(Rotation.from_matrix(apart).magnitude()) < 2


def test_rounds_that_were_given_are_not_tried_as_sets():
    both = (*ring("a", 30.0).views, *ring("b", 45.0).views)
    seen = np.concatenate([show(ring("a", 30.0)), show(ring("b", 45.0))])
    views = [place_view(name, "", SIZE, SIZE, SIZE, "pad") for name in both]
    attempt = calibrate_sets(seen, views, rounds=parse_turntable(",,,8;,,,8").rounds)
    assert "rounds of 8 and 8 photographs, 16 in all, but there are 20" in attempt.refusal
    assert "sets" not in attempt.refusal


@pytest.mark.slow
def test_a_folder_of_three_views_that_disagree_is_said_to_be_too_short(tmp_path):
    above, over = ring("a", 30.0), turn_over(ring("b", 45.0)).select(range(3))
    seen = np.concatenate([show(above), show(over)])
    files = [*(f"front/{view}.png" for view in above.views), *(f"back/{v}.png" for v in over.views)]
    views = []
    for name, file in zip([*above.views, *over.views], files, strict=True):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        Image.new("RGB", (SIZE, SIZE)).save(tmp_path / file)
        views.append(place_view(name, str(tmp_path / file), SIZE, SIZE, SIZE, "pad"))
    attempt = calibrate_sets(seen, views, step=36.0)
    assert set(attempt.figures["disagreeing"]) == {"b0", "b1", "b2"}
    assert "one of 3 ('b0.png' to 'b2.png') is too short" in attempt.warnings[-1]
