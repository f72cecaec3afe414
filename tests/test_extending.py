"""The examples of docs/extending.md: carried out on a copy of the package, counted, and run."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image
from scenes import silhouettes, turntable

from silmesh.planning.provenance import SOURCE

PAGE = Path(__file__).parents[1] / "docs/extending.md"
PACKAGE = "silmesh/"
STEP = re.compile(r"(A new file|In) `([\w./]+)`:\n\n```(\w+)\n(.*?)```\n", re.DOTALL)
VIEWS, SIZE = 8, 64
MOST = {  # files of code that may change
    "Without a fork": 0,
    "A network that finds silhouettes": 2,
    "A primitive": 2,
    "A carved body": 2,
    "A parameter of a fit": 2,
    "A loss term": 3,
    "A preset": 2,
    "A renderer": 3,
    "A metric": 2,
    "A format of cameras": 3,
}
BEGIN = """\
import silmesh
from pathlib import Path
found = silmesh.find_silhouettes(silmesh.read_photographs("photos", size=64))
photographs = silmesh.read_photographs("photos", size=64)
scene = silmesh.find_cameras(photographs, found, "turntable", turntable="2.732,10,45")
def fit(shape="sphere", **told):
    first = silmesh.initial_mesh(scene, shape, vertices=162)
    return silmesh.fit(first, scene, **{"iterations": 4, "device": "cpu"} | told)
def moved(a, b):
    return abs(a.mesh.vertices - b.mesh.vertices).max()
"""
RUNS = {  # what each example is to do
    "Without a fork": """
from silmesh.planning.config import parse_config
told = parse_config({"datasets": "x.tsv", **configuration}, "the page").variants["mine"]
ours = silmesh.find_silhouettes(photographs, source=told.silhouettes)
assert (ours.silhouettes == found.silhouettes).mean() > 0.99
first = silmesh.initial_mesh(scene, told.init.shape)
assert len(first.mesh.vertices) == 642
fitted = silmesh.fit(first, scene, **told.fit.model_copy(update={"iterations": 3}).model_dump())
assert len(fitted.records) == 3
enough = {**told.fit.model_dump(), "options": {"enough": 0.99}}
assert len(silmesh.fit(first, scene, **enough).records) == 1
""",
    "A network that finds silhouettes": """
ours = silmesh.find_silhouettes(photographs, source="bright", size=64)
assert (ours.silhouettes == found.silhouettes).mean() > 0.99
""",
    "A primitive": """
mesh = silmesh.initial_mesh(scene, "octahedron", vertices=162).mesh
assert mesh.is_watertight and len(mesh.vertices) == 162
""",
    "A carved body": """
mesh = silmesh.initial_mesh(scene, "convex", vertices=162).mesh
assert mesh.is_watertight and len(mesh.vertices) == 162
assert mesh.volume > 0.97 * mesh.convex_hull.volume
""",
    "A parameter of a fit": """
assert fit(cameras_after=3).settings.cameras_after == 3
""",
    "A loss term": """
assert fit().records[0].edges > 0
assert fit(weights={"edges": 0.1}).mesh.area < fit().mesh.area
assert fit(preset="softras").records[0].edges > 0
""",
    "A preset": """
assert moved(fit(preset="cosine", last=1.0), fit(preset="softras")) == 0
assert moved(fit(preset="cosine"), fit(preset="softras")) > 1e-5
""",
    "A renderer": """
for preset in ("softras", "fast"):
    assert moved(fit(preset=preset, renderer="softer"), fit(preset=preset)) > 0
""",
    "A metric": """
assert 0.5 < silmesh.evaluate(fit(), scene)["roundness"] < 1
""",
    "A format of cameras": """
