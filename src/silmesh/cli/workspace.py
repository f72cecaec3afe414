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
from silmesh.datasets import COLUMNS, RESERVED, UNPRINTABLE
from silmesh.files import replacing
from silmesh.naming import SUFFIXES, name_views, natural_key
from silmesh.plan import Plan
from silmesh.provenance import SOURCE
from silmesh.silhouettes.weights import cache_folder

TABLE, CONFIG = "datasets.tsv", "config.yaml"
PHOTOGRAPHS, MASKS = "photographs", "masks"  # folders of links
UNUSABLE = rf"{UNPRINTABLE}|[{{}}]"  # what a link's name has not
LONGEST = 200  # bytes of a link's name, of which the end tells most
MADE_BY = "silmesh.json"
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
        """Link the photographs and masks; the other version of silmesh that worked here, if any."""
        self.folder.mkdir(parents=True, exist_ok=True)
        for folder, links in self._links().items():
            _link(self.folder / folder, links)
        file, now = self.folder / MADE_BY, version("silmesh")
        before = json.loads(file.read_text(encoding="utf-8"))["version"] if file.is_file() else now
        with replacing(file) as part:
            part.write_text(json.dumps({"version": now}) + "\n", encoding="utf-8")
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
            part.write_text(
                yaml.safe_dump({"datasets": TABLE, **values}, sort_keys=False), encoding="utf-8"
            )

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


def place_of(paths: Sequence[Path]) -> tuple[Path, str]:
    """The folder in the cache for what a person named, and the object's name."""
    first = paths[0].absolute()
    alone = first.stem if is_video(first) else first.parent.name
    name = to_name(first.name if first.is_dir() else alone)
    named = "\n".join(sorted(str(path.absolute()) for path in paths))
    digest = zlib.crc32(os.fsencode(named))
    return cache_folder() / "objects" / f"{name}-{digest:08x}", name


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


def _link(folder: Path, links: Mapping[str, Path]) -> None:
    """Make a folder of links to these files, unless it is that already."""
    wanted = {name: str(file.absolute()) for name, file in links.items()}
    there = folder.iterdir() if folder.is_dir() else ()
    if {link.name: os.readlink(link) for link in there} == wanted:
        return
    with replacing(folder) as part:
        part.mkdir()
        for name, target in wanted.items():
            (part / name).symlink_to(target)
