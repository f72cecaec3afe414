"""A report of more objects than one page can hold: an index, and beside it a page of each object.

The thumbnails are files of their own, which a browser reads as they come into sight.
"""

from base64 import b64decode
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from silmesh.files import making
from silmesh.report.overview import describe_numbers, encode_thumbnail, render
from silmesh.report.page import Result, write_page
from silmesh.report.parts import BASE
from silmesh.report.tables import Run

Told = tuple[Mapping[Run, Result], Mapping[tuple[str, str], Mapping[str, Any]], Mapping[str, Any]]


def write_index(
    objects: Iterable[tuple[str, Told]],
    pages: Path,
    settings: Mapping[str, Any],
    conclusions: Sequence[str],
    unfinished: Sequence[Mapping[str, str]],
    name: str,
) -> str:
    """Write a page of each object, and the index.

    Args:
        objects: name, and results, galleries and truths, as ``write_page`` takes them; one object
            is held in memory at a time
        pages: folder to make, beside the index
        settings, conclusions, unfinished: as ``write_page`` takes them
        name: of the file that the index is to be
    Returns:
        the index as HTML
    """
    rows, metrics = [], {}
    with making(pages) as folder:
        for object_, (results, galleries, truths) in objects:
            page = write_page(results, galleries, settings, truths, index=f"../{name}")
            (folder / f"{object_}.html").write_text(page, encoding="utf-8")
            rows.append(_describe_row(object_, results, folder, pages.name))
            metrics |= {run: result.metrics for run, result in results.items()}
    told = {"conclusions": conclusions, "unfinished": unfinished}
    return render(BASE, rows, metrics, settings, index="", beside="this page", **told)


def _describe_row(
    object_: str, results: Mapping[Run, Result], folder: Path, name: str
) -> dict[str, Any]:
    """What the overview shows of an object, whose thumbnails are written into the folder."""
    (folder / object_).mkdir()
    runs = []
    for (_, variant), result in results.items():
        thumbnail = f"{object_}/{variant}.webp"
        (folder / thumbnail).write_bytes(b64decode(encode_thumbnail(result.picture)))
        told = describe_numbers(variant, result.metrics)
        runs.append(told | {"thumbnail": f"{name}/{thumbnail}"})
    return {"name": object_, "link": f"{name}/{object_}.html", "runs": runs}
