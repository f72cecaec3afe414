"""The dataset list: a tab-separated table with one row an object, checked before any work.

A row whose images are several objects of an ``.npz`` stands for a row of each.
"""

import csv
import difflib
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from silmesh.cameras.locate import locate
from silmesh.cameras.sets import find_sets
from silmesh.errors import InputError, blaming, shorten
from silmesh.naming import (
    match_masks,
    name_views,
    order_photographs,
    pair_masks,
    split_masks,
    tell_spare,
)
from silmesh.own_code import own_file, refuse_lacking
from silmesh.planning.numbers import parse_numbers
from silmesh.reading import (
    ARCHIVE,
    IMAGES,
    VOXELS,
    count_objects,
    is_array,
    split_row,
)
from silmesh.remote.address import (
    ARCHIVES,
    MESHES,
    Address,
    fetched_folder,
    is_remote,
    parse_address,
)
from silmesh.settings.section import LONGEST_NAME, LONGEST_PATH, NAME
from silmesh.settings.silhouettes import check_source
from silmesh.settings.turntable import FEWEST, SOFTRAS_SHAPENET, Turntable, parse_turntable
from silmesh.synthetic import layout
from silmesh.views import FEWEST_VIEWS, count_array_views, list_images, list_masks

REQUIRED = ("object", "images", "silhouettes", "cameras")
OPTIONAL = ("masks", "turntable", "sets", "truth", "variants")
COLUMNS = REQUIRED + OPTIONAL
FETCHED = ("images", "masks", "truth")  # columns that may name what is afar
RESERVED = "report"  # a folder of results/
UNPRINTABLE = r"[\x00-\x1f\x7f\ud800-\udfff]"  # control characters, bytes that are no UTF-8


@dataclass(frozen=True)
class Dataset:
    """An object: a row of the table, with its paths resolved.

    Attributes:
        where: file and line, for messages
        object: its name
        images: the photographs in natural order, or one SoftRas ``.npy``, or an object of an
            ``.npz``, ``<file>.npz#3``, or the folder that photographs from afar are fetched into
        masks: the mask of each photograph, or none, or the folder that they are fetched into
        silhouettes, cameras: where they come from; a ``file:`` path is resolved
        turntable: what the row says of its geometry
        sets: the views of each set of photographs between which the object was turned over; empty
            for one set, or where it is to be found
        truth: the true mesh, if given, or the true voxels, an object of an ``.npz``
        variants: the experiments that it runs; empty for all
        notes: what was found and is not used, a line each
        afar: the addresses of what is fetched
    """

    where: str
    object: str
    images: tuple[Path, ...]
    masks: tuple[Path, ...]
    silhouettes: str
    cameras: str
    turntable: Turntable
    sets: tuple[tuple[str, ...], ...]
    truth: Path | None
    variants: tuple[str, ...]
    notes: tuple[str, ...] = ()
    afar: tuple[Address, ...] = ()

    @property
    def photographs(self) -> int | None:
        """How many there are; None where that is not known before they are fetched."""
        if fetched_folder(self.images[0]):
            return None
        array = is_array(self.images[0])
        return count_array_views(self.images[0]) if array else len(self.images)


def read_datasets(table: Path) -> list[Dataset]:
    """Read the dataset list.

    Raises:
        InputError: it cannot be read, lacks a column or a value, names an object twice, or names
            something that is not there; every message names the file and the line
    """
    rows = [(line, one) for line, row in _read_rows(table) for one in _expand(table, line, row)]
    lines: dict[str, int] = {}
    for line, row in rows:
        name = row["object"]
        if name in lines:
            raise InputError(
                f"{table}, line {line}: object {name!r} is also on line {lines[name]}; "
                "each object has one row"
            )
        lines[name] = line
    return [_parse_row(table, line, row) for line, row in rows]


