"""What a person names: the photographs of one object, and perhaps masks; what it is if not that."""

import os
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from silmesh.cameras.crop_signs import are_many_sizes
from silmesh.cameras.locate import NAMED
from silmesh.errors import InputError, name_some
from silmesh.naming import (
    MASK_FOLDERS,
    SUFFIXES,
    match_masks,
    natural_key,
    order_photographs,
    pair_masks,
    quote,
    split_masks,
    tell_spare,
)
from silmesh.views import describe_shapes, images_in, is_image, list_images, list_masks, open_image

VIDEOS = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mts", ".3gp")
RAW = (
    *(".dng", ".cr2", ".cr3", ".crw", ".nef", ".nrw", ".arw", ".srf", ".sr2", ".orf", ".rw2"),
    *(".raf", ".pef", ".srw", ".x3f", ".3fr", ".iiq", ".raw", ".gpr"),
)
UNREAD = (*RAW, ".gif", ".jxl", ".jp2", ".j2k", ".psd", ".exr", ".hdr", ".tga", ".svg", ".pdf")
JPEG = (".jpg", ".jpeg")
SIDECARS = (".xmp", ".aae", ".thm", ".lrv", ".pp3", ".dop")
SYSTEM = ("thumbs.db", "desktop.ini")  # files of a system's own, as hidden ones
CAMERAS = (
    *NAMED,
    *("transforms_*.json", "bundle*.out", "*.nvm", "*.mvs", "cameras.bin", "cameras.txt", "sparse"),
)
FEWEST = 2  # least number of photographs
SERIES = 3  # so many photographs with similar names are taken for those of one object
MAKER, MODEL, ORIENTATION = 271, 272, 274  # tags of EXIF


def is_video(path: Path) -> bool:
    """Whether a path's ending is that of a video."""
    return path.suffix.lower() in VIDEOS


def is_picture(path: Path) -> bool:
    """Whether a path's ending is that of a video or an image, of a format that is read or not."""
    return path.suffix.lower() in (*SUFFIXES, *UNREAD, *VIDEOS)


def find_photographs(
    paths: Sequence[Path], besides: Iterable[Path] = (), several: bool = False
) -> tuple[list[Path], list[str]]:
    """The photographs that a person names, in the natural order of their views.

    Args:
        paths: a folder, or several, each of a round or a set of one object's, or files
        besides: what is used otherwise, and may lie there too
        several: the photographs are known to be of several sets of one object's, so that a folder
            of two series of names is not of two objects
    Returns:
        the files, and what a person should know of them and of what is not used

    Raises:
        InputError: videos, no photographs, folders beside files, or a folder whose photographs
            seem to be of several objects
    """
    if all(map(is_video, paths)):
        raise InputError(f"{paths[0]}: is a video; one alone is cut into photographs: name only it")
    masks = [path for path in paths if path.is_dir() and path.name.lower() in MASK_FOLDERS]
    named = paths if len(paths) == len(masks) else [path for path in paths if path not in masks]
    folders = [path for path in named if path.is_dir()]
    if folders and len(named) > len(folders):
        raise InputError(
            f"{', '.join(map(str, folders))}: folders are named beside files; silmesh makes one "
            "object, from a folder, from several that hold a round or a set each, or from files"
        )
    if folders:
        files, notes = _in_folders(folders, several)
        known = set(map(os.path.abspath, (*besides, *folders)))
        there = [path for folder in folders for path in _others_in(folder)]
        others = [path for path in there if os.path.abspath(path) not in known]
        return files, [*notes, *_tell_unused(others, files), *_tell_shapes(files)]
    files, others, set_apart = _take_named(named)
    notes = _tell_mix(_mix(files))
    if set_apart:
        notes.append(f"named as masks, not as photographs: {_list(set_apart)}")
    return files, [*notes, *_tell_unused(others, files), *_tell_shapes(files)]


def find_unread(paths: Sequence[Path], files: Sequence[Path]) -> list[Path]:
    """What a person names as photographs and is not read, ``files`` being the others.

    These are formats that are not read, and links that lead nowhere. One beside a photograph of its
    name is not among them, as what a camera writes twice.
    """
    stems = {file.stem for file in files}
    inside = [_others_in(path) if path.is_dir() else [path] for path in paths]
    return [
        path
        for each in inside
        for path in each
        if path.stem not in stems
        and (path.suffix.lower() in UNREAD or (is_image(path) and _is_lost(path)))
    ]


