"""Gather all runs' results in two tables and one page.

A run is read from ``<results>/<object>/<variant>/`` (``loss.csv``, ``metrics.json``) and, in the
folder of the page, from ``pictures/<object>/<variant>.png`` and ``figures/<object>.svg``; its scene
from ``<results>/<object>/stages/scenes/<scene>/`` and ``cameras/<object>/<scene>.png``.
"""

import json
from collections.abc import Sequence
from pathlib import Path

from silmesh.files import replacing
from silmesh.report.page import Scene, write_page
from silmesh.report.tables import gather_losses, gather_metrics, read_losses, read_metrics
from silmesh.scene import read_scene
from silmesh.steps.command import parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--results", type=Path, required=True, help="folder of the results")
    args.add_argument("--runs", nargs="+", required=True, help="OBJECT/VARIANT/SCENE, in order")
    args.add_argument("--settings", required=True, help="JSON: configuration and objects")
    args.add_argument("--sheets", nargs="*", type=Path, default=[], help="<object>/<how>.png each")
    args.add_argument("--losses", type=Path, required=True, help="losses.csv to write")
    args.add_argument("--summary", type=Path, required=True, help="summary.csv to write")
    args.add_argument("--page", type=Path, required=True, help="report.html to write")
    given = args.parse_args(argv)
    scene_of = {(o, v): scene for o, v, scene in (run.split("/") for run in given.runs)}
    runs = list(scene_of)
    folders = {run: given.results / run[0] / run[1] for run in runs}
    made = given.page.parent
    losses = read_losses({run: folder / "loss.csv" for run, folder in folders.items()})
    metrics = read_metrics({run: folder / "metrics.json" for run, folder in folders.items()})
    figures = {object_: made / "figures" / f"{object_}.svg" for object_, _ in runs}
    pictures = {run: made / "pictures" / run[0] / f"{run[1]}.png" for run in runs}
    scenes = {
        run: Scene(
            key,
            read_scene(given.results / run[0] / "stages" / "scenes" / key)[2],
            made / "cameras" / run[0] / f"{key}.png",
        )
        for run, key in scene_of.items()
    }
    sheets = {
        object_: [sheet for sheet in given.sheets if sheet.parent.name == object_]
        for object_ in figures
    }
    page = write_page(metrics, figures, pictures, scenes, json.loads(given.settings), sheets)
    with replacing(given.losses) as part:
        gather_losses(losses).to_csv(part, index=False)
    with replacing(given.summary) as part:
        gather_metrics(metrics).to_csv(part, index=False)
    with replacing(given.page) as part:
        part.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    run(main)
