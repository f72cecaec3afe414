"""Photographs: finding them, reading any mode, resizing them to a square, and the pixel map back.

Working images are ``size`` x ``size``. ``pad`` keeps the aspect and centres the photograph on
black; ``stretch`` fills the square, as the report does.
"""

import json
import os
import re
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from silmesh.ahead import ahead
from silmesh.errors import InputError, explain, reading
from silmesh.files import making
from silmesh.naming import SUFFIXES, name_views, order_photographs, split_masks
from silmesh.progress import Share, untold
from silmesh.reading import IMAGES, is_array, open_array, read_row, split_row

MANIFEST = "views.json"
FEWEST_VIEWS = 2
# Formats as Pillow calls them.
ANIMATED = ("PNG", "WEBP", "TIFF", "AVIF")  # formats that may have several frames
PROGRAMS = ("EPS", "WMF")  # formats that are programs, which Pillow has another program run
# Images of more than SMALL pixels may have at most PACKED pixels a byte of their file, which is
# what deflate reaches for equal pixels of one bit.
SMALL, PACKED = 10_000_000, 8 * 1032
ORIENTATION, SIDEWAYS = 0x0112, (5, 6, 7, 8)  # the EXIF tag, and its values that turn by 90 degrees
LARGE = 1024  # pixels a side: larger images are written with little compression
GROUND = 124  # grey level of the working image of a photograph that cannot be read


@dataclass(frozen=True)
class View:
    """A working image, and where its photograph lies in it.

    A pixel (u, v) of the photograph, upright and with centres at integer + 0.5, lies at
    (left + u (right - left) / width, top + v (bottom - top) / height) in the working image.

    Attributes:
        view: its name, as ``naming.name_views`` gives it (four digits for an image of an array)
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
    def frame(self) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of the photograph within the working image, in pixels."""
        return self.left, self.top, self.right, self.bottom

    @property
    def pixel_map(self) -> np.ndarray:
        """[3, 3] float64, homogeneous pixels of the photograph to those of the working image."""
        scale_x = (self.right - self.left) / self.width
        scale_y = (self.bottom - self.top) / self.height
        return np.array([[scale_x, 0, self.left], [0, scale_y, self.top], [0, 0, 1.0]])

    def into_square(self, image: Image.Image, resample: Image.Resampling) -> Image.Image:
        """Resize an image of the photograph's field of view into the working square."""
        square = Image.new(image.mode, (self.size, self.size))
        extent = (self.right - self.left, self.bottom - self.top)
        square.paste(image.resize(extent, resample), (self.left, self.top))
        return square


def describe_shapes(sizes: Sequence[tuple[int, int]]) -> str:
    """What to say of photographs of which some are the others turned by 90 degrees; "" if none is.

    Args:
        sizes: width and height of each, upright
    """
    counts = Counter(sizes)
    for (width, height), lying in counts.most_common():
        if width != height and (turned := counts.get((height, width))):
            return (
                f"{lying} photographs are {width}x{height} and {turned} are {height}x{width}: was "
                f"their EXIF orientation lost? If so, turn the {turned} as the others are; the "
                "cameras would be wrong otherwise"
            )
    return ""


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


def find_images(pattern: Path) -> list[Path]:
    """The photographs of a folder, or those that a glob matches, in natural order.

    Masks that lie beside them are left out.

    Raises:
        InputError: as ``list_images``, or two photographs of one folder have the same stem
    """
    return order_photographs(split_masks(list_images(pattern))[0])


def list_photographs(paths: Sequence[Path]) -> list[Path]:
    """The photographs that paths name: a folder, which is the only one then, stands for its own.

    Raises:
        InputError: as ``find_images``, or a folder has but one
    """
    if len(paths) != 1 or not paths[0].is_dir():
        return list(paths)
    found = find_images(paths[0])
    if len(found) < FEWEST_VIEWS:
        raise InputError(f"{paths[0]}: holds 1 photograph; a fit needs at least {FEWEST_VIEWS}")
    return found


def list_images(pattern: Path) -> list[Path]:
    """The image files of a folder, or those that a glob matches, in the order of letters.

    A path that exists is no glob, nor is that of a folder in which a glob is looked for. Hidden
    files, such as macOS puts beside others, are left out, unless they are named.

    Raises:
        InputError: the folder is not there, or nothing matches
    """
    with _blaming_path(pattern):
        files, lacking = _match_files(pattern)
    if not files:
        raise InputError(f"{pattern}: {lacking}")
    return sorted(files)


