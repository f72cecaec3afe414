"""A copy of the workflow with a tiny made-up object, and snakemake on it as a person runs it."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image, ImageDraw

ROOT = Path(__file__).parents[2]
VIEWS, WIDTH, HEIGHT = 4, 40, 32
CONFIG = """\
datasets: config/datasets.tsv
views: {size: 32, resize: pad}
variants:
  round:
    init: {shape: sphere, vertices: 60, align: none}
    fit: {preset: softras, iterations: 3}
  boxed:
    init: {shape: sphere, vertices: 60, align: bbox}
    fit: {preset: softras, iterations: 3}
"""
HEADER = "object\timages\tmasks\tsilhouettes\tcameras\tturntable\tvariants\n"
ROW = "cup\t../photos/png2/cup\t../photos/mask2/cup\tmask\tturntable\t2.732,0,90\t\n"


class Project:
    """A folder with the workflow in it."""

    def __init__(self, folder: Path):
        self.folder = folder

    def __truediv__(self, path: str) -> Path:
        return self.folder / path

    def edit(self, path: str, old: str, new: str) -> None:
        """Replace a piece of a file that is there once."""
        text = (self / path).read_text()
        assert text.count(old) == 1, (path, old)
        (self / path).write_text(text.replace(old, new))

    def add_object(self, name: str, centre: tuple[int, int] = (20, 16), views: int = VIEWS) -> None:
        """Draw a ball's photographs and masks in ALOI's layout, and add its row to the list."""
        for i in range(views):
            for kind, colour in (("png2", (200, 120, 40)), ("mask2", (255, 255, 255))):
                draw_ball(self / f"photos/{kind}/{name}/{name}_r{i * 90}.png", centre, colour)
        with open(self / "config/datasets.tsv", "a") as table:
            table.write(ROW.replace("cup", name))

    def start(self, *arguments: str, cores: int = 2, cwd: Path | None = None, **environment: str):
        """Start snakemake here in a process group of its own; its output is one text."""
        kept = {k: v for k, v in os.environ.items() if not k.startswith("SNAKEMAKE")}
        return subprocess.Popen(
            [sys.executable, "-m", "snakemake", "--cores", str(cores), *arguments],
            cwd=cwd or self.folder,
            env=kept | {"PYTHONPATH": str(self / "src")} | environment,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    def snakemake(self, *arguments: str, **settings) -> tuple[int, str]:
        """Run snakemake to its end: its exit status, and what it said."""
        process = self.start(*arguments, **settings)
        said, _ = process.communicate(timeout=300)
        return process.returncode, said

    def run(self, *arguments: str, **settings) -> str:
        """Run snakemake, which must succeed."""
        status, said = self.snakemake(*arguments, **settings)
        assert status == 0, said
        return said

    def outdated(self, *arguments: str, **settings) -> set[str]:
        """The jobs that a dry run lists, as step and output: ``fit cup/round``."""
        said = self.run("--dry-run", "--printshellcmds", *arguments, **settings)
        jobs = re.findall(r"silmesh\.steps (\w+) .*--(?:outputs?|meshes|page|table) (\S+)", said)
        counted = re.search(r"^total +(\d+)$", said, re.M)
        assert len(jobs) == (int(counted[1]) - 1 if counted else 0), said  # less the rule `all`
        return {f"{step} {_short(path)}" for step, path in jobs}

    def copy(self, folder: Path) -> "Project":
        """The same with results, metadata and time stamps, elsewhere."""
        shutil.copytree(self.folder, folder, symlinks=True)
        return Project(folder)


def _short(path: str) -> str:
    """``cup/32-pad`` of results/cup/stages/views/32-pad, ``cup/round`` of that mesh.ply."""
    path = re.sub(r"^results/(report/(figures|pictures|cameras|silhouettes|galleries)/)?", "", path)
    path = re.sub(r"/stages/\w+", "", path)
    return re.sub(r"(/mesh|/metrics|/report|/first)?\.\w+$", "", path)


def draw_ball(path: Path, centre: tuple[int, int], colour: tuple[int, int, int]) -> None:
    """A ball on black, a little higher than wide."""
    path.parent.mkdir(parents=True, exist_ok=True)
    x, y = centre
    image = Image.new("RGB", (WIDTH, HEIGHT))
    ImageDraw.Draw(image).ellipse((x - 6, y - 7, x + 6, y + 7), fill=colour)
    image.save(path)


def make_project(folder: Path) -> Project:
    """The workflow with one object, which runs two variants."""
    folder.mkdir(parents=True)
    shutil.copy(ROOT / "Snakefile", folder)
    for part in ("workflow", "src"):  # with __pycache__: numba need not compile anew
        shutil.copytree(ROOT / part, folder / part)
    (folder / "profiles").symlink_to("workflow/profiles")
    (folder / "config").mkdir()
    (folder / "config/config.yaml").write_text(CONFIG)
    (folder / "config/datasets.tsv").write_text(HEADER)
    project = Project(folder)
    project.add_object("cup")
    return project


@pytest.fixture
def fresh(tmp_path: Path) -> Project:
    """A project in which nothing has run; its folder's name has a space."""
    return make_project(tmp_path / "a project")


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Project:
    """A project that has run to its end; not to be changed."""
    project = make_project(tmp_path_factory.mktemp("finished") / "project")
    project.run()
    return project


@pytest.fixture
def project(finished: Project, tmp_path: Path) -> Project:
    """A copy of the finished project, to change something in."""
    return finished.copy(tmp_path / "moved")
