"""The folder in which the workflow makes one object: a table and a configuration, and its results.

It lies in the cache, named by the photographs, so that the same command goes on from what is there.
"""

import csv
import hashlib
import io
import json
import os
import re
import zlib
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from silmesh.errors import InputError
from silmesh.files import PART, replacing, try_inside
from silmesh.intake.photographs import is_video
from silmesh.naming import SUFFIXES, name_views, natural_key
from silmesh.planning.datasets import COLUMNS, UNPRINTABLE, to_name
from silmesh.planning.lock import COMMAND, hold
from silmesh.planning.places import WRITTEN, try_places
from silmesh.planning.plan import Plan
from silmesh.planning.provenance import SOURCE
from silmesh.remote.cache import cache_folder

TABLE, CONFIG = "datasets.tsv", "config.yaml"
PHOTOGRAPHS, MASKS = "photographs", "masks"  # folders of links
MADE_BY = "silmesh.json"  # says that the folder is ours, and what was put into it
UNUSABLE = rf"{UNPRINTABLE}|[{{}}]"  # what a link's name has not
LONGEST = 200  # bytes of a link's name, of which the end tells most
_taken: set[Path] = set()  # the locks that this process holds
Link = tuple[str, str]  # name and target
TABLE_LINE = re.compile(rf"{re.escape(TABLE)}, line 2 \([\w-]+\): ")


def find_snakefile() -> Path:
    """The workflow's Snakefile: in the installed package, or in the project's folder."""
    installed = SOURCE / "silmesh" / "workflow" / "Snakefile"
    return installed if installed.is_file() else SOURCE.parent / "Snakefile"


