"""A view without a silhouette, dropped or repaired on the way from photographs to metrics."""

import json

import numpy as np
import pytest
from PIL import Image

from silmesh.scene.quality_table import read_table

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


def test_a_truncated_jpeg_loses_its_view_alone(fresh):
    """Nor is it repaired: there is nothing to segment."""
    photograph = fresh / "photos/png2/cup/cup_r90.jpg"
    png = photograph.with_suffix(".png")
    Image.open(png).save(photograph)
    png.unlink()
    photograph.write_bytes(photograph.read_bytes()[:-200])
    said = fresh.snakemake("results/cup/round/metrics.json")[1]  # masks are kept
    assert "cup_r90.jpg: cannot be read as an image: " in said
    assert (
        "Get the file anew, or let quality.policy 'drop' (in the command: --quality drop)" in said
    )
    with open(fresh / "config/config.yaml", "a") as config:
        config.write("quality: {policy: repair}\n")
    fresh.run("results/cup/round/metrics.json")
    (judged,) = (fresh / "results/cup/stages/judged").iterdir()
    (row,) = [row for row in read_table(judged) if row["view"] == "cup_r90"]
    assert (row["fate"], row["doubt"]) == ("dropped", "its photograph cannot be used")
    metrics = json.loads((fresh / "results/cup/round/metrics.json").read_text())
    assert (metrics["views"], metrics["views_dropped"]) == (3, 1)
    (log,) = (fresh / "logs/views").glob("*.log")
    assert "cup_r90.jpg: cannot be read as an image" in log.read_text()
    cameras = json.loads((fresh / "results/cup/round/cameras.json").read_text())
    eye = -np.array(cameras[1]["R"]).T @ cameras[1]["t"]
    assert cameras[1]["view"] == "cup_r180"
    assert eye[2] < -2  # behind the object, as the third of four quarters


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
