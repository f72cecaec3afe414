"""What a step does not import: its start is a large part of a small object's time."""

import subprocess
import sys

import pytest

HEAVY = {"torch", "numba", "scipy", "trimesh", "skimage", "pandas", "matplotlib", "igl"}
DRAWING = {"matplotlib", "pandas", "jinja2"}
COMPILER = {"torch._dynamo"}  # of torch, which takes as long as the rest of it


@pytest.mark.parametrize(
    ("step", "spared"),
    [
        ("views", HEAVY),
        ("calibrate", DRAWING | COMPILER | {"trimesh", "igl"}),
        ("scene", DRAWING | COMPILER | {"trimesh", "igl"}),
        ("judge", DRAWING | COMPILER | {"trimesh", "igl"}),
        ("first", DRAWING | COMPILER | {"igl"}),
        ("fit", DRAWING | COMPILER | {"igl"}),
        ("evaluate", DRAWING | COMPILER | {"igl"}),
        ("colour", DRAWING | COMPILER | {"igl", "numba"}),
    ],
)
def test_a_step_imports_only_what_it_needs(step, spared):
    asked = f"import sys, silmesh.steps.{step}; print(*sys.modules)"
    said = subprocess.run(
        [sys.executable, "-c", asked], check=True, text=True, capture_output=True
    ).stdout
    assert spared & set(said.split()) == set()


def test_the_snakefile_imports_nothing_heavy():
    asked = "import sys, silmesh.plan, silmesh.provenance, silmesh.lock; print(*sys.modules)"
    said = subprocess.run(
        [sys.executable, "-c", asked], check=True, text=True, capture_output=True
    ).stdout
    assert HEAVY & set(said.split()) == set()
