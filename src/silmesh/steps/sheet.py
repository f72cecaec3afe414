"""Draw a scene's silhouettes on their photographs, the doubtful ones marked."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from silmesh.files import replacing
from silmesh.judging.policy import DROPPED, REPAIRED
from silmesh.judging.table import read_table
from silmesh.report.sheet import Cell, draw_sheet
from silmesh.scene import SILHOUETTES, VIEWS
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    args.add_argument("--judged", type=Path, required=True, help="the same after its judging")
    args.add_argument("--output", type=Path, required=True, help="PNG to write")
    given = args.parse_args(argv)
    cells = [_cell(row, given.scene, given.judged) for row in read_table(given.judged)]
    with replacing(given.output) as part:
        draw_sheet(cells).save(part, optimize=True)


def _cell(row: Mapping[str, str], scene: Path, judged: Path) -> Cell:
    """What the sheet shows of a view; a dropped one as it was found."""
    view, fate = row["view"], row["fate"]
    found = read_silhouettes(scene / SILHOUETTES, [view])[0]
    dropped = fate == DROPPED
    fitted = found if dropped else read_silhouettes(judged / SILHOUETTES, [view])[0]
    remark = f"{fate}: {row['doubt']}" if row["doubt"] else ""
    before = found if fate == REPAIRED else None
    return Cell(view, scene / VIEWS / f"{view}.png", fitted, before, remark)


if __name__ == "__main__":
    run(main)
