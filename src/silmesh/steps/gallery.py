"""Describe the photographs and silhouettes of a scene for the page."""

import json
from collections.abc import Sequence
from pathlib import Path

from silmesh.files import replacing
from silmesh.report.gallery import Shot, describe_gallery
from silmesh.scene import read_scene
from silmesh.steps.command import parser, run
from silmesh.steps.shots import read_shots

LOST = "lost"  # a view without a camera


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--views", type=Path, required=True, help="folder of all working images")
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene as found")
    args.add_argument("--judged", type=Path, required=True, help="folder of the scene as fitted")
    args.add_argument("--output", type=Path, required=True, help="JSON to write")
    given = args.parse_args(argv)
    shots = read_shots(given.scene, given.judged)
    placed = {shot.view for shot in shots}
    told = read_scene(given.judged)[2]
    lost = {view: why for view, why in told["dropped"].items() if view not in placed}
    shots += [
        Shot(view, given.views / f"{view}.png", None, None, LOST, why) for view, why in lost.items()
    ]
    with replacing(given.output) as part:
        part.write_text(json.dumps(describe_gallery(shots)) + "\n")


if __name__ == "__main__":
    run(main)