import numpy as np
rows = zip(scene.cameras.views, scene.cameras.K, scene.cameras.R, scene.cameras.t)
lines = [" ".join([v, *(repr(float(x)) for m in ms for x in m.flatten())]) for v, *ms in rows]
Path("cameras.krt").write_text("\\n".join(lines))
read = silmesh.find_cameras(photographs, found, "cameras.krt").cameras
assert np.allclose(read.R, scene.cameras.R, atol=1e-6)
""",
}


def read_sections() -> dict[str, str]:
    """What is under each heading of the page."""
    _, *parts = re.split(r"^## (.+)\n", PAGE.read_text(), flags=re.MULTILINE)
    return dict(zip(parts[::2], parts[1::2], strict=True))


SECTIONS = read_sections()


def carry_out(text: str, source: Path, beside: Path) -> set[str]:
    """Make the changes of an example; the files of the package that it changes or adds."""
    changed = set()
    for how, name, language, code in STEP.findall(text):
        file = (source if name.startswith(PACKAGE) else beside) / name
        if how == "A new file":
            assert language == "py"
            assert not file.exists()
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(code)
        else:
            assert language == "diff"
            file.write_text(patch(file.read_text(), code, name))
        changed.add(name)
    return {name for name in changed if name.startswith(PACKAGE)}


def patch(text: str, diff: str, name: str) -> str:
    """A text after a change whose context is there once."""
    lines = diff.splitlines(keepends=True)
    old = "".join(line[1:] for line in lines if line[0] in " -")
    new = "".join(line[1:] for line in lines if line[0] in " +")
    assert ("\n" + text).count("\n" + old) == 1, (name, old)
    return ("\n" + text).replace("\n" + old, "\n" + new)[1:]


def draw_photographs(folder: Path) -> None:
    folder.mkdir()
    for i, shown in enumerate(silhouettes(turntable(VIEWS, SIZE, elevation=10), (0.45, 0.3, 0.2))):
        pixels = np.full((SIZE, SIZE, 3), 20, np.uint8)
        pixels[shown] = (220, 200, 180)
        Image.fromarray(pixels).save(folder / f"r{i}.png")


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy of the package with all examples, photographs beside it, and what each changed."""
    folder = tmp_path_factory.mktemp("extended")
    shutil.copytree(SOURCE / PACKAGE, folder / "src" / PACKAGE)
    draw_photographs(folder / "photos")
    changed = {s: carry_out(t, folder / "src", folder) for s, t in SECTIONS.items()}
    return folder, changed


def test_every_example_is_counted_and_run():
    assert set(SECTIONS) == set(MOST) == set(RUNS)


@pytest.mark.parametrize("section", MOST)
def test_an_example_changes_few_files_of_code(copy, section):
    assert len(copy[1][section]) <= MOST[section]
    assert bool(copy[1][section]) == bool(MOST[section])


def test_the_page_counts_as_they_are(copy):
    rows = re.findall(r"^\| (\[.+\)) \| (\d) \|", PAGE.read_text(), re.MULTILINE)
    anchors = {s.lower().replace(" ", "-"): s for s in SECTIONS}
    said = {anchors[a]: int(n) for links, n in rows for a in re.findall(r"\(#([\w-]+)\)", links)}
    assert said == {section: len(files) for section, files in copy[1].items()}


@pytest.mark.slow
def test_the_examples_do_what_they_say(copy):
    folder, _ = copy
    (text,) = re.findall(r"```yaml\n(.*?)```", SECTIONS["Without a fork"], re.DOTALL)
    script = BEGIN + f"configuration = {yaml.safe_load(text)!r}\n"
    script += "".join(f"print({section!r})\n{run}" for section, run in RUNS.items())
    given = {"PYTHONPATH": str(folder / "src"), "SILMESH_CACHE": str(folder / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=folder,
        env=os.environ | given,
        text=True,
        capture_output=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines() == list(RUNS)


def test_the_copy_offers_what_was_added(copy):
    """The lists are all that the command and the configuration's checks know."""
    folder, _ = copy
    script = """
from silmesh.cli.main import main
from silmesh.planning.config import parse_config
make = {option.name: option for option in main.commands["make"].params}
assert "bright" in make["silhouettes"].type.choices and "cosine" in make["preset"].type.choices
fit = {"preset": "cosine", "last": 0.2, "renderer": "softer"}
init = {"shape": "octahedron"}
parse_config({"datasets": "x.tsv", "bright": {"size": 32}, "variants":
    {"a": {"silhouettes": "bright", "init": init, "fit": fit}}}, "here")
"""
    given = {"PYTHONPATH": str(folder / "src")}
    done = subprocess.run([sys.executable, "-c", script], env=os.environ | given, text=True)
    assert done.returncode == 0
