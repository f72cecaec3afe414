"""Draw the photographs and silhouettes of a scene: all on a sheet, and small ones for the page."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from silmesh.files import replacing
from silmesh.report.gallery import Shot, describe_gallery
from silmesh.report.sheet import draw_sheet
from silmesh.scene.policy import DROPPED, REPAIRED
from silmesh.scene.quality_table import read_table
from silmesh.scene.scene import SILHOUETTES, VIEWS, read_scene
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import output_file, parser, run

LOST = "lost"  # a view without a camera


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--views", type=Path, required=True, help="folder of all working images")
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene as found")
    args.add_argument("--judged", type=Path, required=True, help="folder of the scene as fitted")
    args.add_argument("--sheet", type=output_file, required=True, help="PNG to write")
    args.add_argument(
        "--output", type=output_file, required=True, help="JSON for the page to write"
    )
    given = args.parse_args(argv)
    frames = read_scene(given.scene)[2].get("frames", {})
    shots = [
        _read(row, given.scene, given.judged, frames.get(row["view"]))
        for row in read_table(given.judged)
    ]
    with replacing(given.sheet) as part:
        draw_sheet(shots).save(part, optimize=True)
    shown = {shot.view for shot in shots}
    notes = read_scene(given.judged)[2]
    lost = {view: why for view, why in notes["dropped"].items() if view not in shown}
    shots += [
        Shot(view, given.views / f"{view}.png", None, None, LOST, why) for view, why in lost.items()
    ]
    with replacing(given.output) as part:
        part.write_text(json.dumps(describe_gallery(shots)) + "\n", encoding="utf-8")


def _read(row: Mapping[str, str], scene: Path, judged: Path, frame: Sequence[int] | None) -> Shot:
    """A view, as its row in the table says: a dropped one's silhouette is as it was found."""
    view, fate, doubt = row["view"], row["fate"], row["doubt"]
    photograph = scene / VIEWS / f"{view}.png"
    (found,) = read_silhouettes(scene / SILHOUETTES, [view])
    if fate == DROPPED:
        return Shot(view, photograph, found, None, fate, doubt, frame)
    (fitted,) = read_silhouettes(judged / SILHOUETTES, [view])
    before = found if fate == REPAIRED else None
    return Shot(view, photograph, fitted, before, fate, doubt, frame)


if __name__ == "__main__":
    run(main)
