"""Silhouettes: which pixels of each working image show the object, from one of several sources.

A source is a module with ``find(image, view, mask)``: the working image (RGB, or RGBA if the
photograph has an alpha channel), its ``View``, and the path of its mask file or None. It gives
[size, size] bool. One with a network, which is loaded once and may look at all views before it
decides, has ``find_all(views, settings, threads)`` instead and gives them in turn; it is imported
only when it is asked for. ``own`` calls a function of a person's own. On disk a silhouette is what
the report defines: RGBA, alpha 255 and grey 124 on the object, zero elsewhere.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from silmesh.ahead import ahead
from silmesh.errors import InputError
from silmesh.files import making
from silmesh.own_code import own_file
from silmesh.settings.silhouettes import Networks
from silmesh.silhouettes import alpha, mask
from silmesh.views import ImageFolder, View, choose_compression


def _find_by_threshold(image: Image.Image, view: View, file: Path | None) -> np.ndarray:
    # SciPy takes longer to import than the masks of an object to read.
    from silmesh.silhouettes import threshold

    return threshold.find(image, view, file)


SOURCES = {"mask": mask.find, "alpha": alpha.find, "threshold": _find_by_threshold}
NETWORKS = tuple(Networks.model_fields)  # each the module of its name, with `find_all`
GIVEN = ("mask", "alpha")  # sources that a person made
GREY = 124  # grey level of the object in a silhouette's file
LOST = "lost.json"  # names views whose silhouette is empty, though its file may not be, and why
FEWEST = 2  # least number of views with a silhouette
ENOUGH = 6  # and of those that must be left if one that cannot be used is not to refuse the rest
GO_ON = "quality.policy 'drop' (in the command: --quality drop) goes on without such a view"
FULL = "shows the whole photograph, or all around it"  # why a full silhouette is lost
AROUND = 0.7  # given masks count as inverted if most cover more of the photographs' borders
HINTS = {
    "mask": ", white in its mask",
    "alpha": " and be opaque there, more than 127 of 255",
    "threshold": " and stand out from the colour of its border",
    "deeplab": ", as one of the classes that the network knows: torchvision's know twenty kinds of "
    "things; weights of your own come from `bin/run train`",
    "matting": "; the model sees nothing in front of a background",
}


@dataclass(frozen=True)
class Found:
    """The silhouettes of all views.

    Attributes:
        silhouettes: [views, size, size] bool, empty where one was spared
        spared: what is wrong with each of those
        lost: of which views a photograph or a mask could not be read or is full, and what
    """

    silhouettes: np.ndarray
    spared: Sequence[str] = ()
    lost: Mapping[str, str] = field(default_factory=dict)


def find_silhouettes(
    source: str,
    views: Sequence[View],
    images: Mapping[str, Image.Image],
    masks: Sequence[Path] = (),
    settings: Any = None,
    spare: bool = False,
    progress: Callable[[int], None] = lambda done: None,
    threads: int | None = None,
) -> Found:
    """Find the silhouette of every view.

    Args:
        source: a key of ``SOURCES``, one of ``NETWORKS``, or ``path/to/file.py:function``
        views: the views, in order
        images: their working images
        masks: the views' mask files in the same order, or none
        settings: of the network, if the source is one
        spare: let a silhouette be empty that cannot be used, as long as two can; otherwise it may
            be if it can be read, most can be used, and ``ENOUGH`` are left
        progress: is told how many views are done
        threads: that find them; not of a function of a person's own

    Raises:
        InputError: masks are lacking or differ in number from the views; a photograph or a mask
            cannot be read; too many silhouettes are empty or fill their photographs; even if others
            can be used, a mask tells more than object and background apart
    """
    spared, lost = [], {}
    around: dict[int, str] = {}
    _refuse_other_count(source, views, masks)
    files = masks or [None] * len(views)
    found = _find_each(source, views, images, files, settings, threads)
    size = views[0].size if views else 0
    kept = np.zeros((len(views), size, size), bool)
    for done, (view, file, silhouette) in enumerate(zip(views, files, found, strict=True), start=1):
        wrong, cost = _find_fault(silhouette, view, source, file, spare)
        if cost:
            lost[view.view] = cost
        if wrong:
            spared.append(wrong)
            _refuse_wrong(spared, len(views), spare)
        else:
            kept[done - 1] = silhouette
            if source in GIVEN and (share := _edge(silhouette, view).mean()) > AROUND:
                inverted = _say_inverted(f"border to {share:.0%}")
                around[done - 1] = f"{_where(view, source, file)} {inverted}"
        progress(done)
    for place, wrong in around.items() if 2 * len(around) > len(views) else ():
        spared.append(wrong)  # a few are of photographs taken near, which the object nearly fills
        _refuse_wrong(spared, len(views), spare)
        lost[views[place].view] = FULL
        kept[place] = False
    return Found(kept, spared, lost)


def _find_fault(
    silhouette: np.ndarray | InputError, view: View, source: str, file: Path | None, spare: bool
) -> tuple[str, str]:
    """What is wrong with what was found of a view, and what the view loses by it; "" for none."""
    if isinstance(silhouette, mask.SeveralValuesError):
        raise silhouette
    if isinstance(silhouette, InputError):
        if not spare:
            raise InputError(f"{silhouette}. {GO_ON}")
        what = "photograph" if view.unreadable else source
        return str(silhouette), f"its {what} cannot be used"
    wrong = _describe_wrong(silhouette, view, source, file)
    return wrong, FULL if wrong and silhouette.any() else ""


def _refuse_wrong(wrong: Sequence[str], views: int, spare: bool) -> None:
    """Refuse those that are wrong if they leave too few views; of a few views each counts."""
    left = views - len(wrong)
    if spare and left < FEWEST:
        raise InputError("\n".join(wrong))
    if not spare and left < max(ENOUGH, views / 2):
        several = f"{len(wrong)} of {views} silhouettes cannot be used. The last: "
        raise InputError(f"{several * (len(wrong) > 1)}{wrong[-1]}. {GO_ON}")


def write_silhouettes(
    source: str,
    views: Sequence[View],
    images: Path,
    masks: Sequence[Path],
    folder: Path,
    settings: Any = None,
    spare: bool = False,
    progress: Callable[[int], None] = lambda done: None,
    threads: int | None = None,
) -> Sequence[str]:
    """Find the silhouette of every view and write ``<folder>/<view>.png``.

    Views of which something could not be read or is full are also named in ``lost.json``. Arguments
    and errors are those of ``find_silhouettes``, but for ``images``: the folder of the working
    images.

    Returns:
        for each view that was spared, what is wrong with its silhouette
    """
    with making(folder) as part:
        found = find_silhouettes(
            source, views, ImageFolder(images), masks, settings, spare, progress, threads
        )

        def write(place: int) -> None:
            write_silhouette(part / f"{views[place].view}.png", found.silhouettes[place])

        for _ in ahead(write, range(len(views)), threads or 1):
            pass
        if found.lost:
            lost = json.dumps(found.lost, indent=1)
            (part / LOST).write_text(lost + "\n", encoding="utf-8")
    return found.spared


def _find_each(
    source: str,
    views: Sequence[View],
    images: Mapping[str, Image.Image],
    files: Sequence[Path | None],
    settings: Any,
    threads: int | None,
) -> Iterator[np.ndarray | InputError]:
    """The silhouette of each view in turn, or why there is none."""
    readable = [view for view in views if not view.unreadable]
    if source in NETWORKS:  # torch and torchvision take seconds to import
        network = import_module(f"silmesh.silhouettes.{source}")
        found = network.find_all(readable, settings, threads)
    elif own_file(source):
        from silmesh.silhouettes import own

        found = own.find_all(readable, source)
    else:
        pairs = zip(views, files, strict=True)
        found = ahead(
            lambda pair: _find(source, *pair, images),
            (pair for pair in pairs if not pair[0].unreadable),
            threads or 1,
        )
    for view in views:
        yield InputError(view.unreadable) if view.unreadable else next(found)


def _find(
    source: str, view: View, file: Path | None, images: Mapping[str, Image.Image]
) -> np.ndarray | InputError:
    try:
        return SOURCES[source](images[view.view], view, file)
    except InputError as error:
        return error


def _refuse_other_count(source: str, views: Sequence[View], masks: Sequence[Path]) -> None:
    if len(masks) != len(views) and (masks or source == "mask"):
        raise InputError(
            f"silhouettes from {source!r}: there are {len(masks)} masks, but {len(views)} views"
        )


def encode(silhouette: np.ndarray) -> Image.Image:
    """A silhouette, [height, width] bool, as the report's RGBA image."""
    inside = np.array([GREY, GREY, GREY, 255], np.uint8).view(np.uint32)
    return Image.fromarray((silhouette * inside).view(np.uint8).reshape(*silhouette.shape, 4))