def _read_rows(table: Path) -> list[tuple[int, dict[str, str]]]:
    """The table's rows with their line numbers; every known column is there in each."""
    try:
        with open(table, encoding="utf-8-sig", newline="") as file:
            lines = list(csv.reader(file, delimiter="\t"))
    except UnicodeDecodeError as error:
        raise InputError(f"{table}: is not in UTF-8; should be saved as that: {error}") from error
    except (OSError, ValueError, csv.Error) as error:  # as of a name that no locale can hold
        why = getattr(error, "strerror", None) or error  # the path is said already
        raise InputError(f"{table}: cannot be read as a tab-separated table: {why}") from error
    header = [name.strip() for name in lines[0]] if lines else []
    _check_header(table, header)
    width = max((i for i, name in enumerate(header, start=1) if name), default=0)
    rows = []
    for number, cells in enumerate(lines[1:], start=2):
        if not any(cell.strip() for cell in cells):
            continue
        if any("\n" in cell or "\r" in cell for cell in cells):
            raise InputError(f"{table}, line {number}: a cell opens with '\"' that does not close")
        named = {k: c.strip() for k, c in zip(header, cells, strict=False) if k}
        _refuse_unnamed(f"{table}, line {number}", cells, header, width)
        rows.append((number, dict.fromkeys(COLUMNS, "") | named))
    if not rows:
        raise InputError(f"{table}: has no row; each object to fit has one")
    return rows


def _expand(table: Path, line: int, row: dict[str, str]) -> list[dict[str, str]]:
    """A row of each of the objects that a row names of an ``.npz``; else the row itself."""
    name, mark, numbers = row["images"].partition(f"{ARCHIVE}#")
    if is_remote(name) or (not mark and not name.endswith(ARCHIVE)):
        return [row]
    cells = ("images", name.removesuffix(ARCHIVE) + ARCHIVE)
    with blaming(f"{table}, line {line} ({row['object']})"):
        file = _beside(table, cells[1])
        count = count_objects(file, IMAGES)
        if not numbers:
            raise InputError(
                f"images: {file}: holds {count} objects; should say which: "
                f"'{file.name}#3' one, '{file.name}#0-{count - 1}' all"
            )
        with blaming("images"):
            chosen = parse_numbers(numbers, 0, count - 1)
        if row["truth"].endswith(ARCHIVE):
            _refuse_other_count(_beside(table, row["truth"]), file, count)
    return [_of_number(row, cells[1], number, len(chosen) > 1) for number in chosen]


def _of_number(row: dict[str, str], file: str, number: int, several: bool) -> dict[str, str]:
    """The row of one of the objects that a row names."""
    truth = row["truth"]
    return row | {
        "object": f"{row['object']}_{number}" if several else row["object"],
        "images": f"{file}#{number}",
        "truth": f"{truth}#{number}" if truth.endswith(ARCHIVE) else truth,
    }


def _refuse_other_count(truth: Path, images: Path, count: int) -> None:
    """Refuse true voxels that are not those of the same objects."""
    if (voxels := count_objects(truth, VOXELS)) != count:
        raise InputError(
            f"truth: {truth}: holds {voxels} objects, but {images} {count}; should be those of the "
            "same class and split"
        )


def _refuse_unnamed(where: str, cells: Sequence[str], header: Sequence[str], width: int) -> None:
    """Refuse cells under no column's name; empty ones, as spreadsheets write, are none."""
    for i, cell in enumerate(cells):
        if not cell.strip() or (i < len(header) and header[i]):
            continue
        if i >= width:
            raise InputError(
                f"{where}: has {len(cells)} cells under {width} columns; cells are separated by "
                f"one tab each. The first too many is {cell.strip()!r}"
            )
        raise InputError(
            f"{where}: column {i + 1} has no name, but the cell {cell.strip()!r}; name the column "
            "or empty the cell"
        )


def _check_header(table: Path, header: list[str]) -> None:
    for name in REQUIRED:
        if name not in header:
            raise InputError(
                f"{table}: column {name!r} is missing; the columns are {', '.join(COLUMNS)} "
                f"(separated by tabs), of which {', '.join(REQUIRED)} are needed. "
                f"Found: {', '.join(header) or 'none'}"
            )
    for name in filter(None, header):
        near = difflib.get_close_matches(name, COLUMNS, n=1, cutoff=0.75)
        if name not in COLUMNS and near:
            raise InputError(f"{table}: unknown column {name!r}; did you mean {near[0]!r}?")
        if header.count(name) > 1:
            raise InputError(f"{table}: column {name!r} comes twice")


