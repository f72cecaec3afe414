"""What cannot come to its end is refused by the plan, before any work."""

from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from PIL import Image

from silmesh.errors import InputError
from silmesh.planning.plan import Plan

HEADER = "object\timages\tmasks\tsilhouettes\tcameras\tturntable\n"
ROW = "cup\tphotos\tmasks\tmask\tturntable\t2.7,0,5\n"
CURVES = "object,variant,iteration,loss\ncup,a,0,0.7\n"


@pytest.fixture
def refused(tmp_path: Path, monkeypatch):
    """What the plan says of a configuration with these lines; "" if it takes it."""
    monkeypatch.chdir(tmp_path)
    for folder in ("photos", "masks"):
        Path(folder).mkdir()
        for i in range(3):
            Image.new("L", (4, 4)).save(f"{folder}/{i}.png")

    def plan(variant: str = "{}", more: str = "", row: str = ROW) -> str:
        Path("list.tsv").write_text(HEADER + row)
        text = f"datasets: list.tsv\nvariants: {{a: {variant}}}\n{more}"
        try:
            Plan(yaml.safe_load(text), "my.yaml")
        except InputError as error:
            return str(error)
        return ""

    return plan


def test_what_is_right_is_taken(refused):
    Path("curves.csv").write_text(CURVES)
    torch.save({"a": 1}, "own.pt")
    assert refused("{fit: {device: cpu, holdout: 3}}", "published: curves.csv") == ""
    weights = "{silhouettes: deeplab, deeplab: {weights: own.pt}}"
    assert refused(weights, "train: {holdout: [cup]}") != ""  # nothing is left to train on
    assert refused(weights) == ""
    assert refused("{silhouettes: deeplab, deeplab: {weights: DEFAULT}}") == ""


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
@pytest.mark.parametrize("preset", ["fast", "softras"])
def test_a_gpu_that_is_not_there(refused, preset):
    said = refused(f"{{fit: {{preset: {preset}, device: cuda}}}}")
    assert said.startswith("my.yaml: variants.a.fit.device: 'cuda', but torch finds no GPU")
    assert "should be 'cpu', or 'auto'" in said


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("object,variant,step,loss\na,b,0,1\n", "lacks iteration; should be a table with the"),
        ("", "lacks object, variant, iteration, loss"),
        ("object;variant;iteration;loss\n", "Found: object;variant;iteration;loss"),
        (CURVES + "cup,a,1,low\n", "line 3: loss: should be a number, not 'low'"),
        (CURVES + "cup,a,1,nan\n", "line 3: loss: should be a number, not 'nan'"),
        (CURVES + "cup,a\n", "line 3: iteration: should be a number, not None"),
    ],
)
def test_published_curves_of_other_columns(refused, text, expected):
    Path("curves.csv").write_text(text)
    said = refused(more="published: curves.csv")
    assert said.startswith("my.yaml: published: curves.csv")
    assert expected in said


def test_weights_of_other_contents_and_of_unknown_names(refused):
    Path("own.pt").write_text("no weights\n")
    key = "my.yaml: variants.a.deeplab.weights: "
    said = refused("{silhouettes: deeplab, deeplab: {weights: own.pt}}")
    assert said.startswith(f"{key}own.pt: is no file of weights")
    said = refused("{silhouettes: deeplab, deeplab: {weights: BEST}}")
    assert said.startswith(f"{key}'BEST' is none of torchvision's for 'mobilenet_v3_large'; there")
    assert "DEFAULT" in said


def test_mobilenet_v2_takes_files_alone(refused):
    Path("own.tflite").write_bytes(b"\x1c\0\0\0TFL3")
    network = "{silhouettes: deeplab, deeplab: {model: mobilenet_v2, weights: %s}}"
    assert refused(network % "own.tflite") == ""
    said = refused(network % "DEFAULT")
    assert said.startswith("my.yaml: deeplab.weights: 'DEFAULT': 'mobilenet_v2' has none")
    assert "should be the path of its TFLite file" in said
    rows = ROW + ROW.replace("cup", "jug")
    train = "train: {holdout: [cup], backgrounds: photos, model: mobilenet_v2, weights: %s}"
    assert refused(more=train % "own.tflite", row=rows) == ""
    assert "train.weights: 'none': 'mobilenet_v2' has none" in refused(
        more=train % "none", row=rows
    )


def test_backgrounds_that_are_not_there(refused):
    rows = ROW + ROW.replace("cup", "jug")
    said = refused(more="train: {holdout: [cup], backgrounds: none/*.jpg}", row=rows)
    assert said == "my.yaml: train.backgrounds: none/*.jpg: matches no file"
    assert refused(more="train: {holdout: [cup], backgrounds: photos}", row=rows) == ""


def test_the_foreground_model_without_its_library(refused, monkeypatch):
    monkeypatch.setattr("silmesh.planning.feasible.find_spec", lambda name: None)
    said = refused("{silhouettes: matting}")
    assert "silhouettes 'matting' needs a library that is not installed: `pip install" in said


def test_a_holdout_that_leaves_nothing(refused):
    Path("photos/2.png").unlink()
    Path("masks/2.png").unlink()
    said = refused("{fit: {holdout: 2}}")
    assert said == (
        "list.tsv, line 2 (cup) (variant 'a'): fit.holdout: 2 keeps 1 of 2 photographs out, which "
        "leaves fewer than 2 to fit; should be 0"
    )


def test_alpha_of_what_has_none(refused):
    Image.new("RGB", (4, 4)).save("photos/2.jpg")
    Path("photos/2.png").unlink()
    row = ROW.replace("masks\tmask", "\talpha")
    assert "photos/2.jpg: silhouettes are 'alpha', but .jpg has no alpha channel" in refused(
        row=row
    )


def test_colmap_on_an_array(refused):
    np.save("source.npy", np.zeros((3, 4, 4, 4), np.uint8))
    row = "cup\tsource.npy\t\talpha\tcolmap\t\n"
    assert "source.npy: an array of images, but cameras 'colmap' needs" in refused(row=row)
    assert refused(row=row.replace("colmap", "auto")) == ""
