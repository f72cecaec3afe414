"""What a step does not import: its start is a large part of a small object's time."""

import subprocess
import sys

import pytest

HEAVY = {"torch", "numba", "scipy", "trimesh", "skimage", "pandas", "matplotlib", "igl"}
DRAWING = {"matplotlib", "pandas", "jinja2"}
COMPILER = {"torch._dynamo"}  # of torch, which takes as long as the rest of it
STEP = """
import torch
from silmesh.fitting.adam import Adam
x = torch.zeros(3, requires_grad=True)
x.sum().backward()
Adam([x], (0.9, 0.99)).step(0.1)
"""


def modules_after(code: str) -> set[str]:
    """What a new Python has imported after it ran this."""
    said = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"],
        check=True,
        text=True,
        capture_output=True,
    )
    return set(said.stdout.split())


@pytest.mark.parametrize(
    ("steps", "spared"),
    [
        (("views", "silhouettes"), HEAVY),
        (("calibrate", "scene", "judge"), DRAWING | COMPILER | {"trimesh", "igl"}),
        (("initial", "fit", "evaluate"), DRAWING | COMPILER | {"igl"}),
        (("colour",), DRAWING | COMPILER | {"igl", "numba"}),
    ],
)
def test_steps_import_only_what_they_need(steps, spared):
    code = "\n".join(f"import silmesh.steps.{step}" for step in steps)
    assert spared & modules_after(code) == set()


def test_the_command_starts_without_what_the_steps_need():
    heavy = HEAVY - {"scipy", "skimage"} | DRAWING
    assert heavy & modules_after("import silmesh.cli.make") == set()


def test_a_step_of_adam_needs_no_compiler():
    assert COMPILER & modules_after(STEP) == set()
