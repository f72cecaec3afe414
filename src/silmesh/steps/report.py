"""Gather all runs' results in two tables and one page.

The plan says which runs there are, what their stages are called, and the configuration. A run is
read from ``<results>/<object>/<variant>/`` (``loss.csv``, ``metrics.json``) and, in the folder of
the page, from ``pictures/<object>/<variant>.png`` and ``exhibits/<object>/<variant>.json``; its
scene from ``<results>/<object>/stages/scenes/<scene>/`` and ``cameras/<object>/<scene>.png``, its
photographs from ``galleries/<object>/<judged>.json``.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from silmesh.files import replacing
from silmesh.geometry.mesh_files import read_mesh
from silmesh.report.page import Result, Scene, write_page
from silmesh.report.tables import (
    gather_losses,
    gather_metrics,
    read_losses,
    read_metrics,
    read_published,
)
from silmesh.scene.scene import read_scene
from silmesh.steps.command import output_file, parser, run
from silmesh.views import held_out

CONCLUDED = ("iou", "steps")  # measures of which the page says what can be concluded


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--plan", type=Path, required=True, help="JSON: runs, settings, objects")
    args.add_argument("--results", type=Path, default=Path("results"), help="their folder")
    args.add_argument("--losses", type=output_file, required=True, help="losses.csv to write")
    args.add_argument("--summary", type=output_file, required=True, help="summary.csv to write")
    args.add_argument("--page", type=output_file, required=True, help="report.html to write")
    args.add_argument("--conclusions", type=Path, required=True, help="comparison.csv")
    given = args.parse_args(argv)
    plan = json.loads(given.plan.read_text(encoding="utf-8"))
    folders = {(r["object"], r["variant"]): _folder(given.results, r) for r in plan["runs"]}
    losses = read_losses({run: folder / "loss.csv" for run, folder in folders.items()})
    metrics = read_metrics({run: folder / "metrics.json" for run, folder in folders.items()})
    made = given.page.parent
    published = plan["configuration"].get("published")
    curves = read_published(Path(published)) if published else {}
    results = {
        key: _read_result(planned, given.results, made, metrics[key], curves)
        for key, planned in zip(folders, plan["runs"], strict=True)
        if planned["replicate"] == 1
    }
    keys = dict.fromkeys((r["object"], r["judged"]) for r in plan["runs"])
    galleries = {key: _read_json(made / "galleries" / key[0] / f"{key[1]}.json") for key in keys}
    truths = {o: given.results / o / "stages" / "truth.ply" for o in plan["truths"]}
    meshes = {o: read_mesh(file) for o, file in truths.items()}
    compared = pd.read_csv(given.conclusions)
    conclusions = list(compared[compared["measure"].isin(CONCLUDED)]["conclusion"])
    page = write_page(results, galleries, plan, meshes, conclusions)
    with replacing(given.losses) as part:
        gather_losses(losses).to_csv(part, index=False)
    with replacing(given.summary) as part:
        gather_metrics(metrics).to_csv(part, index=False)
    with replacing(given.page) as part:
        part.write_text(page, encoding="utf-8")


def _folder(results: Path, planned: Mapping[str, Any]) -> Path:
    return results / planned["object"] / planned["variant"]


def _read_result(
    planned: Mapping[str, Any],
    results: Path,
    made: Path,
    metrics: Mapping[str, Any],
    curves: Mapping[tuple[str, str], pd.DataFrame],
) -> Result:
    object_, variant = planned["object"], planned["variant"]
    scene = read_scene(results / object_ / "stages" / "scenes" / planned["scene"])[2]
    judged = read_scene(results / object_ / "stages" / "judged" / planned["judged"])[2]
    world = {key: judged[key] for key in ("centre", "scale")}
    return Result(
        metrics,
        pd.read_csv(_folder(results, planned) / "loss.csv"),
        made / "pictures" / object_ / f"{variant}.png",
        _read_json(made / "exhibits" / object_ / f"{variant}.json"),
        Scene(
            planned["scene"], scene | world, made / "cameras" / object_ / f"{planned['scene']}.png"
        ),
        planned["judged"],
        curves.get((object_, planned["published"])),
        _name_held(metrics, planned["holdout"]),
        _read_seconds(planned["stages"]),
    )


def _name_held(metrics: Mapping[str, Any], holdout: int) -> list[str]:
    """The views that were kept out of the fit."""
    views = list(metrics.get("iou", {}))
    return [views[i] for i in held_out(len(views), holdout)]


def _read_json(file: Path) -> Any:
    return json.loads(file.read_text(encoding="utf-8"))


def _read_seconds(stages: Mapping[str, str]) -> dict[str, float]:
    """How long the stages took, of those that say it: Snakemake's benchmarks."""
    files = {stage: Path(file) for stage, file in stages.items()}
    return {
        stage: float(pd.read_csv(file, sep="\t")["s"].iloc[-1])
        for stage, file in files.items()
        if file.is_file()
    }


if __name__ == "__main__":
    run(main)
