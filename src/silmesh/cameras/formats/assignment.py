"""Which camera of a file belongs to which view, and its pixels: by name or order, size by size.

A file's image names are matched to the views by their stems, whatever endings they have, and
whatever folders unless these tell equal names apart. Views without a camera are dropped while
enough are left; cameras without a view are not used.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PureWindowsPath

import numpy as np
import torch

from silmesh.cameras.attempt import FILE, Attempt
from silmesh.errors import InputError, name_some
from silmesh.geometry.camera import Cameras
from silmesh.reading import is_array
from silmesh.views import View

CROPPED = 0.2  # of the photographs: of more sizes than that they may have been cropped one by one
FEWEST, SHARE = 3, 0.5  # of the views that need a camera, where some have none


@dataclass(frozen=True)
class Rules:
    """How a format's cameras belong to the views.

    Attributes:
        by_order: they have no names, but are as many as the views and in their order
        working: they may be for the pixels of the working images
        signless: they come of matrices whose sign is free
    """

    by_order: bool = False
    working: bool = False
    signless: bool = False


def match(path: Path, cameras: Cameras, views: Sequence[View], rules: Rules) -> Attempt:
    """The cameras of these views, in pixels of the working images and in a right-handed world.

    Raises:
        InputError: too few views have a camera, the cameras are for other pictures, or some of
            them mirror and others do not
    """
    cameras, mirrored = right_handed(path, cameras)
    positions = (
        _by_order(path, cameras, views) if rules.by_order else _by_name(path, cameras, views)
    )
    kept = [i for i, position in enumerate(positions) if position is not None]
    dropped = {v.view: f"{path} has no camera for it" for i, v in enumerate(views) if i not in kept}
    warnings = _tell_dropped(path, dropped, len(views))
    views = [views[i] for i in kept]
    cameras = cameras.select([positions[i] for i in kept])
    doubt = _doubt_centres(path, cameras, views)
    sizes = [tuple(size) for size in cameras.sizes.tolist()]
    cropped = _doubt_sizes(path, sizes, views, rules.working)
    doubt = doubt or cropped
    if cropped:  # the pixels are taken to be as large as they were
        maps = [view.pixel_map for view in views]
    else:
        warnings += _tell_scaled(path, sizes, views, rules.working)
        maps = [
            _map_to_working(path, size, view, rules.working)
            for size, view in zip(sizes, views, strict=True)
        ]
    working = torch.tensor([[view.size, view.size] for view in views])
    cameras = cameras.in_pixels_of(torch.tensor(np.stack(maps)), working)
    cameras = cameras.named([view.view for view in views])
    return Attempt(
        FILE,
        cameras,
        dropped=dropped,
        warnings=tuple(warnings),
        mirrored=mirrored,
        signless=rules.signless,
        doubt=doubt,
        figures={"cropped": True} if cropped else {},
    )


def right_handed(path: Path, cameras: Cameras) -> tuple[Cameras, bool]:
    """The cameras in a right-handed world, and whether their own had to be mirrored for it.

    Raises:
        InputError: R mirrors in some of them only
    """
    mirrors = cameras.R.det() < 0
    if not mirrors.any():
        return cameras, False
    if mirrors.all():
        return cameras.in_mirrored_world(), True
    rare = mirrors if mirrors.sum() * 2 <= len(cameras) else ~mirrors
    which = [i for i, own in enumerate(rare.tolist()) if own]
    sign = "det R = -1, so it mirrors" if rare is mirrors else "det R = +1, so it does not mirror"
    raise InputError(
        f"{path}: frame or camera {which[0]} ({cameras.views[which[0]]}): {sign}: one axis of the "
        f"camera or of the world is negated in {len(which)} of {len(cameras)} cameras "
        f"({_some([cameras.views[i] for i in which])}) and not in the others; all should see one "
        "world"
    )


def _by_order(path: Path, cameras: Cameras, views: Sequence[View]) -> list[int | None]:
    if len(cameras) != len(views):
        raise InputError(
            f"{path}: has {len(cameras)} cameras, but there are {len(views)} views; the format has "
            "no names, so there should be a camera for each photograph in natural order"
        )
    return list(range(len(views)))


def _by_name(path: Path, cameras: Cameras, views: Sequence[View]) -> list[int | None]:
    """The position of each view's camera, or None."""
    positions = find_positions(cameras.views, views)
    for view, position in zip(views, positions, strict=True):
        if len(position) > 1:
            names = _some([cameras.views[i] for i in position])
            raise InputError(
                f"{path}: has {len(position)} cameras for the view {view.view!r}: {names}; names "
                "should differ in more than their folder and ending, or the folders be those of "
                "the photographs"
            )
    _refuse_few(path, cameras, views, [position for position in positions if position])
    return [position[0] if position else None for position in positions]


