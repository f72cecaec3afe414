"""The Columbia Object Image Libraries, as their archives are unpacked.

COIL-20 and COIL-100 (Nene, Nayar and Murase, 1996) have objects on a turntable, numbered from 1, 72
views each, all in one folder. COIL-100 names a view by its degrees, COIL-20 by its number:

    obj1__0.png  obj1__5.png  ...  obj1__355.png     coil-100
    obj1__0.png  obj1__1.png  ...  obj1__71.png      coil-20-proc

The objects may also lie in folders of their own.
"""

import os
import re
from collections import defaultdict
from pathlib import Path

from silmesh.errors import InputError, blaming
from silmesh.intake.unpacked import Collection, Row, find_faults
from silmesh.planning.datasets import usable
from silmesh.planning.numbers import parse_numbers

OBJECTS = 100  # of the larger library
VIEWS = 72
STEP = 360 // VIEWS  # degrees from one view to the next
NAME = re.compile(r"obj(\d{1,4})__(\d{1,3})\.png", re.ASCII)


def find_rows(folder: Path, objects: str | None) -> Collection:
    """The objects of which all views are there.

    Args:
        folder: that the archive was unpacked in, and the table is to lie in
        objects: their numbers, as ``1-10,17``; all that are there if not given

    Raises:
        InputError: there is no such photograph in it, no object is there whole, or the numbers are
            none
    """
    places, by_degrees = _find_objects(folder)
    found = Collection(size=128)
    with blaming("--objects"):
        numbers = parse_numbers(objects, 1, OBJECTS) if objects is not None else sorted(places)
    for number in numbers:
        views = [f"{i * STEP if by_degrees else i}.png" for i in range(VIEWS)]
        place = places.get(number, folder)
        why, _ = find_faults("photographs", place, f"obj{number}__", views)
        if why:
            found.lacking[str(number)] = why
        else:
            found.rows.append(_describe(number, places[number], folder))
    found.refuse_empty(folder)
    return found


def recognise(folder: Path) -> bool:
    """Whether photographs that are named as COIL's lie in a folder."""
    return any(NAME.fullmatch(name) for name in os.listdir(folder))


def _find_objects(folder: Path) -> tuple[dict[int, Path], bool]:
    """The folder of each object's photographs, and whether these are named by degrees."""
    places, last = {}, defaultdict(int)
    for file in (*folder.glob("obj*__*.png"), *folder.glob("*/obj*__*.png")):
        if found := NAME.fullmatch(file.name):
            number, view = map(int, found.groups())
            places.setdefault(number, file.parent)
            last[number] = max(last[number], view)
    if not places:
        raise InputError(
            f"{folder}: has no photograph named obj1__0.png and so on, as COIL's archives have, "
            "here or in a folder in it"
        )
    return places, max(last.values()) >= VIEWS


def _describe(number: int, place: Path, folder: Path) -> Row:
    # Views were cropped to their object and enlarged; calibration finds that.
    return {
        "object": f"coil_{number}",
        "images": str(usable(Path(os.path.relpath(place, folder)) / f"obj{number}__*.png")),
        "silhouettes": "threshold",
        "cameras": "calibrate",
        "turntable": f",,{STEP}",
    }
