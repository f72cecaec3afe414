"""The step of a fit that begins again, stopped in either of its fits: the same files in the end."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from scenes import dome, silhouettes

from silmesh.fitting.loop import Procedure
from silmesh.geometry.camera import INITIAL_SCALE, Similarity
from silmesh.scene.scene import Scene, write_scene
from silmesh.steps import fit

STEPS = 6
RESULTS = ("mesh.ply", "cameras.json", "fit.json")


class Stopped(BaseException):
    """As a kill is: nothing catches it."""


@pytest.fixture(scope="module")
def given(tmp_path_factory) -> list[str]:
    """A splinter, from which a fit ends badly, and the scene of an ellipsoid."""
    folder = tmp_path_factory.mktemp("given")
    cameras = dome(12, 64)
    seen = silhouettes(cameras, [0.45, 0.3, 0.2])
    (folder / "images").mkdir()
    for view in cameras.views:
        Image.new("RGB", (64, 64)).save(folder / "images" / f"{view}.png")
    scene = Scene(cameras, Similarity.identity(), seen, np.ones(12), {})
    write_scene(folder / "scene", scene, folder / "images")
    splinter = trimesh.creation.icosphere(subdivisions=3)
    splinter.vertices *= INITIAL_SCALE * np.array([0.45, 0.02, 0.02])
    splinter.export(folder / "first.ply")
    told = json.dumps({"preset": "fast", "iterations": STEPS, "device": "cpu"})
    places = ["--initial", folder / "first.ply", "--scene", folder / "scene"]
    return [*map(str, places), "--shape", "hull", "--settings", told, "--threads", "1"]


def run(given: list[str], out: Path) -> dict[str, bytes]:
    """The results, by their names."""
    outputs = {"meshes": "mesh.ply", "cameras": "cameras.json", "loss": "loss.csv"}
    outputs |= {"notes": "fit.json", "checkpoint": ".checkpoint.pt"}
    words = [word for name, file in outputs.items() for word in (f"--{name}", str(out / file))]
    fit.main([*given, *words])
    return {name: (out / name).read_bytes() for name in RESULTS}


@pytest.mark.parametrize("stops", [[3], [STEPS + 3], [3, STEPS]])
def test_a_fit_that_is_stopped_in_either_fit_ends_the_same(
    given, stops, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr("silmesh.fitting.checkpoint.EVERY", 0.0)
    whole = run(given, tmp_path / "whole")
    assert "began again" in json.loads(whole["fit.json"])["warnings"][0]
    assert "begins anew" not in capsys.readouterr().out
    for steps in stops:
        stop_after(steps, monkeypatch)
        with pytest.raises(Stopped):
            run(given, tmp_path / "stopped")
        assert not (tmp_path / "stopped/mesh.ply").exists()
    taken = stop_after(1000, monkeypatch)
    assert run(given, tmp_path / "stopped") == whole
    # The step in which it is stopped, and the one before it that its checkpoint may lack, at most.
    assert 2 * STEPS - sum(stops) <= len(taken) <= 2 * STEPS - sum(stops) + 2 * len(stops)
    assert not list((tmp_path / "stopped").glob(".*"))
    assert "begins anew" not in capsys.readouterr().out


def stop_after(steps: int, monkeypatch: pytest.MonkeyPatch) -> list[Procedure]:
    """Stop all fits together after so many steps; gives what steps are taken."""
    from silmesh.fitting.fast import Fast

    taken, step = [], getattr(Fast, "plain_step", Fast.step)

    def counted(self: Fast) -> dict[str, float]:
        if len(taken) == steps:
            raise Stopped
        taken.append(self)
        return step(self)

    monkeypatch.setattr(Fast, "plain_step", step, raising=False)
    monkeypatch.setattr(Fast, "step", counted)
    return taken
