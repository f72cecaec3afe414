"""The sheet of an object's silhouettes: every photograph with its outline, outliers marked."""

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from silmesh.geometry.frame import find_box
from silmesh.report.gallery import Shot
from silmesh.report.pictures import (
    FINE,
    GROUND,
    INK,
    SILHOUETTE,
    draw_outlines,
    font,
    read_on_ground,
)

CELL, GAP, COLUMNS = 176, 8, 6  # pixels, and cells in a row
LINE, FIRST = 13, 18  # pixels of a further line of text, and of the first
AROUND = 1.3  # size of the part that is shown over that of the box around all silhouettes
MARK, BEFORE = (200, 40, 40), (240, 130, 30)
WORDS = 27  # letters in a line under a cell


def draw_sheet(cells: Sequence[Shot]) -> Image.Image:
    """Draw the photographs in rows, in their order: of each the same part, around the object.

    Args:
        cells: views, each with a silhouette
    """
    columns = min(COLUMNS, len(cells))
    rows = [cells[i : i + columns] for i in range(0, len(cells), columns)]
    heights = [CELL + FIRST + LINE * max(len(_lines(cell)) - 1 for cell in row) for row in rows]
    size = (GAP + columns * (CELL + GAP), GAP + sum(heights) + GAP * len(rows))
    sheet = Image.new("RGB", size, GROUND)
    part, top = _part_shown(cells), GAP
    for row, height in zip(rows, heights, strict=True):
        for i, cell in enumerate(row):
            _draw_cell(sheet, cell, part, (GAP + i * (CELL + GAP), top))
        top += height + GAP
    return sheet


def _part_shown(cells: Sequence[Shot]) -> tuple[float, float, float]:
    """Left, top and side, in working pixels, of a square around the silhouettes of all views."""
    drawn = [mask for cell in cells for mask in (cell.before, cell.silhouette) if mask is not None]
    shown = np.logical_or.reduce(drawn)
    size = max(shown.shape)
    if not shown.any():
        return 0, 0, size
    left, top, right, bottom = find_box(shown)
    side = min(size, AROUND * max(right - left, bottom - top))
    ends = ((left, right), (top, bottom))
    x, y = (np.clip((start + end - side) / 2, 0, size - side) for start, end in ends)
    return float(x), float(y), float(side)


def _draw_cell(
    sheet: Image.Image, cell: Shot, part: tuple[float, float, float], place: tuple[int, int]
) -> None:
    x, y, side = part
    image = read_on_ground(cell.photograph).resize(
        (FINE * CELL, FINE * CELL), Image.Resampling.BICUBIC, (x, y, x + side, y + side)
    )
    for mask, colour in ((cell.before, BEFORE), (cell.silhouette, SILHOUETTE)):
        if mask is not None:
            draw_outlines(image, mask, image.width / side, (x, y), colour, cell.frame)
    left, top = place
    sheet.paste(image.resize((CELL, CELL), Image.Resampling.BOX), place)
    draw = ImageDraw.Draw(sheet)
    if cell.doubt:
        draw.rectangle((left - 3, top - 3, left + CELL + 2, top + CELL + 2), outline=MARK, width=3)
    for n, line in enumerate(_lines(cell)):
        ink = MARK if n else INK
        draw.text((left, top + CELL + 4 + LINE * n), line, fill=ink, font=font(10))


def _lines(cell: Shot) -> list[str]:
    """What is written below a view: its name, and two lines of why it is an outlier."""
    remark = f"{cell.fate}: {cell.doubt}" if cell.doubt else ""
    return [cell.view[-WORDS:], *_wrap(remark)][:3]


def _wrap(text: str) -> list[str]:
    """Words in lines of at most ``WORDS`` letters."""
    lines: list[str] = []
    for word in text.split():
        if lines and len(lines[-1]) + len(word) < WORDS:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines
