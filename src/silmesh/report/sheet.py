"""The sheet of an object's silhouettes: every photograph with its outline, doubtful ones marked."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from silmesh.report.pictures import FINE, GROUND, INK, SILHOUETTE, draw_outlines, font

CELL, TEXT, GAP, COLUMNS = 176, 44, 8, 6  # pixels, and cells in a row
MARK, BEFORE = (200, 40, 40), (240, 130, 30)
WORDS = 27  # letters in a line under a cell


@dataclass(frozen=True)
class Cell:
    """One view of the sheet.

    Attributes:
        view: its name
        photograph: its working image
        silhouette: [size, size] bool, as it is fitted, or as it was found if it is not
        before: what was found, where it was segmented again, or None
        remark: what is said below, empty if there is nothing to say
    """

    view: str
    photograph: Path
    silhouette: np.ndarray
    before: np.ndarray | None
    remark: str


def draw_sheet(cells: Sequence[Cell]) -> Image.Image:
    """Draw the photographs in rows, in their order."""
    columns = min(COLUMNS, len(cells))
    rows = -(-len(cells) // columns)
    size = (GAP + columns * (CELL + GAP), GAP + rows * (CELL + TEXT + GAP))
    sheet = Image.new("RGB", size, GROUND)
    for i, cell in enumerate(cells):
        place = (GAP + i % columns * (CELL + GAP), GAP + i // columns * (CELL + TEXT + GAP))
        _draw_cell(sheet, cell, place)
    return sheet


def _draw_cell(sheet: Image.Image, cell: Cell, place: tuple[int, int]) -> None:
    with Image.open(cell.photograph) as opened:
        image = opened.convert("RGB").resize((FINE * CELL, FINE * CELL), Image.Resampling.BICUBIC)
    scale = image.width / cell.silhouette.shape[1]
    for mask, colour in ((cell.before, BEFORE), (cell.silhouette, SILHOUETTE)):
        if mask is not None:
            draw_outlines(image, mask, scale, (0, 0), colour)
    left, top = place
    sheet.paste(image.resize((CELL, CELL), Image.Resampling.BOX), place)
    draw = ImageDraw.Draw(sheet)
    if cell.remark:
        draw.rectangle((left - 3, top - 3, left + CELL + 2, top + CELL + 2), outline=MARK, width=3)
    lines = [cell.view[-WORDS:], *_wrap(cell.remark)]
    for n, line in enumerate(lines[:3]):
        ink = MARK if n else INK
        draw.text((left, top + CELL + 4 + 13 * n), line, fill=ink, font=font(10))


def _wrap(text: str) -> list[str]:
    """Words in lines of at most ``WORDS`` letters."""
    lines: list[str] = []
    for word in text.split():
        if lines and len(lines[-1]) + len(word) < WORDS:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines
