"""Photographs: finding them, reading any mode, resizing them to a square, and the pixel map back.

Working images are ``size`` x ``size``. ``pad`` keeps the aspect and centres the photograph on
black; ``stretch`` fills the square, as the report does.
"""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageOps

from silmesh.errors import InputError
from silmesh.files import making
from silmesh.progress import Share, untold

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp")
ANIMATED = ("PNG", "WEBP", "TIFF")  # formats, as Pillow calls them, that may have more frames
MANIFEST = "views.json"
GROUND = 124  # grey of the working image of a photograph that cannot be read


@dataclass(frozen=True)
class View:
    """A working image, and where its photograph lies in it.

    A pixel (u, v) of the photograph, upright and with centres at integer + 0.5, lies at
    (left + u (right - left) / width, top + v (bottom - top) / height) in the working image.

    Attributes:
        view: its name, the stem of the photograph's file (four digits for an image of an array)
        source: the photograph's file
        width, height: of the photograph, in pixels
        size: of the working image, in pixels
        left, top, right, bottom: the photograph within the working image, in pixels
        unreadable: why the photograph cannot be read; its working image is grey, and it is taken
            to be as large as the first that can
    """

    view: str
    source: str
    width: int
    height: int
    size: int
    left: int
    top: int
    right: int
    bottom: int
    unreadable: str = ""

    @property
    def pixel_map(self) -> np.ndarray:
        """[3, 3] float64, homogeneous pixels of the photograph to those of the working image."""
        scale_x = (self.right - self.left) / self.width
        scale_y = (self.bottom - self.top) / self.height
        return np.array([[scale_x, 0, self.left], [0, scale_y, self.top], [0, 0, 1.0]])

    def place(self, image: Image.Image, resample: Image.Resampling) -> Image.Image:
        """Resize an image of the photograph's field of view into the working square."""
        square = Image.new(image.mode, (self.size, self.size))
        extent = (self.right - self.left, self.bottom - self.top)
        square.paste(image.resize(extent, resample), (self.left, self.top))
        return square


def place_view(view: str, source: str, width: int, height: int, size: int, resize: str) -> View:
    """Where a photograph of this width and height goes in a square of ``size``.

    Args:
        resize: ``pad`` (aspect kept, centred) or ``stretch``
    """
    longer = max(width, height)
    w, h = (size, size) if resize == "stretch" else (size * width, size * height)
    if resize == "pad":
        w, h = max(1, round(w / longer)), max(1, round(h / longer))
    left, top = (size - w) // 2, (size - h) // 2
    return View(view, source, width, height, size, left, top, left + w, top + h)


def natural_key(path: Path | str) -> list[tuple[int, int, str]]:
    """Sort key that puts ``r5`` before ``r10``."""
    parts = re.split(r"(\d+)", Path(path).name)
    return [(0, int(p), "") if p.isdecimal() else (1, 0, p) for p in parts if p]


def find_images(pattern: Path) -> list[Path]:
    """The image files of a folder, or those that a glob matches, in natural order.

    Raises:
        InputError: the folder is not there, nothing matches, or two files have the same stem
    """
    try:
        files, lacking = _match_files(pattern)
    except OSError as error:
        raise InputError(f"{pattern}: cannot be read: {error.strerror}") from error
    if not files:
        raise InputError(f"{pattern}: {lacking}")
    files = sorted(sorted(files), key=natural_key)  # r5 and r05 in an order of their own
    _refuse_equal_stems(files)
    return files


def _match_files(pattern: Path) -> tuple[list[Path], str]:
    """The files that a folder, a glob or a file's own path gives; what to say if there is none."""
    if pattern.is_dir():
        files = [p for p in pattern.iterdir() if p.suffix.lower() in SUFFIXES and p.is_file()]
        files = [p for p in files if not p.name.startswith(".")]
        return files, f"has no image ({', '.join(SUFFIXES)})"
    if re.search(r"[*?\[]", str(pattern)):
        anchor = Path(pattern.anchor)
        files = [p for p in anchor.glob(str(pattern.relative_to(anchor))) if p.is_file()]
        return files, "matches no file"
    return [pattern] if pattern.is_file() else [], "is not there"


