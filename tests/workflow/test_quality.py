"""A view without a silhouette, dropped or repaired on the way from photographs to metrics."""

import json

import numpy as np
import pytest
from PIL import Image

pytestmark = pytest.mark.slow


def run_with(project, policy: str):
    """Run with an empty mask: the folder of the judged scene, and the metrics."""
    with open(project / "config/config.yaml", "a") as config:
        config.write(f"quality: {{policy: {policy}}}\n")
    Image.new("L", (40, 32)).save(project / "photos/mask2/cup/cup_r90.png")
    project.run("results/cup/round/metrics.json")
    (judged,) = (project / "results/cup/stages/judged").iterdir()
    return judged, json.loads((project / "results/cup/round/metrics.json").read_text())


def test_a_view_is_dropped(fresh):
    judged, metrics = run_with(fresh, "drop")
    told = json.loads((judged / "scene.json").read_text())
    assert told["dropped"] == {"cup_r90": "empty"}
    assert (metrics["views"], metrics["views_dropped"]) == (3, 1)
    assert sorted(metrics["iou"]) == ["cup_r0", "cup_r180", "cup_r270"]


def test_a_view_is_repaired(fresh):
    judged, metrics = run_with(fresh, "repair")
    told = json.loads((judged / "scene.json").read_text())
    assert (told["dropped"], told["repaired"]) == ({}, ["cup_r90"])
    assert told["weights"]["cup_r90"] == 0.5
    assert [metrics[f"views{kind}"] for kind in ("", "_dropped", "_repaired")] == [4, 0, 1]
    found, other = (
        np.asarray(Image.open(judged / f"silhouettes/{view}.png").getchannel("A")) > 0
        for view in ("cup_r90", "cup_r270")  # of a ball, alike
    )
    assert (found & other).sum() / (found | other).sum() > 0.7
    assert not np.asarray(Image.open(judged / "originals/cup_r90.png")).any()