def list_masks(pattern: Path, images: Sequence[Path]) -> list[Path]:
    """The mask files of a folder or of a glob, in the order of letters.

    Of a folder also those in folders that are called as the photographs' own.

    Raises:
        InputError: as ``list_images``
    """
    with _blaming_path(pattern):
        own = {image.parent for image in images}
        within = {pattern / folder.name for folder in own} - own
        files = [file for folder in within if folder.is_dir() for file in images_in(folder)]
        there = images_in(pattern) if pattern.is_dir() else []
    return sorted(files + there) if files else list_images(pattern)


def images_in(folder: Path) -> list[Path]:
    """The image files of a folder, in no order; hidden ones are left out."""
    with os.scandir(folder) as entries:
        found = [(folder / entry.name, entry) for entry in entries]
    return [path for path, entry in found if is_image(path) and _is_file(path, entry)]


def _is_file(path: Path, entry: os.DirEntry) -> bool:
    """Whether an entry of a folder is a file, which the listing itself says of all but links."""
    return path.is_file() if entry.is_symlink() else entry.is_file()


def is_image(path: Path) -> bool:
    """Whether a file's name is that of an image that is not hidden."""
    return path.suffix.lower() in SUFFIXES and not path.name.startswith(".")


@contextmanager
def _blaming_path(pattern: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError, NotImplementedError, RecursionError) as error:  # as of x**
        raise InputError(f"{pattern}: cannot be read: {explain(error)}") from error


def _match_files(pattern: Path) -> tuple[list[Path], str]:
    """The files that a folder, a glob or a file's own path gives; what to say if there is none."""
    if pattern.is_dir():
        return images_in(pattern), f"has no image ({', '.join(SUFFIXES)})"
    if pattern.is_file():
        return [pattern], ""
    if not re.search(r"[*?\[]", str(pattern)):
        return [], "is not there"
    folder = next(parent for parent in pattern.parents if parent.is_dir())  # "a[1]" may be one
    found = sorted(p for p in folder.glob(str(pattern.relative_to(folder))) if p.is_file())
    files = [p for p in found if is_image(p) or p.name == pattern.name]
    return files, f"matches no image, but {found[0].name}" if found else "matches no file"


def count_array_views(path: Path) -> int:
    """How many images a SoftRas ``.npy`` or an object of an ``.npz`` holds, from its header.

    Raises:
        InputError: it cannot be read, or is not [views, 4, height, width] of uint8
    """
    return IMAGES[0] if split_row(path) else len(_open_array(path))


def _open_array(path: Path) -> np.ndarray:
    if split_row(path):
        return read_row(path, IMAGES)
    array = open_array(path)
    if array.ndim != 4 or array.shape[1] != 4 or array.dtype != np.uint8 or 0 in array.shape:
        raise InputError(
            f"{path}: should hold [views, 4, height, width] of uint8 (RGB and alpha), "
            f"not {list(array.shape)} of {array.dtype}"
        )
    return array


def open_image(path: Path | str) -> Image.Image:
    """Open an image of any format that is read; HEIC has a library of its own."""
    with warnings.catch_warnings():  # of more than 89 megapixels, which cameras take
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        try:
            return Image.open(path)
        except UnidentifiedImageError:  # a telephone's HEIC may be called .jpg
            _learn_heic()
            return Image.open(path)


@cache
def _learn_heic() -> None:
    import pillow_heif  # loads in longer than Pillow, for few

    pillow_heif.register_heif_opener()


def read_image(path: Path | str, least: tuple[int, int] | None = None) -> Image.Image:
    """Read an image of any mode as upright 8-bit RGB, or RGBA if it has an alpha channel.

    Args:
        least: width and height that are enough: a JPEG may be read smaller than it is, not
            smaller than that

    Raises:
        InputError: it cannot be read, is truncated or is too large
    """
    with reading(path, "an image"), open_image(path) as opened:
        if least:
            opened.draft(None, (max(least), max(least)))  # it may have to be turned
        _refuse_impossible(opened, Path(path).stat().st_size)
        opened.load()
        return _to_8_bit(ImageOps.exif_transpose(opened))


