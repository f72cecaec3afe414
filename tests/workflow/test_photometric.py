"""A fit after which photographs are asked: what is made, what is said, what runs again."""

import json

import numpy as np
import pytest

pytestmark = pytest.mark.slow
VARIANT = """\
  asked:
    init: {shape: sphere, vertices: 60, align: bbox}
    fit: {preset: fast, iterations: 3, photometric: auto}
"""
ASKING = "looking for what outlines cannot show"
MADE = "results/cup/asked/metrics.json"


@pytest.fixture
def asked(fresh):
    with open(fresh / "config/config.yaml", "a") as config:
        config.write(VARIANT)
    return fresh


def test_four_photographs_leave_the_mesh_as_it_is(asked):
    said = asked.run(MADE)
    assert "the surface stays as the outlines have it: of 4 photographs" in said
    made = asked / "results/cup/asked"
    assert (made / "mesh.ply").read_bytes() == (made / "outlines.ply").read_bytes()
    standing = np.load(made / "standing.npy")
    metrics = json.loads((made / "metrics.json").read_text())
    shares = np.bincount(standing, minlength=3) / metrics["vertices"]
    assert list(metrics["surface"].values()) == shares.tolist()
    assert metrics["surface"]["photographs"] == 0
    assert metrics["relief"]["taken"] is False
    assert "Nothing to be done" in asked.run("--dry-run", MADE)
    asked.edit("config/config.yaml", "photometric: auto", "photometric: false")
    said = asked.run("--dry-run", MADE)
    assert "cup/asked: fitting" in said
    assert ASKING not in said


def test_another_photograph_asks_again(asked):
    asked.run(MADE)
    photograph = asked / "photos/png2/cup/cup_r90.png"
    photograph.write_bytes((asked / "photos/png2/cup/cup_r0.png").read_bytes() + b"\\0")
    assert ASKING in asked.run("--dry-run", MADE)


def test_no_photographs_are_asked_elsewhere(fresh):
    fresh.edit(
        "config/config.yaml",
        "align: none}\n    fit: {preset: softras,",
        "align: none}\n    fit: {preset: softras, photometric: auto,",
    )
    status, said = fresh.snakemake("-n")
    assert status
    assert "fit.photometric: unknown key" in said
