"""The steps of the report, run as the workflow runs them."""

import csv
import json

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

from silmesh.cameras.turntable import turntable_cameras
from silmesh.geometry.camera import Similarity, write_cameras
from silmesh.scene.scene import Scene, write_scene
from silmesh.silhouettes import encode
from silmesh.softras import soft_silhouettes
from silmesh.steps import conclude, figure, gallery, picture, report, rings

RUNS = ["box-1/plain", "box-1/fine"]
SCENE, JUDGED = "box-1/stages/scenes/64", "box-1/stages/judged/64-keep"
GALLERY = "galleries/box-1/64-keep.json"


@pytest.fixture
def results(tmp_path):
    """The results of two fits of a box, with its views and silhouettes."""
    box = trimesh.creation.box((0.4, 0.6, 0.2))
    cameras = turntable_cameras(["a", "b", "c", "d"], 64, 2.732, 10.0, 45.0)
    points = cameras.project(torch.tensor(box.vertices, dtype=torch.float32))
    masks = (soft_silhouettes(points, torch.tensor(box.faces), (64, 64)) > 0.5).numpy()
    (tmp_path / "views").mkdir()
    for view, mask in zip(cameras.views, masks, strict=True):
        encode(mask).save(tmp_path / "views" / f"{view}.png")
    told = {
        "undistorted": 0,
        "displacement": 0.0,
        "cameras": "calibrate",
        "dropped": {"e": "blurred & <b>"},
        "warnings": ["elevation is a guess"],
        "figures": {
            "estimates": {
                "elevation": {"value": 10.004, "sd": 0.456, "status": "found"},
                "step": {"value": -45.0, "sd": 0.0, "status": "given"},
            }
        },
    }
    agreement = np.array([0.91, 0.93, 0.95, 0.97])
    world = Similarity.identity()
    for scene in (SCENE, JUDGED):
        made = Scene(cameras, world, masks, agreement, told)
        write_scene(tmp_path / scene, made, tmp_path / "views")
    rows = ("a,,kept", "b,cut by the frame,kept", "c,,kept", "d,too small,dropped")
    (tmp_path / JUDGED / "quality.csv").write_text("view,doubt,fate\n" + "\n".join(rows) + "\n")
    encode(masks[0]).save(tmp_path / "views" / "e.png")
    first = tmp_path / "box-1/stages/first"
    first.mkdir(parents=True)
    box.export(first / "first.ply")
    for i, run in enumerate(RUNS):
        folder = tmp_path / run
        folder.mkdir(parents=True)
        box.export(folder / "mesh.ply")
        write_cameras(folder / "cameras.json", cameras)
        curve = f"iteration,loss,seconds\n0,0.{i + 5},0\n1,0.{i + 1},1\n"
        (folder / "loss.csv").write_text(curve)
        (folder / "metrics.json").write_text(json.dumps({"iou_mean": 0.9 + i / 100, "iou": {}}))
    return tmp_path


def test_tables_figure_pictures_and_page_from_results(results):
    made = results / "report"
    every = [f"{results}/{run}" for run in RUNS]
    figure.main(
        f"--object box-1 --losses {every[0]}/loss.csv {every[1]}/loss.csv"
        f" --meshes {every[0]}/mesh.ply {every[1]}/mesh.ply"
        f" --cameras {every[0]}/cameras.json {every[1]}/cameras.json"
        f" --scenes {results}/{JUDGED} {results}/{JUDGED}"
        " --variants plain fine --order fine plain"
        f" --outputs {made}/figures/box-1.svg {made}/figures/box-1.png".split()
    )
    for run in RUNS:
        picture.main(
            f"--mesh {results}/{run}/mesh.ply --cameras {results}/{run}/cameras.json"
            f" --initial {results}/box-1/stages/first/first.ply --scene {results}/{JUDGED}"
            f" --output {made}/pictures/{run}.png --gif {made}/turntables/{run}.gif"
            f" --mp4 {made}/turntables/{run}.mp4 --exhibit {made}/exhibits/{run}.json".split()
        )
    rings.main(
        f"--scene {results}/{SCENE} --threads 1 --output {made}/cameras/box-1/64.png".split()
    )
    gallery.main(
        f"--views {results}/views --scene {results}/{SCENE} --judged {results}/{JUDGED}"
        f" --sheet {made}/sheet.png --output {made}/{GALLERY}".split()
    )
    assert (made / "sheet.png").is_file()
    fates = [v["fate"] for v in json.loads((made / GALLERY).read_text())["views"]]
    assert fates == ["kept", "kept", "kept", "dropped", "lost"]
    (results / "fit.tsv").write_text("s\th:m:s\n12.5\t0:00:12\n")
    plan = {
        "configuration": {
            "views": {"size": 64},
            "variants": {"plain": {}, "fine": {}},
            "comparison": {"baseline": None, "goal": None},
        },
        "baseline": "plain",
        "objects": {},
        "truths": [],
        "runs": [
            {
                "object": "box-1", "variant": variant, "scene": "64", "judged": "64-keep",
                "experiment": variant, "replicate": 1,
                "published": variant, "holdout": 0,
                "stages": {"fit": f"{results}/fit.tsv", "scene": f"{results}/lacking.tsv"},
            }
            for variant in ("plain", "fine")
        ],
    }  # fmt: skip
    (results / "plan.json").write_text(json.dumps(plan))
    conclude.main(
        f"--plan {results}/plan.json --results {results} --table {made}/comparison.csv"
        f" --latex {made}/comparison.tex --figures {made}/comparison.svg".split()
    )
    assert "fine &" in (made / "comparison.tex").read_text()
    assert "final loss, less that of plain" in (made / "comparison.svg").read_text()
    report.main(
        f"--plan {results}/plan.json --results {results} --losses {made}/losses.csv"
        f" --conclusions {made}/comparison.csv"
        f" --summary {made}/summary.csv --page {made}/report.html".split()
    )
    with open(made / "losses.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(r["object"], r["variant"], r["loss"]) for r in rows] == [
        ("box-1", "plain", "0.5"),
        ("box-1", "plain", "0.1"),
        ("box-1", "fine", "0.6"),
        ("box-1", "fine", "0.2"),
    ]
    assert (made / "summary.csv").read_text() == (
        "object,variant,iou_mean\nbox-1,plain,0.9\nbox-1,fine,0.91\n"
    )
    page = (made / "report.html").read_text()
    assert "fine against plain, 1 - IoU: median difference -0.01 over 1 replicate" in page
    assert "0.900" in page
    assert "0.910" in page
    assert '<th scope="row">fit</th><td>12.5</td>' in page
    assert page.count("as frusta around the visual hull") == 1  # both runs share the scene
    for said in ("10.00 ± 0.46°", "-45.00°", "Elevation is a guess.", "blurred &amp; &lt;b&gt;"):
        assert said in page
    assert "hull IoU of 0.940" in page
    with Image.open(made / "pictures" / "box-1" / "plain.png") as image:
        assert np.ptp(np.asarray(image)) > 100
