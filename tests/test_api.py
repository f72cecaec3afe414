"""The Python API: light to import, as the command and the workflow are, and as the docs say."""

import hashlib
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scenes import silhouettes, turntable

import silmesh
from silmesh.cli.workspace import find_snakefile
from silmesh.errors import InputError
from silmesh.planning.provenance import SOURCE

VIEWS, SIZE = 12, 64
KNOWN = {"cameras": "turntable", "turntable": "2.732,10,30"}
DOCS = Path(__file__).parents[1] / "docs" / "python.md"
COMMAND = "from silmesh.cli.main import main; main(prog_name='silmesh')"
CONFIG = f"""\
datasets: datasets.tsv
views: {{size: {SIZE}}}
texture: {{size: auto}}
variants:
  mesh:
    init: {{shape: hull}}
    fit: {{preset: fast}}
"""
TABLE = "object\timages\tsilhouettes\tcameras\tturntable\ncup\tphotos\tthreshold\tturntable\t{}\n"


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """Photographs of an ellipsoid with unequal axes on a turntable, before a plain background."""
    folder = tmp_path_factory.mktemp("api") / "photos"
    folder.mkdir()
    shown = silhouettes(turntable(VIEWS, SIZE, elevation=10), (0.45, 0.3, 0.2))
    for i, silhouette in enumerate(shown):
        pixels = np.full((SIZE, SIZE, 3), 20, np.uint8)
        pixels[silhouette] = (200, 120, 40)
        Image.fromarray(pixels).save(folder / f"r{i}.png")
    return folder


def python(code: str, cwd: Path, *arguments: str) -> str:
    """Run Python as a person does, where nothing is loaded yet; what it says."""
    given = {"PYTHONPATH": str(SOURCE), "OPENBLAS_NUM_THREADS": "1"}
    given |= {"SILMESH_CACHE": str(cwd / "cache")}
    words = [sys.executable, *arguments, *(["-c", code] if code else [])]
    done = subprocess.run(words, cwd=cwd, env=os.environ | given, text=True, capture_output=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def digest(file: Path) -> str:
    """Of what is in a file, but for its own name, by which an OBJ names what is beside it."""
    content = file.read_bytes().replace(file.stem.encode() + b".", b"own.")
    return hashlib.sha256(content).hexdigest()


def test_nothing_heavy_is_loaded_before_a_name_is_used(tmp_path):
    said = python(
        "import sys, silmesh\n"
        "print(sorted({'numpy', 'torch', 'pydantic', 'silmesh.api'} & set(sys.modules)))\n"
        "print(silmesh.reconstruct.__module__, 'fit' in dir(silmesh))",
        tmp_path,
    )
    assert said.split("\n")[:2] == ["[]", "silmesh.api True"]
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = silmesh.nothing


@pytest.mark.parametrize("name", silmesh.__all__)
def test_every_name_says_what_it_takes(name):
    stage = getattr(silmesh, name)
    assert stage.__doc__
    assert set(stage.__annotations__) >= {"return"}
    stub = (SOURCE / "silmesh" / "__init__.pyi").read_text()
    assert f"import {name} as {name}\n" in stub


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"photographs": "nowhere"}, "nowhere: is not there"),
        ({"photographs": []}, "photographs: none are named"),
        ({"settings": {"fitting": {}}}, "'fitting' is no section; known are views"),
        ({"size": 3}, "views: size: should be a whole number from 16"),
        ({"masks": "m", "silhouettes": "threshold"}, "'threshold' take no masks"),
        ({"silhouettes": "mask"}, "masks: none are given"),
        ({"cameras": "turntable", "silhouettes": "threshold", "size": 16}, "lacks a number"),
        (
            {"cameras": "turntable", "silhouettes": "threshold", "size": 16, "sets": "a*;b*"}
            | {"turntable": "2.7,0,5"},
            "'turntable' are of one turn, and sets",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_in_a_line(photos, given, message):
    with pytest.raises(InputError, match=message) as error:
        silmesh.reconstruct(**{"photographs": photos} | given)
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_python_command_and_workflow_give_the_same_mesh(photos, tmp_path):
    (tmp_path / "photos").symlink_to(photos)
    python(
        "import json, silmesh\n"
        f"result = silmesh.reconstruct('photos', size={SIZE}, **{KNOWN})\n"
        "[result.save(f'api.{kind}') for kind in ('glb', 'obj', 'ply')]\n"
        "json.dump(result.metrics, open('api.json', 'w'))",
        tmp_path,
    )
    options = ["--cameras", "turntable", "--turntable", KNOWN["turntable"], "--size", str(SIZE)]
    words = ["-c", COMMAND, "photos", *options, "--cores", "1"]
    for kind in ("glb", "obj", "ply"):
        python("", tmp_path, *words, "-o", f"command.{kind}")
    (tmp_path / "config.yaml").write_text(CONFIG)
    (tmp_path / "datasets.tsv").write_text(TABLE.format(KNOWN["turntable"]))
    made = [f"results/cup/mesh/mesh.{kind}" for kind in ("glb", "obj")]
    workflow = ["-m", "snakemake", "--snakefile", str(find_snakefile()), "--cores", "1"]
    python("", tmp_path, *workflow, "--configfile", "config.yaml", "--", *made)
    for kind in ("glb", "obj", "mtl", "png"):
        files = [f"api.{kind}", f"command.{kind}", f"results/cup/mesh/mesh.{kind}"]
        assert len({digest(tmp_path / file) for file in files}) == 1, kind
    assert digest(tmp_path / "api.ply") == digest(tmp_path / "command.ply")


@pytest.mark.slow
def test_the_examples_of_the_docs_run(photos, tmp_path):
    (tmp_path / "photos").symlink_to(photos)
    examples = re.findall(r"```python\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    assert len(examples) == 2
    said = python(examples[0], tmp_path)
    assert float(said.splitlines()[1]) > 0.98
    assert said.splitlines()[2].endswith(f"({VIEWS}, {SIZE}, {SIZE})")
    assert (tmp_path / "mesh.glb").stat().st_size > 10_000
    check = "\nprint(metrics['iou_mean'], *(curve[-1] < curve[0] for curve in curves.values()))"
    mean, *fell = python(examples[1] + check, tmp_path).split()
    assert float(mean) > 0.9
    assert fell == ["True", "True"]


def test_photographs_that_show_nothing_leave_the_surface(photos):
    shown = silmesh.read_photographs(photos, size=SIZE)
    scene = silmesh.find_cameras(
        shown, silmesh.find_silhouettes(shown), KNOWN["cameras"], turntable=KNOWN["turntable"]
    )
    initial = silmesh.initial_mesh(scene, vertices=200)
    fitted = silmesh.fit(initial, scene, iterations=2)
    refined = silmesh.refine(fitted, scene, shown)
    assert refined.mesh is fitted.mesh
    assert "show nothing within the outlines" in refined.relief["said"]
    metrics = silmesh.evaluate(refined, scene)
    assert metrics["surface"]["photographs"] == 0
    assert sum(metrics["surface"].values()) == pytest.approx(1)
    assert len(refined.standing) == len(refined.mesh.vertices)
    report = silmesh.fit(initial, scene, preset="softras", iterations=2)
    with pytest.raises(InputError, match="only after 'fast'"):
        silmesh.refine(report, scene, shown)