def find_positions(names: Sequence[str], views: Sequence[View]) -> list[list[int]]:
    """The positions of the names that may be each view's: one, unless folders do not tell."""
    known: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        file = PureWindowsPath(name)  # whose folders may be written in the manner of any system
        for stem in {file.name, file.stem}:
            known.setdefault(stem, []).append(i)
    return [_find_positions(names, known, view) for view in views]


def _find_positions(
    names: Sequence[str], known: Mapping[str, Sequence[int]], view: View
) -> list[int]:
    found = sorted({i for stem in _stems_of(view) for i in known.get(stem, ())})
    if len(found) < 2:
        return found
    shared = [_most_shared(names[i], view) for i in found]
    return [i for i, count in zip(found, shared, strict=True) if count == max(shared)]


@cache
def _files_of(source: str) -> frozenset[PureWindowsPath]:
    """Where a view's photograph lies, as it was named and where links lead."""
    if is_array(source):  # of many photographs
        return frozenset()
    return frozenset(PureWindowsPath(path) for path in (source, os.path.realpath(source)))


def _count_shared(name: str, file: PureWindowsPath) -> int:
    """How many folders above a file a camera's name has too."""
    folders = zip(PureWindowsPath(name).parts[-2::-1], file.parts[-2::-1], strict=False)
    same = [a == b for a, b in folders]
    return [*same, False].index(False)


class Sizes:
    """Sizes of the photographs, for files that say none, by the names of their cameras."""

    def __init__(self, views: Sequence[View]):
        self.first = views[0]
        self.known: dict[str, list[View]] = {}
        for view in views:
            for stem in _stems_of(view):
                self.known.setdefault(stem, []).append(view)

    def of(self, name: str) -> tuple[int, int]:
        """Width and height of the photograph of this name; the first's, if none has it."""
        file = PureWindowsPath(name)
        own = self.known.get(file.stem, []) + self.known.get(file.name, [])
        view = max(own, key=lambda v: _most_shared(name, v)) if own else self.first
        return view.width, view.height


def _stems_of(view: View) -> set[str]:
    return {view.view} | {file.stem for file in _files_of(view.source)}


def _most_shared(name: str, view: View) -> int:
    return max((_count_shared(name, file) for file in _files_of(view.source)), default=0)


def choose_world(
    path: Path, worlds: Mapping[str, Cameras], views: Sequence[View]
) -> tuple[Cameras, list[str]]:
    """Of cameras in several worlds, which nothing joins, those of most photographs; what to say.

    Args:
        worlds: by what messages call them
    """
    counts = {name: _count_matched(cameras, views) for name, cameras in worlds.items()}
    best = max(counts, key=counts.__getitem__)
    if len(worlds) == 1:
        return worlds[best], []
    held = ", ".join(f"{name} {count}" for name, count in counts.items())
    return worlds[best], [
        f"{path}: holds {len(worlds)} reconstructions that do not join; of the {len(views)} "
        f"photographs {held}. That of most is taken, {best}"
    ]


def _count_matched(cameras: Cameras, views: Sequence[View]) -> int:
    return sum(bool(positions) for positions in find_positions(cameras.views, views))


def _refuse_few(path: Path, cameras: Cameras, views: Sequence[View], found: Sequence) -> None:
    count = len(found)
    if count == len(views) or (count >= FEWEST and count >= SHARE * len(views)):
        return
    raise InputError(
        f"{path}: its {len(cameras)} cameras ({_some(cameras.views)}) fit {count} of the "
        f"{len(views)} views ({_some([view.view for view in views])}) by name; at least {FEWEST}, "
        f"and {SHARE:.0%} of the views, should have one. A camera's name should be that of its "
        "photograph, whatever its folder and ending; perhaps the file is for other pictures"
    )