def count_frames(path: Path) -> int:
    """How many frames an animated file has, of which the first is read; 1 if it is not animated.

    A second picture of another kind, as telephones put behind a JPEG, is no frame.
    """
    try:
        with open_image(path) as opened:
            return getattr(opened, "n_frames", 1) if opened.format in ANIMATED else 1
    except Exception:  # of whatever kind
        return 1  # what is wrong with it is said where it is read


def _refuse_impossible(image: Image.Image, size: int) -> None:
    """Refuse an image of no pixel, or of more than a file of this size can hold, and programs.

    Pillow takes a PNG of which most is lacking for one that is black there.
    """
    if image.format in PROGRAMS:
        raise ValueError(f"it is a program that draws one ({image.format})")
    pixels = image.width * image.height
    if not pixels or (pixels > SMALL and pixels > PACKED * size):
        raise ValueError(
            f"it says that it has {image.width}x{image.height} pixels, in {size:,} bytes"
        )


def _to_8_bit(image: Image.Image) -> Image.Image:
    if image.mode.startswith("I"):
        deep = np.asarray(image).astype(np.float32)
        deep /= 257 if deep.max() > 255 else 1
        image = Image.fromarray(deep.clip(0, 255, out=deep).astype(np.uint8))
    elif image.mode == "F":
        image = Image.fromarray(np.asarray(image).clip(0, 255).astype(np.uint8))
    return image.convert("RGBA" if image.has_transparency_data else "RGB")


def read_photographs(paths: Sequence[Path]) -> Iterator[tuple[str, str, Image.Image | InputError]]:
    """Give name, file and image of each photograph in turn, from image files or one array.

    In place of the image of a file that cannot be read stands why.
    """
    if len(paths) == 1 and is_array(paths[0]):
        for i, planes in enumerate(_open_array(paths[0])):
            yield f"{i:04d}", str(paths[0]), Image.fromarray(np.moveaxis(planes, 0, -1))
        return
    for name, path in zip(name_views(paths), paths, strict=True):
        try:
            yield name, str(path), read_image(path)
        except InputError as error:
            yield name, str(path), error


def read_photograph(view: View, least: tuple[int, int] | None = None) -> Image.Image:
    """The photograph that a view was made from, upright, at its full size or at least ``least``."""
    source = Path(view.source)
    if is_array(source):
        return Image.fromarray(np.moveaxis(_open_array(source)[int(view.view)], 0, -1))
    return read_image(source, least)


def refuse_changed(views: Sequence[View]) -> None:
    """Refuse views whose photographs are not there any more, or are of another size.

    Mostly only the heads of the files are read.

    Raises:
        InputError: it names the file
    """
    for view in views:
        if not view.unreadable and (size := _measure(view)) != (view.width, view.height):
            raise InputError(
                f"{view.source}: has {size[0]}x{size[1]} pixels, and had {view.width}x"
                f"{view.height} when its working image was made; should be the photograph that it "
                "was, or all be made anew"
            )


def _measure(view: View) -> tuple[int, int]:
    """Width and height of a view's photograph, upright."""
    source = Path(view.source)
    if source.suffix == ".npy":
        return _open_array(source).shape[:1:-1]
    with reading(source, "an image"), open_image(source) as opened:
        size, kind = opened.size, opened.format
        turned = opened.getexif().get(ORIENTATION, 1) in SIDEWAYS
    if turned and kind == "TIFF":  # whose size some versions of Pillow turn as they open it
        return read_image(source).size
    return size[::-1] if turned else size


def write_views(
    paths: Sequence[Path],
    size: int,
    resize: str,
    folder: Path,
    fewest: int | None = None,
    progress: Share = untold,
    threads: int = 1,
) -> list[View]:
    """Resize photographs into ``<folder>/<view>.png`` and keep the pixel maps in ``views.json``.

    A photograph that cannot be read stays a view, since the place in a turn counts.

    Args:
        paths: image files, or one ``.npy`` as SoftRas has it, or an object of an ``.npz``
        size: of the working images, in pixels
        resize: ``pad`` or ``stretch``
        fewest: photographs that must be readable; all of them if not given
        progress: is told which share is done; of an array it is not known before the end
        threads: that write

    Raises:
        InputError: too few are
    """
    with making(folder) as part:

        def write(made: tuple[View, Image.Image]) -> View:
            view, image = made
            image.save(part / f"{view.view}.png", compress_level=choose_compression(image))
            return view

        made = make_views(paths, size, resize, fewest, progress)
        views = in_order(list(ahead(write, made, threads)), paths)
        rows = [asdict(view) for view in views]
        (part / MANIFEST).write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return views


