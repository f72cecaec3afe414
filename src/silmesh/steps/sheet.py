"""Draw a scene's silhouettes on their photographs, the doubtful ones marked."""

from collections.abc import Sequence
from pathlib import Path

from silmesh.files import replacing
from silmesh.report.gallery import Shot
from silmesh.report.sheet import Cell, draw_sheet
from silmesh.steps.command import parser, run
from silmesh.steps.shots import read_shots


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    args.add_argument("--judged", type=Path, required=True, help="the same after its judging")
    args.add_argument("--output", type=Path, required=True, help="PNG to write")
    given = args.parse_args(argv)
    cells = [_cell(shot) for shot in read_shots(given.scene, given.judged)]
    with replacing(given.output) as part:
        draw_sheet(cells).save(part, optimize=True)


def _cell(shot: Shot) -> Cell:
    """What the sheet shows of a view."""
    remark = f"{shot.fate}: {shot.doubt}" if shot.doubt else ""
    return Cell(shot.view, shot.photograph, shot.silhouette, shot.before, remark)


if __name__ == "__main__":
    run(main)
