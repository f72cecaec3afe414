"""What a person names: the photographs of one object, and perhaps masks; what it is if not that."""

import re
import shlex
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

from PIL import Image

from silmesh.errors import InputError
from silmesh.views import SUFFIXES, find_images, match_masks, natural_key

VIDEOS = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mts", ".3gp")
UNREAD = (".heic", ".heif", ".avif", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".gif")
MASKS = ("masks", "mask", "silhouettes")  # names of folders in or beside one of photographs
FEWEST = 2  # photographs
SERIES = 3  # photographs of names alike, from which they are taken for an object's
MAKER, MODEL = 271, 272  # EXIF


def is_video(path: Path) -> bool:
    """Whether a path's ending is that of a video."""
    return path.suffix.lower() in VIDEOS


def find_photographs(paths: Sequence[Path]) -> tuple[list[Path], list[str]]:
    """The photographs that a person names, in natural order.

    Args:
        paths: one folder, or files
    Returns:
        the files, and what a person should know of them

    Raises:
        InputError: a video, no photographs, several folders, or a folder whose photographs seem
            to be of several objects
    """
    for path in paths:
        if is_video(path):
            raise InputError(f"{path}: is a video; one alone is cut into photographs: name only it")
    folders = [path for path in paths if path.is_dir()]
    if len(folders) > 1 or (folders and len(paths) > 1):
        raise InputError(
            f"{', '.join(map(str, folders))}: silmesh makes one object, from one folder or from "
            "files; `silmesh init` writes a table for a folder of folders"
        )
    if folders:
        return _in_folder(folders[0]), []
    files = sorted((file for path in paths for file in find_images(path)), key=natural_key)
    _refuse_few(files, "named are")
    return files, [f"these are taken for one object: {mix}" for mix in filter(None, [_mix(files)])]


def find_masks(files: Sequence[Path], given: Path | None = None) -> list[Path]:
    """The mask of each photograph: of a folder or glob that is given, or of one named ``masks``.

    That lies in the photographs' folder or beside it, and has a mask for each of them.

    Raises:
        InputError: masks are given, and a photograph has none
    """
    if given:
        return match_masks(files, find_images(given))
    folder = files[0].parent
    for place in (parent / name for parent in (folder, folder.parent) for name in MASKS):
        if place.is_dir() and place != folder and _has_mask_of_each(place, files):
            return match_masks(files, _images_of(place, files))
    return []


def folders_within(folder: Path) -> list[Path]:
    """The folders in a folder that hold photographs and are not masks, in natural order."""
    within = [path for path in folder.iterdir() if path.is_dir() and path.name not in MASKS]
    return sorted((path for path in within if _images(path)), key=natural_key)


def _in_folder(folder: Path) -> list[Path]:
    """The photographs of a folder, which are of one object as far as one can see."""
    if not _images(folder):
        raise InputError(_say_why_none(folder))
    files = find_images(folder)
    _refuse_few(files, f"{folder}: holds")
    if mix := _mix(files):
        raise InputError(
            f"{folder}: holds photographs that differ: {mix}. silmesh makes one object: name its "
            f"files, as in `silmesh {folder}/{_pattern(files)} -o mesh.glb`"
        )
    return files


def _images(folder: Path) -> list[Path]:
    """The image files of a folder, in no order."""
    files = (path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    return [path for path in files if path.is_file() and not path.name.startswith(".")]


def _images_of(folder: Path, files: Sequence[Path]) -> list[Path]:
    stems = {file.stem for file in files}
    return [path for path in _images(folder) if path.stem in stems]


def _has_mask_of_each(folder: Path, files: Sequence[Path]) -> bool:
    found = _images_of(folder, files)
    return len(found) == len(files) and {f.stem for f in found} == {f.stem for f in files}


def _say_why_none(folder: Path) -> str:
    """What a folder without photographs holds instead, and what to do."""
    if within := folders_within(folder):
        names = ", ".join(path.name for path in within[:3]) + (", ..." if within[3:] else "")
        return (
            f"{folder}: has no photographs itself, but {len(within)} folders that do ({names}). "
            f"`silmesh {within[0]} -o mesh.glb` makes one object of a folder; "
            f"`silmesh init {folder}` writes a table for all"
        )
    others = sorted(folder.iterdir())
    if videos := [path for path in others if is_video(path)]:
        video = shlex.quote(str(videos[0]))
        return f"{folder}: has a video and no photograph: `silmesh {video} -o mesh.glb` cuts it"
    if unread := [path for path in others if path.suffix.lower() in UNREAD]:
        return (
            f"{unread[0]}: {unread[0].suffix} is not read; save the photographs as JPEG or PNG, "
            f"for example by ImageMagick: `magick mogrify -format jpg "
            f"{folder}/*{unread[0].suffix}`"
        )
    return f"{folder}: has no photograph ({', '.join(SUFFIXES)})"


def _refuse_few(files: Sequence[Path], where: str) -> None:
    if len(files) < FEWEST:
        raise InputError(
            f"{where} {len(files)} photograph; a mesh needs at least {FEWEST}, better 20 to 100 "
            "from all around"
        )


def _pattern(files: Sequence[Path]) -> str:
    """A glob of the files named like the first."""
    return f"{re.split(r'[0-9]', files[0].stem)[0]}*{files[0].suffix}"


def _mix(files: Sequence[Path]) -> str:
    """What kinds of photographs there are, if they are of several cameras or series of names."""
    kinds = defaultdict(list)
    for file in files:
        if kind := _kind(file):
            kinds[kind].append(file)
    if len(kinds) > 1:
        return _list_kinds(kinds.items())
    series = defaultdict(list)
    for file in files:
        series[re.sub(r"\d+", "#", file.stem)].append(file)
    long = {name: found for name, found in series.items() if len(found) >= SERIES}
    return _list_kinds(long.items()) if len(long) > 1 else ""


def _list_kinds(kinds: Iterable[tuple[str, list[Path]]]) -> str:
    ordered = sorted(kinds, key=lambda kind: -len(kind[1]))
    said = [f"{len(files)} {kind} (as {files[0].name})" for kind, files in ordered[:3]]
    return ", ".join(said) + (f" and {len(ordered) - 3} other kinds" if ordered[3:] else "")


def _kind(file: Path) -> str:
    """Size, however it is turned, and camera of a photograph; nothing of one that is unreadable."""
    try:
        with Image.open(file) as opened:
            exif = opened.getexif()
            longer, shorter = sorted(opened.size, reverse=True)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        return ""  # what is done with it depends on the policy
    camera = " ".join(str(exif[tag]).strip("\0 ") for tag in (MAKER, MODEL) if tag in exif)
    return f"of {longer}x{shorter}" + (f" by {camera}" if camera else "")