def describe_count(files: Sequence[Path]) -> str:
    """How many photographs there are, and which of them cannot be read."""
    wrong = {}
    for file in files:
        try:
            open_image(file).close()
        except Exception as error:  # decoders raise anything on damaged files
            wrong[file] = error
    if not wrong:
        return f"{len(files)} photographs"
    lost = list(wrong)
    others = [file for file in lost if file.suffix.lower() not in JPEG]  # it writes over these
    return (
        f"{len(files) - len(lost)} photographs; {len(lost)} more cannot be read: {_list(lost)}, "
        f"{wrong[lost[0]]}. Get them anew"
        + (f", or {_advise_conversion(others)}" if others else "")
    )


def find_masks(files: Sequence[Path], given: Path | None = None) -> tuple[list[Path], list[str]]:
    """The mask of each photograph: of a folder or glob that is given, or found.

    They are found beside the photographs, or in a folder named ``masks`` that lies in the
    photographs' folder or beside it, if each photograph has one.

    Returns:
        the masks, or none, and what a person should know of those that are not used

    Raises:
        InputError: masks are given, and a photograph has none; or a photograph has several
    """
    if given:
        masks, spare = match_masks(files, list_masks(given, files))
        return masks, tell_spare(spare)
    notes = []
    for there in _places_of_masks(files):
        found, spare = pair_masks(files, there)
        bare = [file for file, masks in zip(files, found, strict=True) if not masks]
        if not bare:
            return [masks[0] for masks in found], tell_spare(spare)
        notes.append(_tell_lacking(there, files, bare))
    return [], notes


def find_cameras(files: Sequence[Path]) -> list[str]:
    """A line on files of cameras that lie in the photographs' folder or beside it, if there are."""
    folder = files[0].parent
    found = []
    with suppress(OSError):
        for place in (folder, _above(folder)):
            found += [path for name in CAMERAS for path in sorted(place.glob(name))]
    if not found:
        return []
    return [
        f"found, not used: {', '.join(map(str, dict.fromkeys(found)))}; "
        f"`--cameras file:{quote(found[0])}` takes the cameras from there"
    ]


def folders_within(folder: Path) -> list[Path]:
    """The folders in a folder that hold photographs and are not masks, in natural order."""
    within = [p for p in folder.iterdir() if p.is_dir() and not p.name.startswith(".")]
    within = [path for path in within if path.name.lower() not in MASK_FOLDERS]
    return sorted((path for path in within if images_in(path)), key=natural_key)


def _in_folders(folders: Sequence[Path], several: bool) -> tuple[list[Path], list[str]]:
    """The photographs of folders, of one object, and that what differs is taken for one.

    Those of one folder have to be of one object as far as one can see, unless it is known.
    """
    found = []
    for folder in folders:
        images = images_in(folder)
        if not images:
            raise InputError(_say_why_none(folder))
        found += split_masks(images)[0]
    files = order_photographs(found)
    where = ", ".join(map(str, folders))
    _refuse_few(files, f"{where}: holds")
    mix = _mix(files)
    if mix and len(folders) == 1 and not several and not _seem_cropped(files):
        raise InputError(
            f"{where}: holds photographs that differ: {mix}. silmesh makes one object: name its "
            f"files, as in `silmesh {_pattern(files)} -o mesh.glb`; or, if they are sets of one "
            "object that was turned over, say so by --sets"
        )
    return files, _tell_mix(mix or _count_in(files))


def _count_in(files: Sequence[Path]) -> str:
    """How many photographs lie in each folder, if they lie in several."""
    counts = Counter(str(file.parent) for file in files)
    each = [f"{count} in {folder}" for folder, count in counts.items()]
    return name_some(each) if len(each) > 1 else ""


def _tell_mix(mix: str) -> list[str]:
    return [f"these are taken for one object: {mix}"] if mix else []


