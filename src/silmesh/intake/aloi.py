"""The Amsterdam Library of Object Images, as its archives are unpacked.

ALOI (Geusebroek, Burghouts and Smeulders, *The Amsterdam Library of Object Images*, 2005) has a
thousand objects on a turntable, numbered from 1, in photographs of 768x576, half and a quarter:

    png/<n>/<n>_r<deg>.png      mask/<n>/<n>_r<deg>.png      aloi_view, aloi_mask
    png2/<n>/<n>_r<deg>.png     mask2/<n>/<n>_r<deg>.png     aloi_red2_view, aloi_mask2
    png4/<n>/<n>_r<deg>.png     mask4/<n>/<n>_r<deg>.png     aloi_red4_view, aloi_mask4

Each archive may be unpacked in the folder itself or in one of its own. Its other archives, of
lights and colours, lie in folders of the same names; they have no ``_r``.
"""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from silmesh.errors import InputError, blaming
from silmesh.intake.unpacked import Collection, Row, describe_sizes, find_faults
from silmesh.naming import natural_key
from silmesh.planning.datasets import to_name, usable
from silmesh.planning.numbers import parse_numbers
from silmesh.remote.address import parse_address

SIZES = ("", "2", "4")  # what is put behind png and mask, from the largest photographs
OBJECTS = 1000
HALF = ("aloi_red2_view", "aloi_mask2")  # archives of half the size
STEP = 5  # degrees from one view to the next
ANGLES = range(0, 360, STEP)


def find_rows(folder: Path, objects: str | None) -> Collection:
    """The objects that are there whole: photographs and masks of all views.

    Args:
        folder: that the archives were unpacked in, and the table is to lie in
        objects: their numbers, as ``1-10,17``; all that are there if not given

    Raises:
        InputError: there are no such folders in it, no object is there whole, or the numbers are
            none
    """
    photographs, masks, said = _choose_size(folder)
    found = Collection(said=said)
    for name in _list_objects(photographs, objects):
        why = _find_fault(name, photographs, masks)
        if why:
            found.lacking[name] = why
        else:
            found.rows.append(_describe(name, photographs, masks, folder))
    found.refuse_empty(folder)
    return found


def name_rows(source: str, objects: str | None) -> Collection:
    """Objects whose photographs and masks are fetched from ALOI's archives when they are needed.

    They are those of half the size, 384x288.

    Args:
        source: the address of the archives' folder
        objects: their numbers, as ``1-10,17``; all if not given

    Raises:
        InputError: the numbers are none, or nothing can be fetched from such an address
    """
    with blaming("--objects"):
        numbers = parse_numbers(objects, 1, OBJECTS) if objects else range(1, OBJECTS + 1)
    views, masks = (f"{source.rstrip('/')}/{archive}.tar" for archive in HALF)
    found = Collection(said=[f"fetched when they are needed: {views}, {masks}"])
    for n in numbers:
        row = _describe_cells(
            str(n), f"{views}#png2/{n}/{n}_r*.png", f"{masks}#mask2/{n}/{n}_r*.png"
        )
        found.rows.append(row)
    with blaming("--from"):
        for column in ("images", "masks"):
            parse_address(found.rows[0][column])
    return found


def recognise(folder: Path) -> bool:
    """Whether ALOI's photographs lie in a folder."""
    return any(any(_folders(folder, f"png{size}")) for size in SIZES)


def _choose_size(folder: Path) -> tuple[Path, Path | None, list[str]]:
    """The folders of photographs and of masks: of the largest that have masks, else the largest."""
    there = {size: next(_folders(folder, f"png{size}"), None) for size in SIZES}
    masks = {size: next(_folders(folder, f"mask{size}"), None) for size in SIZES}
    sizes = [size for size in SIZES if there[size]]
    if not sizes:
        raise InputError(
            f"{folder}: has no folder png, png2 or png4 with <object>/<object>_r0.png in it, as "
            "ALOI's archives of views (aloi_view.tar, aloi_red2_view.tar, aloi_red4_view.tar) have"
        )
    size = next((size for size in sizes if masks[size]), sizes[0])
    others = [there[other] for other in sizes if other != size]
    said = [f"not used: {other}: the same at another size" for other in others]
    if not masks[size]:
        said.append(
            f"no folder mask{size}: silhouettes are found by 'threshold'; to use ALOI's masks, "
            f"unpack aloi_mask{size}.tar in {folder}"
        )
    return there[size], masks[size], said


def _folders(folder: Path, name: str) -> Iterator[Path]:
    """The folders of this name, here or one further down, that hold views of a turntable."""
    for place in (folder / name, *sorted(folder.glob(f"*/{name}"))):
        if place.is_dir() and next(place.glob("*/*_r*.png"), None):
            yield place


def _list_objects(photographs: Path, objects: str | None) -> Sequence[str]:
    if objects is not None:
        with blaming("--objects"):
            return [str(number) for number in parse_numbers(objects, 1, OBJECTS)]
    return sorted((path.name for path in photographs.iterdir() if path.is_dir()), key=natural_key)


def _find_fault(name: str, photographs: Path, masks: Path | None) -> str:
    """What is lacking of an object; "" if nothing is."""
    views = [f"_r{angle}.png" for angle in ANGLES]
    why, sizes = find_faults("photographs", photographs / name, name, views)
    if why or masks is None:
        return why
    why, drawn = find_faults("masks", masks / name, name, views)
    if not why and drawn != sizes:
        why = (
            f"masks are {describe_sizes(drawn)}, photographs {describe_sizes(sizes)}; "
            f"should be of one size, those of aloi_{masks.name}.tar"
        )
    return why


def _describe(name: str, photographs: Path, masks: Path | None, folder: Path) -> Row:
    def views_in(place: Path) -> str:
        return str(usable(Path(os.path.relpath(place, folder)) / name / f"{name}_r*.png"))

    return _describe_cells(name, views_in(photographs), views_in(masks) if masks else "")


def _describe_cells(name: str, images: str, masks: str) -> Row:
    return {
        "object": f"aloi_{name}" if name.isdecimal() else to_name(name),
        "images": images,
        "masks": masks,
        "silhouettes": "mask" if masks else "threshold",
        "cameras": "calibrate",
        "turntable": f",,{STEP}",
    }
