"""The commands' virtual environment: which Python may make it, and when it is made."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# Stands for a Python of this version, whose environments hold a snakemake that says where it is.
PYTHON = """\
#!/bin/sh
case "$1 $2" in
    --version*) echo "Python {version}" ;;
    -c*) {suits} ;;
    "-m venv")
        echo venv >> "{log}"
        mkdir -p "$3/bin"
        printf '#!/bin/sh\\n{pip}\\n' > "$3/bin/python"
        printf '#!/bin/sh\\necho "$0" "$@"\\n' > "$3/bin/snakemake"
        chmod +x "$3/bin/python" "$3/bin/snakemake"
        ;;
esac
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """The commands in a project of their own, whose path has a space."""
    shutil.copytree(ROOT / "bin", tmp_path / "a project/bin")
    shutil.copy(ROOT / "pyproject.toml", tmp_path / "a project")
    return tmp_path / "a project"


def python(folder: Path, version: str = "3.12.1", suits: str = "exit 0", pip: str = "exit 0"):
    """A stand-in for Python; its calls of venv are written to ``log``."""
    path = folder / "python"
    path.write_text(PYTHON.format(version=version, suits=suits, pip=pip, log=folder / "log"))
    path.chmod(0o755)
    return path


def run(project: Path, interpreter: Path | str, *arguments: str):
    kept = {k: v for k, v in os.environ.items() if not k.startswith("SILMESH")}
    return subprocess.run(
        [project / "bin/run", *arguments],
        env=kept | {"SILMESH_PYTHON": str(interpreter)},
        capture_output=True,
        text=True,
        check=False,
    )


def times_made(tmp_path: Path) -> int:
    return len((tmp_path / "log").read_text().splitlines())


def test_an_environment_is_made_once(project, tmp_path):
    first = run(project, python(tmp_path), "-n")
    assert first.stdout == f"{project}/.venv/bin/snakemake --cores 2 -n\n"
    assert first.stderr.startswith(f"silmesh: installing into {project}/.venv ")
    assert run(project, python(tmp_path)).stderr == ""
    assert times_made(tmp_path) == 1


def test_it_is_made_anew_when_cut_short_or_moved_or_when_the_project_changed(project, tmp_path):
    assert run(project, python(tmp_path, pip="exit 3")).returncode == 1
    assert run(project, python(tmp_path)).returncode == 0
    assert times_made(tmp_path) == 2
    moved = project.rename(tmp_path / "moved")
    assert run(moved, python(tmp_path)).returncode == 0
    assert times_made(tmp_path) == 3
    with open(moved / "pyproject.toml", "a") as file:
        file.write("# changed\n")
    assert run(moved, python(tmp_path)).returncode == 0
    assert times_made(tmp_path) == 4


def test_a_python_that_does_not_suit_is_named(project, tmp_path):
    old = run(project, python(tmp_path, version="3.9.2", suits="exit 1"))
    assert old.returncode == 1
    assert old.stderr == (
        f"silmesh: {tmp_path}/python is Python 3.9.2; "
        "SILMESH_PYTHON should name a Python 3.11, 3.12 or 3.13\n"
    )
    none = run(project, "/no/python3")
    assert none.stderr.startswith("silmesh: /no/python3 is not there; SILMESH_PYTHON should")
    assert not (project / ".venv").exists()
