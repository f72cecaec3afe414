"""The folder in which the workflow makes one object: a table and a configuration, and its results.

It lies in the cache, named by the photographs, so that the same command goes on from what is there.
"""

import csv
import json
import os
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml

from silmesh.cli.photographs import is_video
from silmesh.config import NAME
from silmesh.datasets import COLUMNS, RESERVED
from silmesh.errors import InputError
from silmesh.files import replacing
from silmesh.lock import COMMAND, hold
from silmesh.plan import Plan
from silmesh.provenance import SOURCE
from silmesh.silhouettes.weights import cache_folder

TABLE, CONFIG = "datasets.tsv", "config.yaml"
PHOTOGRAPHS, MASKS = "photographs", "masks"  # folders of links
MADE_BY = "silmesh.json"
_taken: set[Path] = set()  # the locks that this process holds
TABLE_LINE = re.compile(rf"{re.escape(TABLE)}, line 2 \([\w-]+\): ")


def find_snakefile() -> Path:
    """The workflow's Snakefile: in the installed package, or in the project's folder."""
    installed = SOURCE / "silmesh" / "workflow" / "Snakefile"
    return installed if installed.is_file() else SOURCE.parent / "Snakefile"


def to_name(folder: str) -> str:
    """An object's name from a folder's."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", folder).strip("_-")[:80]
    return name if re.fullmatch(NAME, name) and name != RESERVED else "object"


def write_table(path: Path, rows: Sequence[Mapping[str, str]]) -> None:
    """Write a dataset list; a row has some of its columns."""
    with replacing(path) as part, open(part, "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS, restval="", delimiter="\t", lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


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

    def prepare(self) -> str | None:
        """Link the photographs and masks; the other version of silmesh that worked here, if any.

        Raises:
            InputError: another process makes something in the folder
        """
        _take(self.folder)
        _link(self.folder / PHOTOGRAPHS, self.photographs)
        _link(self.folder / MASKS, self.masks)
        file, now = self.folder / MADE_BY, version("silmesh")
        before = json.loads(file.read_text())["version"] if file.is_file() else now
        with replacing(file) as part:
            part.write_text(json.dumps({"version": now}) + "\n")
        return None if before == now else before

    def configure(self, row: Mapping[str, str], values: Mapping[str, Any]) -> None:
        """Write the table and the configuration, checked.

        Args:
            row: what the object's row says beside its name and its files
            values: the configuration without its table

        Raises:
            InputError: something in them, that is, on the command line, cannot be used
        """
        files = {"object": self.object, "images": PHOTOGRAPHS}
        masks = {"masks": MASKS} if self.masks else {}
        write_table(self.folder / TABLE, [files | masks | row])
        Plan({"datasets": self.folder / TABLE, **values}, "the options")
        with replacing(self.folder / CONFIG) as part:
            part.write_text(yaml.safe_dump({"datasets": TABLE, **values}, sort_keys=False))

    def result(self, variant: str, name: str) -> str:
        """The path of one of a variant's results, from the folder."""
        return f"results/{self.object}/{variant}/{name}"

    def restore(self, said: str) -> str:
        """A message with the person's own paths for the links to them."""
        said = TABLE_LINE.sub("", said.replace(f"{self.folder}/", ""))
        for folder, files in ((PHOTOGRAPHS, self.photographs), (MASKS, self.masks)):
            for file in files:
                said = re.sub(rf"(?<![\w/]){folder}/{re.escape(file.name)}\b", str(file), said)
        return said


def place_of(paths: Sequence[Path]) -> tuple[Path, str]:
    """The folder in the cache for what a person named, and the object's name."""
    first = paths[0].absolute()
    alone = first.stem if is_video(first) else first.parent.name
    name = to_name(first.name if first.is_dir() else alone)
    named = "\n".join(sorted(str(path.absolute()) for path in paths))
    return cache_folder() / "objects" / f"{name}-{zlib.crc32(named.encode()):08x}", name


def _take(folder: Path) -> None:
    """Keep other processes from preparing a folder while this one lives."""
    lock = (folder / COMMAND).absolute()
    lock.parent.mkdir(parents=True, exist_ok=True)
    if lock not in _taken and not hold(lock):
        raise InputError(f"another silmesh is at work in {folder}; wait for its end")
    _taken.add(lock)


def _link(folder: Path, files: Sequence[Path]) -> None:
    """Make a folder of links to these files, unless it is that already."""
    wanted = {file.name: str(file.absolute()) for file in files}
    there = folder.iterdir() if folder.is_dir() else ()
    if {link.name: os.readlink(link) for link in there} == wanted:
        return
    with replacing(folder) as part:
        part.mkdir()
        for name, target in wanted.items():
            (part / name).symlink_to(target)
