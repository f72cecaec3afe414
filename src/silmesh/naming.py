"""What files are called: the views that photographs name, and the photograph that a mask is of.

A photograph's view has the stem of its name, after the folders that tell equal names apart. A mask
is named like its photograph, ``IMG_1.png``, or with that as it stands before a further ending or
beside the word mask: ``IMG_1.jpg.png`` (COLMAP), ``IMG_1.mask.png`` (OpenMVS), ``IMG_1_mask.png``.
"""

import os
import re
import shlex
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

from silmesh.errors import InputError, name_some

SUFFIXES = (
    *(".png", ".jpg", ".jpeg", ".jpe", ".jfif", ".tif", ".tiff", ".webp", ".bmp"),
    *(".heic", ".heif", ".hif", ".avif"),
)
MASK_FOLDERS = ("masks", "mask", "silhouettes")
MARKED = re.compile(r"(.+)[._ -]masks?|masks?[._ -](.+)", re.I)  # a mask's stem: its photograph's
PLAIN = set(range(0x20, 0x7F)) - set(b"'\\")  # bytes that bash's $'...' takes as they are


def natural_key(path: Path | str) -> list[tuple[int, int, str]]:
    """Sort key that puts ``r5`` before ``r10``."""
    parts = re.split(r"(\d+)", Path(path).name)
    return [(0, int(p), "") if p.isdecimal() else (1, 0, p) for p in parts if p]


def name_views(files: Sequence[Path]) -> list[str]:
    """The name of each photograph's view: its stem, after its folders if some stems are equal.

    So ``ring1/IMG_1.jpg`` beside ``ring2/IMG_1.jpg`` is ``ring1_IMG_1``.
    """
    stems = [file.stem for file in files]
    if len(set(stems)) == len(stems):
        return stems
    places = zip(_folders_apart(files), stems, strict=True)
    return ["_".join([*folders, stem]) for folders, stem in places]


def order_photographs(files: Iterable[Path]) -> list[Path]:
    """Photographs in the natural order of their views, each once.

    Raises:
        InputError: two of one folder have the same stem
    """
    once = sorted({os.path.abspath(file): file for file in files}.values())
    names = name_views(once)
    _refuse_equal(once, names)
    order = sorted(range(len(once)), key=lambda i: natural_key(names[i] + once[i].suffix))
    return [once[i] for i in order]


def _folders_apart(files: Sequence[Path]) -> list[tuple[str, ...]]:
    """The folders of each file below the one that holds them all."""
    own = [os.path.dirname(file) for file in files]
    parents = {folder: os.path.abspath(folder) for folder in own}
    shared = os.path.commonpath(parents.values()) if parents else ""
    apart = {f: Path(os.path.relpath(parent, shared)).parts for f, parent in parents.items()}
    return [apart[folder] for folder in own]


def _refuse_equal(files: Sequence[Path], names: Sequence[str]) -> None:
    seen: dict[str, Path] = {}
    for file, name in zip(files, names, strict=True):
        if name in seen:
            raise InputError(
                f"{file}: has the same name, {name!r}, as {seen[name]}; each photograph's name, "
                "without its ending, names its view. If it is the same photograph twice, take one "
                f"of them away; if it is a mask, call it {file.stem}_mask{file.suffix}"
            )
        seen[name] = file


def photograph_stems(mask: Path) -> list[str]:
    """The stems that a mask's photograph may have, the likeliest first."""
    stem: str | None = mask.stem
    stems = []
    while stem:
        stems.append(stem)
        stem = _strip(stem)
    return stems


def _strip(stem: str) -> str | None:
    """A mask's stem without what tells that it is one; None if nothing does."""
    before, _, ending = stem.rpartition(".")
    if before and f".{ending}".lower() in SUFFIXES:
        return before
    marked = MARKED.fullmatch(stem)
    return marked and (marked[1] or marked[2])