def to_table(rows: Sequence[Mapping[str, str]]) -> str:
    """The text of a dataset list; a row has some of its columns."""
    text = io.StringIO(newline="")
    table = csv.DictWriter(text, COLUMNS, restval="", delimiter="\t", lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return text.getvalue()


def write_text(path: Path, text: str) -> None:
    """Write a file of text, whole or not at all."""
    with replacing(path) as part:
        part.write_bytes(text.encode())


def try_workspace(folder: Path, remedy: str) -> None:
    """Try whether a run can work in a folder, which nobody else has put anything into.

    Args:
        remedy: what a person may do where it cannot

    Raises:
        InputError: it cannot
    """
    try:
        _refuse_others(folder)
        for place in (folder, *(folder / name for name in WRITTEN)):
            try_inside(place)
    except InputError as error:
        raise InputError(f"{error}; {remedy}") from error


def claim(folder: Path) -> str:
    """Make a folder to work in, or take one that is empty or ours: the version that did so.

    Raises:
        InputError: it is neither
    """
    _refuse_others(folder)
    if not (made := _read_made(folder)):
        made = {"version": version("silmesh")}
        write_text(folder / MADE_BY, json.dumps(made) + "\n")
    return made["version"]


@dataclass(frozen=True)
class Workspace:
    """A folder of one object's.

    Attributes:
        folder: where it lies
        object: its name
        photographs, masks: the files, a mask each or none
    """

    folder: Path
    object: str
    photographs: tuple[Path, ...]
    masks: tuple[Path, ...]

    def check(self, row: Mapping[str, str], values: Mapping[str, Any]) -> None:
        """Check the options, and the places that a run with them writes into.

        Args:
            row: what the object's row says beside its name and its files
            values: the configuration without its table

        Raises:
            InputError: something in them, that is, on the command line, cannot be used
        """
        with TemporaryDirectory() as scratch:
            trial = replace(self, folder=Path(scratch))
            try:
                for name, links in trial._links().items():
                    _link(trial.folder / name, links, [])
                write_text(trial.folder / TABLE, trial._table(row))
                plan = Plan({"datasets": trial.folder / TABLE, **values}, "the options")
            except InputError as error:
                raise InputError(trial.restore(str(error))) from error
        try_places(plan, self.folder)

    def prepare(self) -> str | None:
        """Link the photographs and masks; the other version of silmesh that worked here, if any.

        Raises:
            InputError: the folder has what is not of silmesh, or another process works there
        """
        now, before = version("silmesh"), claim(self.folder)
        _take(self.folder)
        for name, links in self._links().items():
            place = self.folder / name
            ours = _ours(_links_in(place), _read_made(self.folder).get(name))
            self._note(**{name: sorted({*ours, *_wanted(links)})})
            _link(place, links, ours)
        self._note(version=now)
        return None if before == now else before

    def configure(self, row: Mapping[str, str], values: Mapping[str, Any]) -> None:
        """Write the table and the configuration, checked.

        Args:
            row, values: as in ``check``

        Raises:
            InputError: as ``check``, or somebody changed what was written before
        """
        self.check(row, values)
        _refuse_others(self.folder)
        config = yaml.safe_dump({"datasets": TABLE, **values}, sort_keys=False)
        for name, text in ((TABLE, self._table(row)), (CONFIG, config)):
            file, new = self.folder / name, hashlib.sha256(text.encode()).hexdigest()
            self._note(**{name: [_digest(file), new]})  # of both, for a kill may come between
            write_text(file, text)

    def _table(self, row: Mapping[str, str]) -> str:
        files = {"object": self.object, "images": PHOTOGRAPHS}
        return to_table([files | ({"masks": MASKS} if self.masks else {}) | row])

    def _note(self, **values: Any) -> None:
        """Keep in mind what is put into the folder."""
        write_text(self.folder / MADE_BY, json.dumps(_read_made(self.folder) | values) + "\n")

    def result(self, variant: str, name: str) -> str:
        """The path of one of a variant's results, from the folder."""
        return f"results/{self.object}/{variant}/{name}"

    def restore(self, said: str) -> str:
        """A message with the person's own paths for the links to them."""
        said = TABLE_LINE.sub("", said.replace(f"{self.folder}/", ""))
        for folder, links in self._links().items():
            for name, file in links.items():
                own = str(file)
                said = re.sub(
                    rf"(?<![\w/]){folder}/{re.escape(name)}\b", lambda _, own=own: own, said
                )
        return said

    def _links(self) -> dict[str, dict[str, Path]]:
        """The files by the names of the links to them, folder by folder; a mask's is its view's."""
        names = name_links(self.photographs)
        pairs = zip(names, self.masks, strict=False)
        return {
            PHOTOGRAPHS: {
                name + _ending(file): file
                for name, file in zip(names, self.photographs, strict=True)
            },
            MASKS: {name + _ending(mask): mask for name, mask in pairs},
        }


def place_of(paths: Sequence[Path], keep: Path | None = None) -> tuple[Path, str]:
    """The folder to work in for what a person named, and the object's name.

    Args:
        keep: the folder; None for one in the cache
    """
    first = paths[0].absolute()
    alone = first.stem if is_video(first) else first.parent.name
    name = to_name(first.name if first.is_dir() else alone)
    if keep:
        return keep.absolute(), name
    named = "\n".join(sorted(str(path.absolute()) for path in paths))
    digest = zlib.crc32(os.fsencode(named))
    return cache_folder().absolute() / "objects" / f"{name}-{digest:08x}", name


def name_links(files: Sequence[Path]) -> list[str]:
    """Names for links to photographs, without endings: their views', if rules can take these.

    They differ, and their natural order is that of the files, whose place in a turn counts.
    """
    clean = [re.sub(UNUSABLE, "_", name).encode() for name in name_views(files)]
    names = [name[-LONGEST:].decode(errors="ignore") for name in clean]
    order = [natural_key(name + file.suffix) for name, file in zip(names, files, strict=True)]
    hidden = any(name.startswith(".") for name in names)
    if len(set(names)) == len(names) and sorted(order) == order and not hidden:
        return names
    return [f"{place:04d}_{name}" for place, name in enumerate(names)]


def _ending(file: Path) -> str:
    """A file's ending, or one of an image's where it has none."""
    return file.suffix if file.suffix.lower() in SUFFIXES else SUFFIXES[0]


def _take(folder: Path) -> None:
    """Keep other processes from preparing a folder while this one lives."""
    lock = (folder / COMMAND).absolute()
    lock.parent.mkdir(exist_ok=True)
    if lock not in _taken and not hold(lock):
        raise InputError(f"another silmesh is at work in {folder}; wait for its end")
    _taken.add(lock)


def _refuse_others(folder: Path) -> None:
    """Refuse a folder, neither new nor empty, that is not ours, or what is not ours in it."""
    names = os.listdir(folder) if os.path.isdir(folder) else []
    if all(name.startswith(PART) for name in names):  # as a kill leaves of the first file
        return
    if not (made := _read_made(folder)):
        raise InputError(
            f"{folder}: holds {min(names)}, and is no folder that silmesh works in; should be a "
            "new or an empty one"
        )
    unnoted = [] if PHOTOGRAPHS in made else None  # an earlier silmesh noted only its version
    for file in (folder / TABLE, folder / CONFIG):
        known = made.get(file.name, unnoted)
        if file.is_file() and known is not None and _digest(file) not in known:
            raise InputError(
                f"{file}: was changed since silmesh wrote it; should be removed, or be run as it "
                "is by `snakemake`"
            )


def _read_made(folder: Path) -> dict[str, Any]:
    """What silmesh noted of what it put into a folder; nothing if the folder is not its own."""
    try:
        made = json.loads((folder / MADE_BY).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return made if isinstance(made, dict) and _is_note(made) else {}


def _is_note(made: Mapping[str, Any]) -> bool:
    """Whether what a file says has the shape of what silmesh notes."""
    digests = [made.get(name, []) for name in (TABLE, CONFIG)]
    links = [made.get(name, []) for name in (PHOTOGRAPHS, MASKS)]
    if not all(isinstance(noted, list) for noted in (*digests, *links)):
        return False
    words = [made.get("version"), *chain(*digests)]
    for link in chain(*links):
        words += link if isinstance(link, list) and len(link) == 2 else [None]
    return all(isinstance(word, str) for word in words)


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else ""


def _wanted(links: Mapping[str, Path]) -> list[Link]:
    return [(name, str(file.absolute())) for name, file in links.items()]


def _links_in(folder: Path) -> list[Link]:
    """Names and targets of what is in a folder; of what is no link, nothing as target.

    Raises:
        InputError: the folder is itself a link, or a file
    """
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise InputError(f"{folder}: is not of silmesh; should be removed")
    paths = folder.iterdir() if folder.is_dir() else ()
    return [(path.name, os.readlink(path) if path.is_symlink() else "") for path in paths]


def _ours(links: Sequence[Link], known: Sequence[Sequence[str]] | None) -> set[Link]:
    """Those that were put there by silmesh; before it noted which, all that are links."""
    noted = None if known is None else set(map(tuple, known))
    return {link for link in links if link[1] and (noted is None or link in noted)}


def _link(folder: Path, links: Mapping[str, Path], ours: Container[Link]) -> None:
    """Make a folder of links to these files, unless it is that already.

    Args:
        links: the files by the names of the links
        ours: those that may be removed for it

    Raises:
        InputError: something else is in it
    """
    there, wanted = set(_links_in(folder)), set(_wanted(links))
    for link in there - wanted:
        if link not in ours:
            raise InputError(
                f"{folder / link[0]}: was not put there by silmesh; should be elsewhere"
            )
    for name, _ in there - wanted:
        (folder / name).unlink()
    for name, target in wanted - there:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / name).symlink_to(target)  # whole or absent by itself
        except OSError as error:
            raise InputError(f"{folder / name}: cannot be written: {error.strerror}") from error