def choose_compression(image: Image.Image) -> int:
    """How hard a PNG is compressed: large images little, since that would take most of the time."""
    return 1 if max(image.size) > LARGE else 6


def make_views(
    paths: Sequence[Path],
    size: int,
    resize: str,
    fewest: int | None = None,
    progress: Share = untold,
) -> Iterator[tuple[View, Image.Image]]:
    """The view of each photograph with its working image, RGB or RGBA; one is in memory at a time.

    Those of photographs that cannot be read come last: ``in_order`` gives the views their places.
    Arguments and errors are those of ``write_views``.
    """
    first: View | None = None
    unreadable: dict[str, tuple[str, str]] = {}  # file, and why
    for done, (name, source, image) in enumerate(read_photographs(paths)):
        progress(done / max(len(paths), done + 1))  # an array is one file of many
        if isinstance(image, InputError):
            unreadable[name] = source, str(image)
            _refuse_too_few([why for _, why in unreadable.values()], len(paths), fewest)
            continue
        view = place_view(name, source, *image.size, size, resize)
        first = first or view
        yield view, view.into_square(image, Image.Resampling.LANCZOS)
    for name, (source, why) in unreadable.items():
        grey = Image.new("RGB", (size, size), (GROUND,) * 3)
        yield replace(first, view=name, source=source, unreadable=why), grey
    progress(1.0)


def in_order(views: Sequence[View], paths: Sequence[Path]) -> list[View]:
    """The views of these photographs in the order of the photographs."""
    if not any(view.unreadable for view in views):  # an array has its views in order
        return list(views)
    order = {name: position for position, name in enumerate(name_views(paths))}
    return sorted(views, key=lambda view: order[view.view])


def _refuse_too_few(unreadable: Sequence[str], photographs: int, fewest: int | None) -> None:
    """Refuse photographs of which so many cannot be read."""
    if fewest is None:
        raise InputError(
            f"{unreadable[0]}. Get the file anew, or let quality.policy 'drop' (in the "
            "command: --quality drop) go on without it"
        )
    if photographs - len(unreadable) < max(fewest, 1):
        raise InputError(
            "\n".join(unreadable) + f"\nof {photographs} photographs fewer than quality.fewest, "
            f"{fewest}, can be read; get these files anew"
        )


def read_views(folder: Path) -> list[View]:
    """The views that ``write_views`` left in a folder, in their order."""
    return [View(**row) for row in json.loads((folder / MANIFEST).read_text(encoding="utf-8"))]


class ImageFolder(Mapping[str, Image.Image]):
    """The working images of a folder by their views, each read when it is asked for."""

    def __init__(self, folder: Path):
        self._folder = folder

    def __getitem__(self, view: str) -> Image.Image:
        with Image.open(self._folder / f"{view}.png") as image:
            image.load()
            return image

    def __iter__(self) -> Iterator[str]:
        return (file.stem for file in sorted(self._folder.glob("*.png")))

    def __len__(self) -> int:
        return sum(1 for _ in self)


class Pictures(Sequence[np.ndarray]):
    """The working images of some views, each read when it is asked for.

    Each is [height, width, 3] uint8, sRGB.

    Args:
        images: by the views' names
        views: the names
    """

    def __init__(self, images: Mapping[str, Image.Image], views: Sequence[str]):
        self._images, self._views = images, views

    def __getitem__(self, position: int) -> np.ndarray:
        return np.asarray(self._images[self._views[position]].convert("RGB"))

    def __len__(self) -> int:
        return len(self._views)


def stack_pictures(images: Mapping[str, Image.Image], views: Sequence[str]) -> np.ndarray:
    """The working images of these views: [views, height, width, 3] uint8, sRGB."""
    return np.stack(Pictures(images, views))


def held_out(views: int, every: int) -> list[int]:
    """The positions of the views that are kept out of the fit: every n-th, none for 0.

    Raises:
        InputError: it is 1, which leaves none to fit
    """
    if every == 1:
        raise InputError("holdout 1 keeps every view out of the fit; should be 0, 2 or more")
    return list(range(every - 1, views, every)) if every else []