def _take_named(paths: Sequence[Path]) -> tuple[list[Path], list[Path], list[Path]]:
    """The photographs among files that are named, what is not read of them, and masks."""
    found = [path for path in paths if path.suffix and not is_image(path) and path.is_file()]
    taken = [file for path in paths if path not in found for file in list_images(path)]
    if found and not taken:
        raise InputError(_say_unread(found) or f"{found[0]}: is no photograph, by its ending")
    photographs, masks = split_masks(taken)
    files = order_photographs(photographs)
    _refuse_few(files, "named are")
    return files, found, masks


def _others_in(folder: Path) -> list[Path]:
    """What a folder of photographs has beside images, masks and files of cameras."""
    there = [path for path in folder.iterdir() if not path.name.startswith(".")]
    cameras = {path for name in CAMERAS for path in folder.glob(name)}
    return sorted(
        path
        for path in there
        if path not in cameras
        and path.name.lower() not in SYSTEM
        and (_holds_photographs(path) if path.is_dir() else not is_image(path) or _is_lost(path))
    )


def _is_lost(path: Path) -> bool:
    """Whether a path is a link that leads nowhere."""
    return path.is_symlink() and not path.exists()


def _holds_photographs(folder: Path) -> bool:
    """Whether a folder that is not of masks has images, as far as one can see."""
    with suppress(OSError):
        return folder.name.lower() not in MASK_FOLDERS and bool(images_in(folder))
    return False


def _tell_unused(others: Sequence[Path], files: Sequence[Path]) -> list[str]:
    """A line on each kind of what is not used beside photographs."""
    stems = {file.stem for file in files}
    kinds = defaultdict(list)
    for path in others:
        kinds[_say_what(path, path.stem in stems)].append(path)
    said = [f"not used: {_list(paths)}: {what}" for what, paths in kinds.items() if what]
    return [*said, *filter(None, [f"not used: {_say_unread(kinds[''])}" if kinds[""] else ""])]


def _say_what(path: Path, twin: bool) -> str:
    """What a file is that is not used; "" for an image in a format that is not read."""
    if path.is_dir():
        return "folders with images"
    if _is_lost(path):
        return "links that lead nowhere"
    if is_video(path):
        return "a video is cut into photographs where it alone is named"
    if path.suffix.lower() in SIDECARS:
        return "sidecars"
    if path.suffix.lower() not in UNREAD:
        return "no photographs"
    return "each beside a photograph of its name" if twin else ""


def _list(paths: Sequence[Path]) -> str:
    """Files by their endings, or one by its name."""
    endings = defaultdict(list)
    for path in paths:
        endings[path.suffix.lower()].append(path)
    return ", ".join(
        found[0].name if len(found) == 1 else f"{len(found)} {ending} (as {found[0].name})".strip()
        for ending, found in endings.items()
    )


def _say_unread(paths: Sequence[Path]) -> str:
    """What to do with images in formats that are not read."""
    unread = [path for path in paths if path.suffix.lower() in UNREAD]
    return f"{_list(unread)}: not read; {_advise_conversion(unread)}" if unread else ""


def _advise_conversion(paths: Sequence[Path]) -> str:
    """How to make images readable that are not."""
    which = dict.fromkeys(f"{quote(path.parent)}/*{quote(path.suffix)}" for path in paths)
    return (
        "save them as JPEG or PNG, for example by ImageMagick: "
        f"`magick mogrify -format jpg {' '.join(which)}`"
    )


def _tell_shapes(files: Sequence[Path]) -> list[str]:
    """A line on photographs of which some lie and some stand, if so."""
    sizes = []
    for file in files:
        with suppress(Exception):  # of what cannot be read is told elsewhere
            sizes.append(_upright_size(file))
    return list(filter(None, [describe_shapes(sizes)]))


def _upright_size(file: Path) -> tuple[int, int]:
    with open_image(file) as opened:
        turned = opened.getexif().get(ORIENTATION, 1) in (5, 6, 7, 8)
        return opened.size[::-1] if turned else opened.size


