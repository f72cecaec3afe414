"""A fit that is killed goes on from its checkpoint, to the same bytes."""

import os
import pickle
import resource
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

import pandas as pd
import pytest
import torch
from scenes import silhouettes, turntable

from silmesh.fitting.checkpoint import Checkpoint
from silmesh.fitting.fast import Fast, State
from silmesh.fitting.loop import run
from silmesh.fitting.softras import SoftRas
from silmesh.geometry.mesh_files import to_tensors
from silmesh.settings.fit import FastFit, FastWeights, SoftRasFit, Weights
from silmesh.shapes.sphere import unit_sphere

SOFTRAS = SoftRasFit(
    iterations=12,
    learning_rate=0.01,
    betas=(0.5, 0.99),
    sigma=1e-4,
    weights=Weights(laplacian=0.03, flatten=0.0003),
)
FAST = FastFit(
    iterations=60,
    learning_rate=0.5,
    betas=(0.9, 0.999),
    sigma=1e-4,
    weights=FastWeights(laplacian=0.1, flatten=5e-5),
    smoothing=1.0,
    batch=2,
)


class Killed(Exception):  # noqa: N818
    """Stands for a kill, between two steps."""


def scene():
    cameras = turntable(4, 64, 10)
    seen = torch.tensor(silhouettes(cameras, (0.45, 0.15, 0.35)), dtype=torch.float32)
    return *to_tensors(unit_sphere(162)), cameras, seen


def make(preset):
    return SoftRas(*scene(), SOFTRAS) if preset == "softras" else Fast(*scene(), FAST)


def outcome(fit, records):
    rows = [(r.iteration, r.loss, r.iou_loss, r.laplacian, r.flatten) for r in records]
    K, R, t = (getattr(fit.correct(scene()[2], [0, 1, 2, 3]), name) for name in ("K", "R", "t"))
    return rows, [part.numpy().tobytes() for part in (fit.verts, fit.faces, K, R, t)]


@pytest.mark.parametrize("preset", ["softras", "fast"])
@pytest.mark.parametrize("stop", [0, 7, 11])
def test_a_fit_goes_on_to_the_same_bytes(preset, stop, tmp_path):
    whole = make(preset)
    expected = outcome(whole, run(whole))

    def kill(record):
        if record.iteration == stop:
            raise Killed

    path = tmp_path / "checkpoint.pt"
    with pytest.raises(Killed):
        run(make(preset), kill, Checkpoint(path, ["one"], every=0))
    again, seen = make(preset), []
    checkpoint = Checkpoint(path, ["one"], every=0)
    assert outcome(again, run(again, seen.append, checkpoint)) == expected
    assert seen[0].iteration == stop  # the step after which it was killed was not kept
    checkpoint.remove()
    assert list(tmp_path.iterdir()) == []


def test_what_another_fit_left_is_not_taken(tmp_path):
    path = tmp_path / "checkpoint.pt"
    *_, cameras, seen = scene()
    Checkpoint(path, (cameras, seen, FAST), every=0).offer(lambda: {"a": 1})
    assert Checkpoint(path, (cameras, seen, FAST)).read() == {"a": 1}
    assert Checkpoint(path, (cameras, seen, SOFTRAS)).read() is None
    assert Checkpoint(path, (cameras, seen * 0, FAST)).read() is None
    assert Checkpoint(path, (turntable(4, 64, 11), seen, FAST)).read() is None
    assert Checkpoint(path, (cameras, seen.double(), FAST)).read() is None


@pytest.mark.parametrize("content", [None, b"", b"no checkpoint", b"PK\x03\x04cut"])
def test_a_file_that_is_no_checkpoint_is_as_none(content, tmp_path):
    path = tmp_path / "checkpoint.pt"
    if content is not None:
        path.write_bytes(content)
    assert Checkpoint(path, ["one"]).read() is None


def test_all_that_changes_in_a_fit_is_in_its_checkpoint():
    """Beside its state only what follows from the faces changes."""
    fit = make("fast")
    names = {field.name for field in fields(State)}

    def rest():
        follows = ("_state", "_smooth", "_objective")
        return pickle.dumps({name: v for name, v in vars(fit).items() if name not in follows})

    assert set(vars(fit._state)) == set(fit.state()) == names
    before = rest()
    run(fit)
    assert rest() == before
    assert set(vars(fit._state)) == names


@pytest.mark.parametrize("lacking", [field.name for field in fields(State)])
def test_no_field_of_a_state_may_be_forgotten(lacking):
    fit = make("fast")
    state = fit.state()
    del state[lacking]
    with pytest.raises(KeyError, match=lacking):
        fit.restore(state)


@pytest.mark.parametrize("lacking", ["state", "fit", "records", "u", "steps"])
@pytest.mark.parametrize("preset", ["softras", "fast"])
def test_a_checkpoint_that_lacks_a_part_is_begun_anew(preset, lacking, tmp_path):
    whole = make(preset)
    expected = outcome(whole, run(whole))

    def kill(record):
        if record.iteration == 3:
            raise Killed

    path = tmp_path / "checkpoint.pt"
    with pytest.raises(Killed):
        run(make(preset), kill, Checkpoint(path, ["one"], every=0))
    held = torch.load(path, weights_only=True)
    for part in (held, held["state"], held["state"]["fit"]):
        part.pop(lacking, None)
    torch.save(held, path)
    again, seen = make(preset), []
    assert outcome(again, run(again, seen.append, Checkpoint(path, ["one"]))) == expected
    assert seen[0].iteration == 0 or (preset, lacking) == ("softras", "u")  # which it has not