def _refuse_equal_stems(files: Sequence[Path]) -> None:
    seen: dict[str, Path] = {}
    for file in files:
        if file.stem in seen:
            raise InputError(
                f"{file}: has the same name, {file.stem!r}, as {seen[file.stem]}; "
                "each photograph's name, without its ending, names its view"
            )
        seen[file.stem] = file


def match_masks(images: Sequence[Path], masks: Sequence[Path]) -> list[Path]:
    """The mask of each image, by the stem of its name.

    Raises:
        InputError: images without a mask, masks without an image, or images as their own masks
    """
    if own := sorted(set(images) & set(masks)):
        raise InputError(f"{own[0]}: is a photograph and its own mask; masks lie in another folder")
    by_stem = {mask.stem: mask for mask in masks}
    stems = {image.stem for image in images}
    if bare := [image for image in images if image.stem not in by_stem]:
        raise InputError(
            f"{bare[0]}: has no mask of the same name in {masks[0].parent}"
            + _and_others(len(bare), "photographs without a mask")
            + f"; the first one there is {masks[0].name}"
        )
    if spare := [mask for mask in masks if mask.stem not in stems]:
        raise InputError(
            f"{spare[0]}: has no photograph of the same name in {images[0].parent}"
            + _and_others(len(spare), "masks without a photograph")
        )
    return [by_stem[image.stem] for image in images]


def _and_others(count: int, what: str) -> str:
    return f" ({count} {what})" if count > 1 else ""


def count_array_views(path: Path) -> int:
    """How many images a SoftRas ``.npy`` holds, from its header.

    Raises:
        InputError: it cannot be read, or is not [views, 4, height, width] of uint8
    """
    return len(_open_array(path))


def _open_array(path: Path) -> np.ndarray:
    try:
        array = np.lib.format.open_memmap(path, mode="r")
    except FileNotFoundError as error:
        raise InputError(f"{path}: is not there") from error
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path}: cannot be read as a .npy array: {error}") from error
    if array.ndim != 4 or array.shape[1] != 4 or array.dtype != np.uint8 or 0 in array.shape:
        raise InputError(
            f"{path}: should hold [views, 4, height, width] of uint8 (RGB and alpha), "
            f"not {list(array.shape)} of {array.dtype}"
        )
    return array


def read_image(path: Path | str, least: tuple[int, int] | None = None) -> Image.Image:
    """Read an image of any mode as upright 8-bit RGB, or RGBA if it has an alpha channel.

    Args:
        least: width and height that are enough: a JPEG may be read smaller than it is, not
            smaller than that

    Raises:
        InputError: it cannot be read, is truncated or is too large
    """
    try:
        with Image.open(path) as opened:
            if least:
                opened.draft(None, (max(least), max(least)))  # it may have to be turned
            opened.load()
            return _to_8_bit(ImageOps.exif_transpose(opened))
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise InputError(f"{path}: cannot be read as an image: {error}") from error


def count_frames(path: Path) -> int:
    """How many frames an animated file has, of which the first is read; 1 if it is not animated.

    A second picture of another kind, as telephones put behind a JPEG, is no frame.
    """
    try:
        with Image.open(path) as opened:
            return getattr(opened, "n_frames", 1) if opened.format in ANIMATED else 1
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        return 1  # what is wrong with it is said where it is read


def _to_8_bit(image: Image.Image) -> Image.Image:
    if image.mode.startswith("I"):
        deep = np.asarray(image).astype(np.float32)
        deep /= 257 if deep.max() > 255 else 1
        image = Image.fromarray(deep.clip(0, 255, out=deep).astype(np.uint8))
    elif image.mode == "F":
        image = Image.fromarray(np.asarray(image).clip(0, 255).astype(np.uint8))
    return image.convert("RGBA" if image.has_transparency_data else "RGB")


