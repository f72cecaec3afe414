"""What the report shows of the runs of a plan, read object by object from their files.

A run lies in ``<results>/<object>/<variant>/`` (``loss.csv``, ``metrics.json``) and, in the folder
of the page, in ``pictures/<object>/<variant>.png`` and ``exhibits/<object>/<variant>.json``; its
scene in ``<results>/<object>/stages/scenes/<scene>/`` and ``cameras/<object>/<scene>.png``, its
photographs in ``galleries/<object>/<judged>.json``.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import trimesh

from silmesh.geometry.mesh_files import read_mesh
from silmesh.report.index import write_index
from silmesh.report.page import Result, Scene, write_page
from silmesh.report.parts import LISTED
from silmesh.report.tables import Run, read_published
from silmesh.scene.scene import read_scene
from silmesh.views import held_out

Galleries = dict[tuple[str, str], Mapping[str, Any]]
Told = tuple[dict[Run, Result], Galleries, dict[str, trimesh.Trimesh]]


class RunFiles:
    """The runs of a plan, or some of them.

    Attributes:
        objects: their names, in the order of the plan
    """

    def __init__(self, plan: Mapping[str, Any], results: Path, made: Path):
        """Look at the plan (``plan.json``); ``made`` is the folder of the report."""
        self._plan, self._results, self._made = plan, results, made
        self._runs: dict[str, list[Mapping[str, Any]]] = {}
        for planned in plan["runs"]:
            self._runs.setdefault(planned["object"], []).append(planned)
        published = plan["configuration"].get("published")
        self._curves = read_published(Path(published)) if published else {}
        self.objects = list(self._runs)

    def read(self, objects: Sequence[str]) -> Told:
        """Results, galleries and true meshes of objects, as ``write_page`` takes them."""
        planned = [run for object_ in objects for run in self._runs[object_]]
        results = {
            (run["object"], run["variant"]): self._read_result(run)
            for run in planned
            if run["replicate"] == 1
        }
        keys = dict.fromkeys((run["object"], run["judged"]) for run in planned)
        galleries = {
            (object_, judged): _read_json(self._made / "galleries" / object_ / f"{judged}.json")
            for object_, judged in keys
        }
        truths = {
            object_: read_mesh(self._results / object_ / "stages" / "truth.ply")
            for object_ in objects
            if object_ in self._plan["truths"]
        }
        return results, galleries, truths

    def _read_each(self) -> Iterator[tuple[str, Told]]:
        for object_ in self.objects:
            yield object_, self.read([object_])

    def compose(
        self,
        page: Path,
        pages: Path,
        conclusions: Sequence[str] = (),
        unfinished: Sequence[Mapping[str, str]] = (),
    ) -> str:
        """The text of the report at ``page``.

        Of more objects than LISTED it is an index, and each has a page of its own, which are
        written into the folder ``pages``.
        """
        if len(self.objects) <= LISTED:
            results, galleries, truths = self.read(self.objects)
            return write_page(results, galleries, self._plan, truths, conclusions, unfinished)
        told = conclusions, unfinished
        return write_index(self._read_each(), pages, self._plan, *told, page.name)

    def _read_result(self, planned: Mapping[str, Any]) -> Result:
        object_, variant = planned["object"], planned["variant"]
        folder, stages = find_folder(self._results, planned), self._results / object_ / "stages"
        scene = read_scene(stages / "scenes" / planned["scene"])[2]
        judged = read_scene(stages / "judged" / planned["judged"])[2]
        world = {key: judged[key] for key in ("centre", "scale")}
        rings = self._made / "cameras" / object_ / f"{planned['scene']}.png"
        metrics = _read_json(folder / "metrics.json")
        return Result(
            metrics,
            pd.read_csv(folder / "loss.csv"),
            self._made / "pictures" / object_ / f"{variant}.png",
            _read_json(self._made / "exhibits" / object_ / f"{variant}.json"),
            Scene(planned["scene"], scene | world, rings),
            planned["judged"],
            self._curves.get((object_, planned["published"])),
            _name_held(metrics, planned["holdout"]),
            _read_seconds(planned["stages"]),
        )


def find_folder(results: Path, planned: Mapping[str, Any]) -> Path:
    """Where the files of a run of the plan lie."""
    return results / planned["object"] / planned["variant"]


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