def split_masks(files: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Photographs and masks among files: masks lie beside theirs, or in a folder named so.

    A file that is named as a mask is one only where its photograph is there too, or where others
    of the same naming have theirs. So photographs that are all called so stay photographs.
    """
    folders = defaultdict(list)
    for file in files:
        folders[file.parent].append(file)
    within = [any(map(_is_mask_folder, parts)) for parts in _folders_apart(files)]
    apart = [file for file, so in zip(files, within, strict=True) if so and not all(within)]
    masks = set(apart).union(*(_masks_beside(found) for found in folders.values()))
    return [f for f in files if f not in masks], [f for f in files if f in masks]


def _is_mask_folder(name: str) -> bool:
    return name.lower() in MASK_FOLDERS


def _masks_beside(files: Sequence[Path]) -> set[Path]:
    """The masks of photographs among the files of a folder."""
    stems = {file.stem for file in files}
    others = {file: named for file in files if (named := photograph_stems(file)[1:])}
    paired = {f: stem for f, named in others.items() if (stem := _first_in(stems, named))}
    manners = {file.stem.replace(stem, "*", 1) for file, stem in paired.items()}
    masked = set(paired.values())
    spare = {
        file
        for file, named in others.items()
        if file.stem not in masked
        and any(file.stem.replace(stem, "*", 1) in manners for stem in named)
    }
    return set(paired) | spare


def _first_in(stems: set[str], named: Sequence[str]) -> str | None:
    return next((stem for stem in named if stem in stems), None)


def match_masks(images: Sequence[Path], masks: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """The mask of each image, and the masks that are of none.

    Raises:
        InputError: images have no mask, or several, or are their own masks
    """
    found, spare = pair_masks(images, masks)
    if bare := [image for image, of_it in zip(images, found, strict=True) if not of_it]:
        given = {os.path.abspath(mask) for mask in masks}
        if own := [image for image in bare if os.path.abspath(image) in given]:
            raise InputError(f"{own[0]}: is a photograph and its own mask; masks are other files")
        raise InputError(
            f"{bare[0]}: has no mask of the same name in {masks[0].parent}"
            + _and_others(len(bare), "photographs without a mask")
            + f"; the first one there is {masks[0].name}. A mask is named {bare[0].stem}.png, "
            f"{bare[0].name}.png, {bare[0].stem}_mask.png or {bare[0].stem}.mask.png"
        )
    return [of_it[0] for of_it in found], spare


def pair_masks(
    images: Sequence[Path], masks: Sequence[Path]
) -> tuple[list[list[Path]], list[Path]]:
    """The mask of each image, or none, and the masks that are of none.

    Raises:
        InputError: an image has several masks
    """
    own = {os.path.abspath(image) for image in images}
    masks = [mask for mask in masks if os.path.abspath(mask) not in own]
    places = {name: i for i, name in enumerate(name_views(images))}
    found: list[list[Path]] = [[] for _ in images]
    spare = []
    for mask, folders in zip(masks, _folders_apart(masks), strict=True):
        within = [folder for folder in folders if not _is_mask_folder(folder)]
        stems = photograph_stems(mask)
        names = ["_".join([*within, stem]) for stem in stems] + stems
        of = next((places[name] for name in names if name in places), None)
        (spare if of is None else found[of]).append(mask)
    for image, of_it in zip(images, found, strict=True):
        if len(of_it) > 1:
            raise InputError(
                f"{image}: has {len(of_it)} masks, {name_some(of_it)}; should have one: "
                "take the others away, or name the right ones by a glob"
            )
    return found, spare


def _and_others(count: int, what: str) -> str:
    return f" ({count} {what})" if count > 1 else ""


def tell_spare(masks: Sequence[Path]) -> list[str]:
    """A line on masks without a photograph, if there are any."""
    if not masks:
        return []
    return [f"not used: {name_some(masks, 1)}: no photograph has the name of that mask"]


def quote(path: Path | str) -> str:
    """A path as a word of the shell's (of bash's, if it has bytes that cannot be printed)."""
    text = f"./{path}" if str(path).startswith("-") else str(path)
    if text.isprintable():
        return shlex.quote(text)
    words = (chr(b) if b in PLAIN else f"\\x{b:02x}" for b in os.fsencode(text))
    return f"$'{''.join(words)}'"