def write_silhouette(file: Path, silhouette: np.ndarray) -> None:
    """Write a silhouette, [height, width] bool, as the report's RGBA image."""
    image = encode(silhouette)
    image.save(file, compress_level=choose_compression(image))


def read_silhouettes(folder: Path, views: Sequence[str], threads: int = 1) -> np.ndarray:
    """The silhouettes of these views, [views, height, width] bool, read by so many threads."""
    each = ahead(_decode, (folder / f"{view}.png" for view in views), threads)
    first = next(each)
    silhouettes = np.empty((len(views), *first.shape), bool)
    for into, silhouette in zip(silhouettes, chain([first], each), strict=True):
        into[:] = silhouette
    return silhouettes


def read_lost(folder: Path) -> Mapping[str, str]:
    """The views of which something could not be read, and what."""
    file = folder / LOST
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}


def _decode(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.getchannel("A")) > 127


def _describe_wrong(silhouette: np.ndarray, view: View, source: str, file: Path | None) -> str:
    """What forbids to use a silhouette; "" for nothing."""
    where = _where(view, source, file)
    inside = silhouette[view.top : view.bottom, view.left : view.right]
    if not inside.any():
        return f"{where} empty; the object should show in every photograph{HINTS.get(source, '')}"
    if inside.all():
        return f"{where} fills the photograph; the background should show around it"
    if _edge(silhouette, view).all():
        return f"{where} {_say_inverted('border all around')}"
    return ""


def _where(view: View, source: str, file: Path | None) -> str:
    return f"{file or view.source}: view {view.view!r}, silhouettes from {source!r}:"


def _edge(silhouette: np.ndarray, view: View) -> np.ndarray:
    """The pixels of a silhouette along the border of its photograph: [n] bool."""
    inside = silhouette[view.top : view.bottom, view.left : view.right]
    return np.concatenate((inside[0], inside[-1], inside[:, 0], inside[:, -1]))


def _say_inverted(covered: str) -> str:
    return (
        f"covers the photograph's {covered}; it may be inverted: the object should be white, the "
        "background black"
    )