def _parse_row(table: Path, line: int, row: Mapping[str, str]) -> Dataset:
    where = f"{table}, line {line}"
    name = row["object"]
    if not re.fullmatch(NAME, name) or name == RESERVED:
        raise InputError(
            f"{where}: object {name!r} should be made of at most 80 letters, digits, '_' and '-' "
            f"(not first), and not be {RESERVED!r}"
        )
    where += f" ({name})"
    with blaming(where):
        images, beside = _find_images(table, row["images"])
        masks, notes = _find_masks(table, row["masks"], images, beside)
        cameras = resolve_cameras(table, row["cameras"])
        known = SOFTRAS_SHAPENET if split_row(images[0]) and cameras == "turntable" else ""
        turntable = parse_turntable(row["turntable"] or known)
        sets = _find_sets(row["sets"], images)
        _refuse_rounds(turntable, sets, images)
        afar = [parse_address(row[column]) for column in FETCHED if is_remote(row[column])]
        return Dataset(
            where=where,
            object=name,
            images=images,
            masks=masks,
            silhouettes=_resolve_silhouettes(table, row["silhouettes"]),
            cameras=cameras,
            turntable=turntable,
            sets=sets,
            truth=_find_truth(table, row["truth"]) if row["truth"] else None,
            variants=tuple(dict.fromkeys(re.findall(r"[^,\s]+", row["variants"]))),
            notes=tuple(f"{where}: {note}" for note in notes),
            afar=tuple(afar),
        )


def _beside(table: Path, path: str) -> Path:
    """A path of the table, which is relative to the table itself."""
    return usable(Path(os.path.normpath(table.parent / os.path.expanduser(path))))


def _place_afar(column: str, cell: str) -> Path:
    """Where what is fetched for a column will lie: a folder of images, or a mesh."""
    with blaming(column):
        address = parse_address(cell)
        if column == "truth" and not address.is_mesh:
            raise InputError(
                f"{cell}: should be a mesh ({', '.join(MESHES)}), or one in an archive"
            )
        if column != "truth" and not address.holds_images:
            raise InputError(
                f"{cell}: should be an archive of photographs ({', '.join(ARCHIVES)}), or a "
                "folder of s3://"
            )
    return address.file if column == "truth" else address.folder


def to_name(folder: str) -> str:
    """An object's name from a folder's."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", folder).strip("_-")[:80]
    return name if re.fullmatch(NAME, name) and name != RESERVED else "object"


def usable(path: Path) -> Path:
    """The path, if rules and figures can be made of it.

    Raises:
        InputError: it has something that Snakemake or a text file cannot hold
    """
    text = str(path)
    if "{" in text or "}" in text:
        raise InputError(f"{path}: a path with '{{' or '}}' cannot be used: Snakemake's wildcards")
    if len(whole := os.fsencode(text)) > LONGEST_NAME:
        longest = max(map(len, whole.split(b"/")))
        if longest > LONGEST_NAME or len(text) > LONGEST_PATH:
            raise InputError(
                f"{shorten(text)}: is a path of {len(text)} characters with a name of "
                f"{longest}; should be at most {LONGEST_PATH} and {LONGEST_NAME}"
            )
    if not text.isprintable() and (bad := re.search(UNPRINTABLE, text)):
        raise InputError(f"{text!r}: a path with {bad[0]!r} cannot be used; rename it")
    return path


def _find_images(table: Path, cell: str) -> tuple[tuple[Path, ...], list[Path]]:
    """The photographs, and the masks that lie beside them."""
    if not cell:
        raise InputError("images: is empty; should be a folder, a glob or a SoftRas .npy")
    if is_remote(cell):
        return (_place_afar("images", cell),), []
    path = _beside(table, cell)
    if made := layout.promised_files(path):
        return made, []
    masks: list[Path] = []
    if not is_array(path):
        photographs, masks = split_masks(list_images(path))
        images = tuple(map(usable, order_photographs(photographs)))
        count = len(images)
    else:
        images, count = (path,), count_array_views(path)
    if count < FEWEST_VIEWS:
        what = "is" if images == (path,) and not is_array(path) else "holds"
        raise InputError(
            f"{path}: {what} {count} photograph; a fit needs at least {FEWEST_VIEWS}, "
            "from a folder, a glob or a SoftRas .npy"
        )
    return images, masks


def _find_masks(
    table: Path, cell: str, images: tuple[Path, ...], beside: list[Path]
) -> tuple[tuple[Path, ...], list[str]]:
    """The mask of each photograph, or none, and what is not used."""
    if not cell:
        return _take_beside(images, beside)
    if is_remote(cell):
        return (_place_afar("masks", cell),), []
    if fetched_folder(images[0]):
        raise InputError(
            f"masks: {cell}: lie here, but the photographs afar; should both be fetched, or both "
            "be here"
        )
    path = _beside(table, cell)
    if is_array(images[0]):
        raise InputError(f"masks: {path}: an array of images has its masks in its alpha channel")
    masks, spare = match_masks(images, layout.promised_files(path) or list_masks(path, images))
    return tuple(map(usable, masks)), tell_spare(spare)


def _take_beside(
    images: tuple[Path, ...], beside: list[Path]
) -> tuple[tuple[Path, ...], list[str]]:
    """Masks that lie among the photographs, if each of these has one."""
    found, spare = pair_masks(images, beside) if beside else ([], [])
    if beside and all(found):
        return tuple(usable(masks[0]) for masks in found), tell_spare(spare)
    bare = [image for image, masks in zip(images, found, strict=False) if not masks]
    return (), [f"not used: {m}: {b} has no mask" for m, b in zip(beside[:1], bare, strict=False)]


def _resolve_silhouettes(table: Path, cell: str) -> str:
    """Where silhouettes come from, the path of a person's own function made one from here."""
    if (file := own_file(check_source(cell))) is None:
        return cell
    found = f"{_beside(table, str(file))}:{cell.rpartition(':')[2]}"
    refuse_lacking("silhouettes", found)
    return found


