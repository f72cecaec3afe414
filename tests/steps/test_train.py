"""The training step: a table with folders of photographs and masks, in a folder of its own."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from scenes import save

from silmesh.errors import InputError
from silmesh.silhouettes.network import load_weights
from silmesh.steps import train as step

ROWS, COLUMNS = np.indices((48, 64))
MODEL = "mobilenet_v3_large"


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """Three objects of four photographs each, of which one has no masks."""
    lines = ["object\timages\tmasks\tsilhouettes\tcameras"]
    for number, name in enumerate(("cup", "jug", "pot")):
        for i in range(4):
            shape = (ROWS - 24) ** 2 + (COLUMNS - 25 - 4 * i) ** 2 < (9 + 3 * number) ** 2
            colour = np.roll((220, 120, 30), number)
            pixels = np.where(shape[..., None], colour, 10).astype(np.uint8)
            save(tmp_path / "images" / name / f"{i}.png", pixels)
            save(tmp_path / "masks" / name / f"{i}.png", shape)
        masks = f"masks/{name}" if name != "pot" else ""
        lines.append(f"{name}\timages/{name}\t{masks}\talpha\tcalibrate")
    path = tmp_path / "objects.tsv"
    path.write_text("\n".join(lines) + "\n")
    return path


def arguments(table: Path, out: Path, epochs: int = 2, holdout: str = "jug") -> list[str]:
    given = {
        "datasets": table,
        "settings": json.dumps(
            {
                "holdout": [holdout],
                "epochs": epochs,
                "patience": 9,
                "batch": 2,
                "size": 64,
                "learning_rate": 1e-3,
            }
        ),
        "threads": 1,
        "checkpoint": out / "checkpoint.pt",
        "table": out / "epochs.csv",
        "output": out / "weights.pt",
    }
    return [str(part) for key, value in given.items() for part in (f"--{key}", value)]


def test_two_epochs(table, tmp_path):
    step.main(arguments(table, tmp_path / "out"))
    epochs = pd.read_csv(tmp_path / "out/epochs.csv")
    assert list(epochs.columns) == [
        *("epoch", "loss", "iou", "holdout_loss", "holdout_iou", "learning_rate", "seconds"),
    ]
    assert epochs.epoch.tolist() == [0, 1]
    assert epochs.iou.between(0, 1).all()
    weights = load_weights(str(tmp_path / "out/weights.pt"), MODEL)
    assert (weights.classes, weights.size) == (("background", "object"), 64)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["epochs.csv", "weights.pt"]


def test_what_is_held_out_is_not_trained_on(table, tmp_path):
    """Other photographs of it change the IoU on it, and nothing of what is learnt."""
    settings = {"epochs": 1}
    step.main(arguments(table, tmp_path / "a", **settings))
    for mask in (tmp_path / "masks/jug").iterdir():
        save(mask, (ROWS < 24))
    step.main(arguments(table, tmp_path / "b", **settings))
    a, b = (load_weights(str(tmp_path / f"{n}/weights.pt"), MODEL).state for n in "ab")
    assert all(torch.equal(a[name], b[name]) for name in a)
    first, second = (pd.read_csv(tmp_path / f"{n}/epochs.csv") for n in "ab")
    assert first.loss.tolist() == second.loss.tolist()
    assert first.holdout_loss.tolist() != second.holdout_loss.tolist()


@pytest.mark.parametrize("holdout", ["pot", "nothing"])
def test_nothing_to_test_on_is_said(table, tmp_path, holdout):
    with pytest.raises(InputError, match=r"train\.holdout: leaves no object with masks"):
        step.main(arguments(table, tmp_path / "out", holdout=holdout))


def test_other_settings_begin_anew(table, tmp_path):
    """A checkpoint is of one training run only: photographs, settings and code."""
    given = vars(step.parse(arguments(table, tmp_path)))
    file = tmp_path / "images/cup/0.png"
    one = step.identify(given, [file], [])
    assert step.identify(given, [file], []) == one
    assert step.identify(given | {"output": "elsewhere.pt"}, [file], []) == one
    other = given["settings"].model_copy(update={"seed": 1})
    assert step.identify(given | {"settings": other}, [file], []) != one
    os.utime(file, (1, 1))
    assert step.identify(given, [file], []) != one


@pytest.mark.slow
def test_a_run_that_was_killed_ends_as_if_it_had_not_been(table, tmp_path):
    command = [sys.executable, "-m", "silmesh.steps.train"]
    step.main(arguments(table, tmp_path / "whole", epochs=8))
    killed = tmp_path / "killed"
    given = [*arguments(table, killed, epochs=8), "--saves", "0"]
    process = subprocess.Popen([*command, *given], stdout=subprocess.DEVNULL)
    until = time.monotonic() + 120
    while not (killed / "checkpoint.pt").exists():
        assert process.poll() is None
        assert time.monotonic() < until
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (killed / "weights.pt").exists()
    subprocess.run([*command, *given], check=True, stdout=subprocess.DEVNULL)
    columns = ["epoch", "loss", "iou", "holdout_loss", "holdout_iou"]
    whole, resumed = (pd.read_csv(p / "epochs.csv")[columns] for p in (tmp_path / "whole", killed))
    pd.testing.assert_frame_equal(whole, resumed)
    one, other = (
        load_weights(str(p / "weights.pt"), MODEL).state for p in (tmp_path / "whole", killed)
    )
    assert all(torch.equal(one[name], other[name]) for name in one)