def read_photographs(paths: Sequence[Path]) -> Iterator[tuple[str, str, Image.Image | InputError]]:
    """Give name, file and image of each photograph in turn, from image files or one ``.npy``.

    In place of the image of a file that cannot be read stands why.
    """
    if len(paths) == 1 and paths[0].suffix == ".npy":
        for i, planes in enumerate(_open_array(paths[0])):
            yield f"{i:04d}", str(paths[0]), Image.fromarray(np.moveaxis(planes, 0, -1))
        return
    for path in paths:
        try:
            yield path.stem, str(path), read_image(path)
        except InputError as error:
            yield path.stem, str(path), error


def read_photograph(view: View, least: tuple[int, int] | None = None) -> Image.Image:
    """The photograph that a view was made from, upright, at its full size or at least ``least``."""
    source = Path(view.source)
    if source.suffix == ".npy":
        return Image.fromarray(np.moveaxis(_open_array(source)[int(view.view)], 0, -1))
    return read_image(source, least)


def write_views(
    paths: Sequence[Path],
    size: int,
    resize: str,
    folder: Path,
    fewest: int | None = None,
    progress: Share = untold,
) -> list[View]:
    """Resize photographs into ``<folder>/<view>.png`` and keep the pixel maps in ``views.json``.

    A photograph that cannot be read stays a view, since the place in a turn counts.

    Args:
        paths: image files, or one ``.npy`` as SoftRas has it
        size: of the working images, in pixels
        resize: ``pad`` or ``stretch``
        fewest: photographs that must be readable; all of them if not given
        progress: is told which share is done; of an array it is not known before the end

    Raises:
        InputError: too few are
    """
    views: list[View] = []
    unreadable: dict[str, tuple[str, str]] = {}  # file, and why
    with making(folder) as part:
        for done, (name, source, image) in enumerate(read_photographs(paths)):
            progress(done / max(len(paths), done + 1))  # an array is one file of many
            if isinstance(image, InputError):
                unreadable[name] = source, str(image)
                _refuse_too_few([why for _, why in unreadable.values()], len(paths), fewest)
                continue
            view = place_view(name, source, *image.size, size, resize)
            view.place(image, Image.Resampling.LANCZOS).save(part / f"{name}.png")
            views.append(view)
        for name, (source, why) in unreadable.items():
            views.append(replace(views[0], view=name, source=source, unreadable=why))
            Image.new("RGB", (size, size), (GROUND,) * 3).save(part / f"{name}.png")
        if unreadable:
            order = {path.stem: place for place, path in enumerate(paths)}
            views.sort(key=lambda view: order[view.view])
        rows = [asdict(view) for view in views]
        (part / MANIFEST).write_text(json.dumps(rows, indent=1) + "\n")
    progress(1.0)
    return views


def _refuse_too_few(unreadable: Sequence[str], photographs: int, fewest: int | None) -> None:
    """Refuse photographs of which so many cannot be read."""
    if fewest is None:
        raise InputError(
            f"{unreadable[0]}. Get the file anew, or let quality.policy 'drop' go on without it"
        )
    if photographs - len(unreadable) < max(fewest, 1):
        raise InputError(
            "\n".join(unreadable) + f"\nof {photographs} photographs fewer than quality.fewest, "
            f"{fewest}, can be read; get these files anew"
        )


def read_views(folder: Path) -> list[View]:
    """The views that ``write_views`` left in a folder, in their order."""
    return [View(**row) for row in json.loads((folder / MANIFEST).read_text())]


def read_pictures(folder: Path, views: Sequence[str]) -> np.ndarray:
    """The working images of these views: [views, height, width, 3] uint8, sRGB."""
    pictures = []
    for view in views:
        with Image.open(folder / f"{view}.png") as image:
            pictures.append(np.asarray(image.convert("RGB")))
    return np.stack(pictures)


def held_out(views: int, every: int) -> list[int]:
    """The positions of the views that are kept out of the fit: every n-th, none for 0.

    Raises:
        InputError: it is 1, which leaves none to fit
    """
    if every == 1:
        raise InputError("holdout 1 keeps every view out of the fit; should be 0, 2 or more")
    return list(range(every - 1, views, every)) if every else []