def resolve_cameras(table: Path, cell: str) -> str:
    """Check where cameras come from, and make the path of ``file:<path>`` one from here.

    A folder becomes the file in it that is read, or the folder of a model or of matrices.
    """
    if cell in ("turntable", "calibrate", "colmap", "auto"):
        return cell
    kind, _, name = cell.partition(":")
    if is_remote(name):
        raise InputError("cameras: a file of cameras is not fetched; should be a path")
    if kind != "file" or not name:
        raise InputError(
            "cameras: should be 'turntable', 'calibrate', 'colmap', 'auto' or 'file:<path>', "
            f"not {shorten(cell)}"
        )
    with blaming("cameras"):
        path = _beside(table, name.strip())
        try:
            return f"file:{locate(path).path}"
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def _find_sets(cell: str, images: Sequence[Path]) -> tuple[tuple[str, ...], ...]:
    """The views of each set that a row names."""
    if fetched_folder(images[0]):
        if cell:
            raise InputError(
                "sets: photographs from afar are not known by name before they are fetched; "
                "should be empty, or the photographs be here"
            )
        return ()
    if cell and is_array(images[0]):
        raise InputError("sets: an array has no names of views, by which they are told apart")
    return find_sets(cell, name_views(images), [image.parent.name for image in images])


def _refuse_rounds(
    turntable: Turntable, sets: tuple[tuple[str, ...], ...], images: Sequence[Path]
) -> None:
    """Refuse rounds of which the photographs are too few, or beside sets."""
    rounds = len(turntable.rounds)
    if rounds > 1 and sets:
        raise InputError(
            f"turntable: names {rounds} rounds about one axis, and sets {len(sets)} sets, between "
            "which the object was turned over; should be what is known of all sets, as ',,20', "
            "or sets empty"
        )
    known = not is_array(images[0]) and not fetched_folder(images[0])
    if rounds > 1 and known and rounds * FEWEST > len(images):
        raise InputError(
            f"turntable: names {rounds} rounds of {len(images)} photographs; each round should "
            f"have {FEWEST} or more"
        )


def _find_truth(table: Path, cell: str) -> Path:
    if is_remote(cell):
        return _place_afar("truth", cell)
    path = _beside(table, cell)
    if row := split_row(path):
        count_objects(row[0], VOXELS)
        return path
    try:
        if not layout.is_promised(path) and not path.is_file():
            raise InputError(f"truth: {path}: is not there")
    except OSError as error:
        raise InputError(f"truth: {path}: cannot be read: {error.strerror}") from error
    return path
