"""The notebook of the docs: its cells run, one after another, and do what its text says."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parents[1] / "docs/notebook.ipynb"
CELLS = json.loads(NOTEBOOK.read_text())["cells"]
CODE = ["".join(cell["source"]) for cell in CELLS if cell["cell_type"] == "code"]
CHECKS = """
curves = {line.get_label(): line.get_ydata() for line in axis.lines}
assert set(curves) == {"sphere", "hull"}
assert all(curve[-1] < curve[0] for curve in curves.values())
assert curves["hull"][0] < curves["sphere"][0]
assert metrics["iou_mean"] > 0.97 and metrics["volume_iou"] > 0.85
assert mesh.visual.kind == "vertex" and (folder / "mesh.glb").stat().st_size
"""


@pytest.mark.slow
def test_the_cells_run_as_they_stand():
    script = "import matplotlib\nmatplotlib.use('Agg')\n" + "\n".join([*CODE, CHECKS])
    done = subprocess.run([sys.executable, "-c", script], text=True, capture_output=True)
    assert done.returncode == 0, done.stderr


def test_every_figure_is_kept_in_it():
    outputs = [output["data"] for cell in CELLS for output in cell.get("outputs", [])]
    drawn = sum("plt.subplots" in code for code in CODE)
    assert sum("image/png" in data for data in outputs) == drawn
    assert "iou_mean" in "".join(outputs[-1]["text/plain"])
