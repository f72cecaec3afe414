"""Writes a table and a configuration for a folder of many objects, ready for ``snakemake``."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from silmesh.cli.workspace import CONFIG, TABLE, find_snakefile, to_table, write_text
from silmesh.errors import InputError
from silmesh.files import try_file
from silmesh.intake import aloi, coil, shapenet
from silmesh.intake.photographs import (
    find_cameras,
    find_masks,
    find_photographs,
    folders_within,
)
from silmesh.intake.sources import choose_cameras, choose_silhouettes, look
from silmesh.intake.unpacked import Collection, Row
from silmesh.naming import quote
from silmesh.planning.datasets import to_name, usable

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
PROFILES = [Path(f"profiles/{name}/config.yaml") for name in ("default", "slurm", "kubernetes")]
LAYOUTS = {"aloi": aloi, "coil": coil, "shapenet": shapenet}  # of published data sets


def write_project(
    folder: Path,
    force: bool,
    layout: str | None = None,
    objects: str | None = None,
    source: str | None = None,
) -> Iterator[str]:
    """Write what ``snakemake`` needs into a folder of photographs of many objects.

    Args:
        folder: without a layout, each folder in it, but those of masks, has those of one object
        force: overwrite what is there
        layout: of a published data set, of ``LAYOUTS``
        objects: numbers of the objects of that, as ``1-10,17``; all that are there if not given
        source: address of the folder of ALOI's archives, if they are to be fetched
    Yields:
        lines that say what was chosen, and the next command

    Raises:
        InputError: there is no such folder in it, or one cannot be used, or files are there, or
            a file cannot be written
    """
    if objects is not None and layout is None:
        names = ", ".join(f"--{name}" for name in LAYOUTS)
        raise InputError(f"--objects: is of a published data set alone; needs one of {names}")
    if source is not None and layout != "aloi":
        raise InputError("--from: is of ALOI's archives alone; needs --aloi")
    within = folders_within(folder) if layout is None else []
    if not within and layout is None:
        raise InputError(_explain_none(folder))
    made = [folder / name for name in ("Snakefile", TABLE, CONFIG, *PROFILES)]
    if there := [str(path) for path in made if os.path.lexists(path) and not force]:
        raise InputError(f"{', '.join(there)}: is there already; --force overwrites it")
    for path in made:
        try_file(path)
    found = _find(folder, within, layout, objects, source)
    yield from found.tell()
    yield from _count(found.rows) if layout else ()
    flow = find_snakefile().parent / "workflow"
    profiles = [(flow / profile).read_text(encoding="utf-8") for profile in PROFILES]
    configuration = CONFIGURATION.replace("size: 256", f"size: {found.size}")
    texts = (SNAKEFILE, to_table(found.rows), configuration, *profiles)
    for path, text in zip(made, texts, strict=True):
        write_text(path, text)
    yield f"written: {', '.join(map(str, made[:3]))}; look at the table, then:"
    yield f"cd {quote(folder)} && snakemake --cores {os.cpu_count()}"


def _find(
    folder: Path,
    within: Sequence[Path],
    layout: str | None,
    objects: str | None,
    source: str | None,
) -> Collection:
    """The objects: those that are fetched, those of a published data set, or a folder each."""
    if source is not None:
        return aloi.name_rows(source, objects)
    return LAYOUTS[layout].find_rows(folder, objects) if layout else _collect(within, folder)


def _explain_none(folder: Path) -> str:
    """What to say of a folder without folders of photographs."""
    for name, layout in LAYOUTS.items():
        if layout.recognise(folder):
            return (
                f"{folder}: is laid out as a published data set; "
                f"`silmesh init --{name} {quote(folder)}` makes a table of its objects"
            )
    return (
        f"{folder}: has no folders with photographs, one for each object; "
        f"`silmesh {quote(folder)} -o mesh.glb` makes the one of a folder of photographs"
    )


def _count(rows: Sequence[Row]) -> Iterator[str]:
    """How many rows there are of each kind, in place of a line each."""
    kinds = Counter((row["silhouettes"], row["cameras"]) for row in rows)
    for (silhouettes, cameras), count in kinds.items():
        rows_of = "1 row" if count == 1 else f"{count:,} rows"
        yield f"{rows_of}: silhouettes {silhouettes}, cameras {cameras}"


def _collect(within: Sequence[Path], folder: Path) -> Collection:
    """The objects of a folder of folders, one each."""
    described = [_describe(path, folder) for path in within]
    found = Collection([row for row, _ in described])
    _refuse_equal_names(found.rows, within)
    for row, notes in described:
        found.said.append(
            f"{row['object']}: silhouettes {row['silhouettes']}, cameras {row['cameras']}"
        )
        found.said += (f"{row['object']}: {note}" for note in notes)
    return found


def _describe(photographs: Path, folder: Path) -> tuple[Row, list[str]]:
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


def _refuse_equal_names(rows: Sequence[Row], folders: Sequence[Path]) -> None:
    seen: dict[str, Path] = {}
    for row, folder in zip(rows, folders, strict=True):
        if row["object"] in seen:
            raise InputError(
                f"{folder}: would be the same object, {row['object']!r}, as "
                f"{seen[row['object']]}; rename one with other letters or digits"
            )
        seen[row["object"]] = folder
