"""Initial meshes by the workflow: several shapes, one chosen, and what the page says of them."""

import json

import pytest

SHAPES = """\
  chosen:
    init: {shape: auto, vertices: 200}
    fit: {iterations: 3}
  carved:
    init: {shape: hull, genus: sphere}
    fit: {iterations: 3}
"""


@pytest.mark.slow
def test_a_initial_mesh_is_chosen_and_told_on_the_page(project):
    project.edit("config/config.yaml", "  boxed:\n", SHAPES + "  boxed:\n")
    project.run()
    first = project / "results/cup/stages/first"
    key = "32-pad-mask-turntable-keep-3"
    told = json.loads((first / f"{key}-auto-200-bbox/init.json").read_text())
    assert told["asked"] == "auto"
    assert told["vertices"] == 200
    assert told["shape"] == next(iter(told["scores"]))
    assert (first / f"{key}-hull-auto-bbox-closed/first.ply").exists()
    metrics = json.loads((project / "results/cup/chosen/metrics.json").read_text())
    assert metrics["first"] == told
    page = (project / "results/report/report.html").read_text()
    assert f"Why the initial mesh of cup, chosen, is the {told['shape']}" in page
    assert "Why the initial mesh of cup, carved" not in page