def _some(names: Sequence[str]) -> str:
    return name_some([repr(name) for name in names])


def _tell_dropped(path: Path, dropped: dict[str, str], count: int) -> list[str]:
    if not dropped:
        return []
    return [
        f"{path}: {len(dropped)} of {count} photographs have no camera and are left out: "
        f"{_some(list(dropped))}"
    ]


def _tell_scaled(
    path: Path, sizes: Sequence[tuple[int, int]], views: Sequence[View], working: bool
) -> list[str]:
    scaled = {
        size: view
        for size, view in zip(sizes, views, strict=True)
        if not _is_own(size, view, working)
    }
    return [
        f"{path}: its cameras for {width}x{height} pixels are scaled to the photographs' "
        f"{view.width}x{view.height}"
        for (width, height), view in scaled.items()
    ]


def _doubt_centres(path: Path, cameras: Cameras, views: Sequence[View]) -> str | None:
    """What speaks against matrices, which say no size, whose axes leave the photographs.

    They may be of other pixels; or the photographs are parts of larger ones.
    """
    centre = cameras.K[:, :2, 2]
    size = torch.tensor([[view.width, view.height] for view in views])
    unsaid = (cameras.sizes == 0).all(dim=1)
    outside = unsaid & ((centre < 0) | (centre > size)).any(dim=1)
    if outside.sum() * 2 <= len(views):
        return None
    i = int(outside.int().argmax())
    u, v = centre[i].tolist()
    return (
        f"{path}: the axes of {int(outside.sum())} of {len(views)} cameras pass their "
        f"photographs by, at ({u:.0f}, {v:.0f}) where {views[i].view!r} has "
        f"{views[i].width}x{views[i].height} pixels"
    )


def _doubt_sizes(
    path: Path, sizes: Sequence[tuple[int, int]], views: Sequence[View], working: bool
) -> str | None:
    """That photographs have many sizes, and their cameras not theirs: as of crops made since."""
    shapes = {(view.width, view.height) for view in views}
    pairs = list(zip(sizes, views, strict=True))
    other = [
        (size, view)
        for size, view in pairs
        if not _is_own(size, view, working) and not is_scaled(size, (view.width, view.height))
    ]
    if not other or len(shapes) <= max(CROPPED * len(views), len(set(sizes)) + 1):
        return None
    (width, height), view = other[0]
    return (
        f"{path}: the camera of view {view.view!r} is for {width}x{height} pixels, but its "
        f"photograph has {view.width}x{view.height}, and the photographs have {len(shapes)} sizes"
    )


def _is_own(size: tuple[int, int], view: View, working: bool) -> bool:
    """Whether these are the photograph's pixels, or the working image's where that may be."""
    known = [(0, 0), (view.width, view.height)] + [(view.size, view.size)] * working
    return size in known


def is_scaled(size: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether the smaller of two sizes is the larger, scaled, each side rounded up or down."""
    small, large = sorted((size, other))
    if min(*small, *large) < 1:
        return False
    least = max((to - 1) / of for of, to in zip(large, small, strict=True))
    most = min((to + 1) / of for of, to in zip(large, small, strict=True))
    return least < most


def _map_to_working(path: Path, size: tuple[int, int], view: View, working: bool) -> np.ndarray:
    """From the pixels that a camera is given in to those of the working image: [3, 3].

    Photographs may have been scaled since, if the aspect is the same up to rounding of both sides.
    """
    width, height = size
    if _is_own(size, view, working):
        as_working = size == (view.size, view.size) != (view.width, view.height)
        return np.eye(3) if as_working else view.pixel_map
    if is_scaled(size, (view.width, view.height)):
        return view.pixel_map @ np.diag([view.width / width, view.height / height, 1])
    raise InputError(
        f"{path}: the camera of view {view.view!r} is for {width}x{height} pixels, but its "
        f"photograph has {view.width}x{view.height}"
        + f" (and its working image {view.size}x{view.size})"
        * working
        + "; cameras are scaled only where the aspect is the same. The file should be for these "
        "photographs"
        + ", turned as their EXIF orientation says"
        * (size == (view.height, view.width))
    )