def _places_of_masks(files: Sequence[Path]) -> Iterator[list[Path]]:
    """The images of each place where masks may be: among the photographs, and folders so named."""
    folders = list(dict.fromkeys(file.parent for file in files))
    own = set(map(os.path.abspath, folders))
    yield from filter(None, [[m for f in folders for m in split_masks(sorted(images_in(f)))[1]]])
    for around in (folders, list(dict.fromkeys(map(_above, folders)))):
        places = defaultdict(list)
        for folder in (within for place in around for within in _mask_folders(place)):
            if os.path.abspath(folder) not in own:
                with suppress(InputError):
                    places[folder.name] += list_masks(folder, files)
        yield from filter(None, places.values())


def _mask_folders(folder: Path) -> list[Path]:
    with suppress(OSError):
        there = sorted(path for path in folder.iterdir() if path.name.lower() in MASK_FOLDERS)
        return [path for path in there if path.is_dir()]
    return []


def _above(folder: Path) -> Path:
    return Path(os.path.normpath(folder / ".."))


def _tell_lacking(masks: Sequence[Path], files: Sequence[Path], bare: Sequence[Path]) -> str:
    """A line on masks that are not used since some photographs have none."""
    where = f"not used: {masks[0].parent}"
    if len(bare) == len(files):
        stem = files[0].stem
        return (
            f"{where}: none of its {len(masks)} images is named as the mask of a photograph, as "
            f"{stem}.png or {stem}_mask.png would be"
        )
    lacking = name_some([file.name for file in bare])
    return (
        f"{where}: has no mask of {lacking} ({len(bare)} of {len(files)} photographs lack one); "
        "draw the rest, or leave those photographs out, to have masks used"
    )


def _say_why_none(folder: Path) -> str:
    """What a folder without photographs holds instead, and what to do."""
    if within := folders_within(folder):
        names = name_some([path.name for path in within])
        return (
            f"{folder}: has no photographs itself, but {len(within)} folders that do ({names}). "
            f"`silmesh {quote(within[0])} -o mesh.glb` makes one object of a folder; "
            f"`silmesh init {quote(folder)}` writes a table for all"
        )
    others = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    if videos := [path for path in others if is_video(path)]:
        cut = f"`silmesh {quote(videos[0])} -o mesh.glb` cuts it"
        return f"{folder}: has a video and no photograph: {cut}"
    if unread := _say_unread(others):
        return f"{folder}: has no photograph, but {unread}"
    return f"{folder}: has no photograph ({', '.join(SUFFIXES)})"


def _refuse_few(files: Sequence[Path], where: str) -> None:
    if len(files) < FEWEST:
        raise InputError(
            f"{where} {len(files)} photograph; a mesh needs at least {FEWEST}, better 20 to 100 "
            "from all around"
        )


def _pattern(files: Sequence[Path]) -> str:
    """A glob of the files named like the first, as the shell reads it."""
    first = files[0]
    begins = re.sub(r"[0-9]+[^0-9]*$", "", first.stem)
    within = quote(first.parent / begins) if begins else f"{quote(first.parent)}/"
    return f"{within}*{quote(first.suffix)}"


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


def _seem_cropped(files: Sequence[Path]) -> bool:
    """Whether photographs of one series of names have so many sizes that each was cropped."""
    series = {re.sub(r"\d+", "#", file.stem) for file in files}
    return len(series) == 1 and are_many_sizes(len(set(map(_kind, files))), len(files))


def _list_kinds(kinds: Iterable[tuple[str, list[Path]]]) -> str:
    ordered = sorted(kinds, key=lambda kind: -len(kind[1]))
    return name_some([f"{len(files)} {kind} (as {files[0].name})" for kind, files in ordered])


def _kind(file: Path) -> str:
    """Size, however it is turned, and camera of a photograph; nothing of one that is unreadable."""
    try:
        with open_image(file) as opened:
            exif = opened.getexif()
            longer, shorter = sorted(opened.size, reverse=True)
    except Exception:  # decoders raise anything on damaged files
        return ""  # what is done with it depends on the policy
    camera = " ".join(str(exif[tag]).strip("\0 ") for tag in (MAKER, MODEL) if tag in exif)
    return f"of {longer}x{shorter}" + (f" by {camera}" if camera else "")


def find_longest(files: Sequence[Path]) -> int:
    """The longer side of the largest of some photographs, in pixels; 0 if none can be read."""
    longest = 0
    for file in files:
        with suppress(Exception), open_image(file) as image:  # said where it is read
            longest = max(longest, *image.size)
    return longest
