"""Writes a table and a configuration for a folder of folders, ready for ``snakemake``."""

import os
from collections.abc import Iterator
from pathlib import Path

from silmesh.cli.workspace import CONFIG, TABLE, find_snakefile, to_name, to_table, write_text
from silmesh.errors import InputError
from silmesh.files import try_file
from silmesh.intake.photographs import (
    find_cameras,
    find_masks,
    find_photographs,
    folders_within,
)
from silmesh.intake.sources import choose_cameras, choose_silhouettes, look
from silmesh.naming import quote
from silmesh.planning.datasets import usable

SNAKEFILE = """\
# The workflow of the silmesh that is installed, on the table and the configuration beside this.
from silmesh.cli.workspace import find_snakefile
from silmesh.planning.yamls import main as refuse_wrong

refuse_wrong(["--configfile", "config.yaml"])


configfile: "config.yaml"


include: find_snakefile()


# What is included makes nothing by itself.
rule meshes:
    input:
        rules.all.input,
"""
CONFIGURATION = """\
# What is made of every object of datasets.tsv; all keys are in silmesh's manual.
datasets: datasets.tsv
views: {size: 256, resize: pad}   # the working images
texture: {size: auto}             # or its side in pixels; 0: colours of the vertices
quality: {policy: auto}           # of outliers among the silhouettes: keep, drop, repair, auto
variants:                         # experiments by name; each object runs every one
  mesh:
    init: {shape: hull}           # or sphere, ellipsoid, cylinder, cube, prism, auto
    fit: {preset: fast}           # or softras: the report's procedure, slow
"""
PROFILE = Path("profiles/default/config.yaml")


def write_project(folder: Path, force: bool) -> Iterator[str]:
    """Write what ``snakemake`` needs into a folder of folders of photographs.

    Args:
        folder: each folder in it, but those of masks, has the photographs of one object
        force: overwrite what is there
    Yields:
        lines that say what was chosen, and the next command

    Raises:
        InputError: there is no such folder in it, or one cannot be used, or files are there, or
            a file cannot be written
    """
    within = folders_within(folder)
    if not within:
        raise InputError(
            f"{folder}: has no folders with photographs, one for each object; "
            f"`silmesh {quote(folder)} -o mesh.glb` makes the one of a folder of photographs"
        )
    made = [folder / name for name in ("Snakefile", TABLE, CONFIG, str(PROFILE))]
    if there := [str(path) for path in made if os.path.lexists(path) and not force]:
        raise InputError(f"{', '.join(there)}: is there already; --force overwrites it")
    for path in made:
        try_file(path)
    described = [_describe(path, folder) for path in within]
    rows = [row for row, _ in described]
    _refuse_equal_names(rows, within)
    for row, notes in described:
        yield f"{row['object']}: silhouettes {row['silhouettes']}, cameras {row['cameras']}"
        yield from (f"{row['object']}: {note}" for note in notes)
    profile = (find_snakefile().parent / "workflow" / PROFILE).read_text(encoding="utf-8")
    texts = (SNAKEFILE, to_table(rows), CONFIGURATION, profile)
    for path, text in zip(made, texts, strict=True):
        write_text(path, text)
    yield f"written: {', '.join(map(str, made[:3]))}; look at the table, then:"
    yield f"cd {quote(folder)} && snakemake --cores {os.cpu_count()}"


def _describe(photographs: Path, folder: Path) -> tuple[dict[str, str], list[str]]:
    """An object's row of the table, and what is said of its files."""
    files, notes = find_photographs([photographs])
    (masks, lacking), seen = find_masks(files), look(files)
    for path in [Path(photographs.name), *files, *masks]:
        usable(path)
    row = {"object": to_name(photographs.name), "images": photographs.name}
    if masks:
        row["masks"] = os.path.relpath(masks[0].parent, folder)
    row["silhouettes"], _ = choose_silhouettes(seen, masks, str(photographs))
    tries, _ = choose_cameras(seen)
    return row | {"cameras": tries[0]}, [*notes, *lacking, *find_cameras(files)]


def _refuse_equal_names(rows: list[dict[str, str]], folders: list[Path]) -> None:
    seen: dict[str, Path] = {}
    for row, folder in zip(rows, folders, strict=True):
        if row["object"] in seen:
            raise InputError(
                f"{folder}: would be the same object, {row['object']!r}, as "
                f"{seen[row['object']]}; rename one with other letters or digits"
            )
        seen[row["object"]] = folder
