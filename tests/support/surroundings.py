"""Places that a person may name for an output, among files of their own, and what is there."""

import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

OURS = "out.glb"  # the name that is given for an output


def surround(folder: Path) -> Path:
    """A person's folder, with files, folders and links; where an output may go in it."""
    (folder / "album" / "deep").mkdir(parents=True)
    (folder / "album" / "thesis.txt").write_text("years of work")
    (folder / "album" / "deep" / "photograph.jpg").write_bytes(b"\xff\xd8")
    (folder / "album" / "closed").mkdir(mode=0o700)
    (folder / "album" / "link").symlink_to("deep/photograph.jpg")
    (folder / "lost").symlink_to("nowhere")
    (folder / "notes.txt").write_text("as it was")
    return folder / OURS


def look_around(folder: Path) -> dict[str, tuple[int, Any]]:
    """By its name the mode of each thing in a folder, and its target or its bytes."""
    return {path.relative_to(folder).as_posix(): _describe(path) for path in folder.rglob("*")}


def _describe(path: Path) -> tuple[int, Any]:
    mode = path.lstat().st_mode
    if stat.S_ISLNK(mode):
        return mode, os.readlink(path)
    return mode, path.read_bytes() if stat.S_ISREG(mode) else None


def nothing(place: Path) -> Path:
    return place


def file(place: Path) -> Path:
    place.write_text("of before")
    return place


def link_to_file(place: Path) -> Path:
    place.symlink_to("notes.txt")
    return place


def link_to_nothing(place: Path) -> Path:
    place.symlink_to("nothing.glb")
    return place


def empty_folder(place: Path) -> Path:
    place.mkdir(mode=0o750)
    return place


def full_folder(place: Path) -> Path:
    surround(place)
    return place


def link_to_full_folder(place: Path) -> Path:
    place.symlink_to("album")
    return place


def link_to_empty_folder(place: Path) -> Path:
    place.symlink_to("album/closed")
    return place


def pipe(place: Path) -> Path:
    os.mkfifo(place)
    return place


def missing_parent(place: Path) -> Path:
    return place.parent / "new" / "newer" / place.name


def parent_a_file(place: Path) -> Path:
    return place.parent / "notes.txt" / place.name


def grandparent_a_file(place: Path) -> Path:
    return place.parent / "notes.txt" / "new" / place.name


def parent_a_lost_link(place: Path) -> Path:
    return place.parent / "lost" / place.name


def no_permission(place: Path) -> Path:
    return Path("/proc") / place.name  # not even for root


def too_long(place: Path) -> Path:
    return place.with_name("a" * 300 + place.suffix)


Place = Callable[[Path], Path]
NOWHERE: tuple[Place, ...] = (
    *(parent_a_file, grandparent_a_file, parent_a_lost_link, no_permission, too_long),
)
FOLDERS: tuple[Place, ...] = (
    *(empty_folder, full_folder, link_to_full_folder, link_to_empty_folder),
)
FILES: tuple[Place, ...] = (file, link_to_file, link_to_nothing, pipe)
NEW: tuple[Place, ...] = (nothing, missing_parent)
PLACES: tuple[Place, ...] = (*NEW, *FILES, *FOLDERS, *NOWHERE)
NO_FILE: tuple[Place, ...] = (*FOLDERS, pipe, *NOWHERE)  # where no file can be written
NO_FOLDER: tuple[Place, ...] = (*FILES, *FOLDERS[1:], *NOWHERE)  # where no folder can be made
