"""A variant with a texture beside one without: what is made of it, and what made again."""

import json

import pytest
import trimesh

pytestmark = pytest.mark.slow
CONFIG = """\
datasets: config/datasets.tsv
views: {size: 32, resize: pad}
variants:
  round:
    init: {shape: sphere, vertices: 60, align: none}
    fit: {preset: softras, iterations: 3, holdout: 4}
    texture: {size: 64}
  plain:
    init: {shape: sphere, vertices: 60, align: none}
    fit: {preset: softras, iterations: 3, holdout: 4}
"""
MADE = ("mesh.obj", "mesh.mtl", "mesh.png", "mesh.glb", "coloured.ply", "texture.json")
ROUND = "results/cup/round"


def after_texture() -> set[str]:
    after = {f"{step} cup/round" for step in ("texture", "picture", "evaluate")}
    return after | {"conclude report/comparison", "report report"}


def test_a_texture_is_made_measured_kept_and_made_again_where_it_should(fresh):
    (fresh / "config/config.yaml").write_text(CONFIG)
    fresh.run()
    assert fresh.outdated() == set()
    there = {path.name for path in (fresh / ROUND).iterdir()}
    assert there >= set(MADE)
    plain = {path.name for path in (fresh / "results/cup/plain").iterdir()}
    assert not plain & {"mesh.mtl", "mesh.png", "coloured.ply", "texture.json"}
    notes = json.loads((fresh / ROUND / "texture.json").read_text())

    told = json.loads((fresh / ROUND / "metrics.json").read_text())
    assert told["texture_size"] == 64
    assert told["texture_psnr_holdout"] == notes["held_out"]["psnr"]
    assert told["texture_psnr_holdout"] > 15
    none = json.loads((fresh / "results/cup/plain/metrics.json").read_text())
    assert none["texture_psnr_holdout"] is None
    head, *rows = (fresh / "results/report/summary.csv").read_text().splitlines()
    column = head.split(",").index("texture_psnr_holdout")
    assert [bool(row.split(",")[column]) for row in rows] == [True, False]
    read = trimesh.load_mesh(fresh / ROUND / "mesh.obj", process=False)
    assert read.visual.material.image.size == (64, 64)

    fresh.edit("config/config.yaml", "size: 64", "size: 128")
    assert fresh.outdated() == after_texture()
    fresh.edit("config/config.yaml", "size: 128", "size: 0")
    assert fresh.outdated() == {"colour cup/round"} | after_texture() - {"texture cup/round"}
    fresh.edit("config/config.yaml", "size: 0", "size: 64")
    fresh.edit("config/config.yaml", "  plain:", "  plain:\n    texture: {size: auto}")
    assert fresh.outdated() >= {"texture cup/plain", "picture cup/plain", "evaluate cup/plain"}
    (fresh / ROUND / "mesh.png").unlink()
    assert "texture cup/round" in fresh.outdated()