@pytest.mark.parametrize("held", [3, [1], {"digest": 1}, {"state": 1}, {}])
def test_other_contents_are_no_checkpoint(tmp_path, held):
    checkpoint = Checkpoint(tmp_path / "checkpoint.pt", ["one"])
    for content in (held, {"digest": checkpoint._digest, "state": held}):
        torch.save(content, tmp_path / "checkpoint.pt")
        found = checkpoint.read()
        assert found is None or found == held


def test_it_is_written_only_now_and_then(tmp_path):
    path = tmp_path / "checkpoint.pt"
    checkpoint = Checkpoint(path, ["one"], every=3600)
    checkpoint.offer(lambda: {"a": 1})
    assert not path.exists()


@contextmanager
def full_disk():
    """No file may grow beyond 100 bytes, as on a disk that is full.

    It ends before pytest writes of the test, perhaps into a file.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_fit_goes_on_where_the_disk_is_full_and_says_so_once(tmp_path, capsys):
    path = tmp_path / "checkpoint.pt"
    whole, fit = make("softras"), make("softras")
    expected = outcome(whole, run(whole))
    checkpoint = Checkpoint(path, ["one"], every=0)
    with full_disk():
        records = run(fit, checkpoint=checkpoint)
    assert outcome(fit, records) == expected
    assert list(tmp_path.iterdir()) == []
    said = capsys.readouterr().err
    assert said.startswith(f"{path}: File too large; the fit goes on, and begins anew")
    assert said.count("\n") == 1


PROGRAM = """
import sys
from silmesh.fitting import checkpoint, loop
from silmesh.steps import fit
checkpoint.EVERY = 0.0
fit.main(sys.argv[1:])
"""


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["softras", "fast"])
def test_a_killed_step_is_run_again_to_the_same_files(preset, tmp_path):
    arguments = write_scene(tmp_path, preset)
    start(arguments, tmp_path / "whole").communicate(timeout=300)
    killed = start(arguments, tmp_path / "killed")
    checkpoint = tmp_path / "killed/.checkpoint.pt"
    until = time.monotonic() + 120
    while not checkpoint.exists():
        assert killed.poll() is None
        assert time.monotonic() < until
        time.sleep(0.01)
    os.kill(killed.pid, signal.SIGKILL)
    killed.communicate()
    assert not (tmp_path / "killed/mesh.ply").exists()
    left = checkpoint.stat().st_mtime_ns
    said, _ = start(arguments, tmp_path / "killed").communicate(timeout=300)
    assert left
    assert "goes on" in said
    for name in ("mesh.ply", "cameras.json"):
        files = [tmp_path / run / name for run in ("whole", "killed")]
        assert files[0].read_bytes() == files[1].read_bytes()
    losses = [pd.read_csv(tmp_path / run / "loss.csv") for run in ("whole", "killed")]
    pd.testing.assert_frame_equal(*(loss.drop(columns="seconds") for loss in losses))
    assert not list((tmp_path / "killed").glob(".*"))


def write_scene(folder: Path, preset: str) -> list[str]:
    """An initial mesh and a scene on disk, and the arguments of a fit of some seconds."""
    from PIL import Image

    from silmesh.geometry.camera import Similarity
    from silmesh.scene.scene import Scene
    from silmesh.scene.scene import write_scene as write

    *_, cameras, seen = scene()
    (folder / "pictures").mkdir()
    for view, silhouette in zip(cameras.views, seen, strict=True):
        pixels = (silhouette[..., None].numpy() * [124, 124, 124, 255]).astype("uint8")
        Image.fromarray(pixels).save(folder / "pictures" / f"{view}.png")
    unit_sphere(162).export(folder / "first.ply")
    coherence = torch.ones(len(cameras)).numpy()
    made = Scene(cameras, Similarity.identity(), seen.numpy() > 0, coherence, {})
    write(folder / "scene", made, folder / "pictures")
    told = {"softras": SOFTRAS, "fast": FAST}[preset].model_copy(update={"iterations": 400})
    first, made = str(folder / "first.ply"), str(folder / "scene")
    return ["--initial", first, "--scene", made, "--settings", told.model_dump_json()]


def start(arguments: list[str], out: Path) -> subprocess.Popen:
    """The step, which keeps a checkpoint after every step of the fit."""
    outputs = ["--meshes", out / "mesh.ply", "--cameras", out / "cameras.json"]
    outputs += [
        "--notes",
        out / "fit.json",
        "--loss",
        out / "loss.csv",
        "--checkpoint",
        out / ".checkpoint.pt",
    ]
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *arguments, "--threads", "1", *map(str, outputs)],
        text=True,
        stdout=subprocess.PIPE,
    )
