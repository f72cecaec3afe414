"""Names of the made-up objects and of their photographs, in the layout of ALOI.

ALOI (Geusebroek, Burghouts and Smeulders, *The Amsterdam Library of Object Images*, 2005) turns
an object in steps of 5 degrees before one camera:

    png2/<object>/<object>_r<degrees>.png     RGB, 384x288
    mask2/<object>/<object>_r<degrees>.png    1 bit, white is the object

The workflow makes them under ``FOLDER`` when a dataset names them, with the true mesh beside them
as ``truth/<object>.ply``. This module imports nothing heavy, so that the workflow can ask it for
names before it runs anything.
"""

from functools import cache
from pathlib import Path

from silmesh.errors import InputError

OBJECTS = ("apricot", "bear", "bottle", "plane", "pot", "tube")
FOLDER = Path("resources/synthetic")  # relative to the working directory
VIEWS = 72
SIZE = (384, 288)  # width and height in pixels


def turntable_angles(views: int = VIEWS) -> list[int]:
    """Whole degrees by which the turntable has turned in each view.

    Raises:
        InputError: ``views`` does not divide the circle into whole degrees
    """
    if views < 1 or 360 % views:
        raise InputError(f"{views} views: should divide 360 degrees, as 72, 36, 24, 12 or 8 do")
    return list(range(0, 360, 360 // views))


def photograph_names(name: str, views: int = VIEWS) -> list[str]:
    """File names of an object's photographs, in the order of the views; its masks' are the same.

    >>> photograph_names("apricot", views=3)
    ['apricot_r0.png', 'apricot_r120.png', 'apricot_r240.png']
    """
    return [f"{name}_r{angle}.png" for angle in turntable_angles(views)]


@cache  # rules ask for each file of the folder
def promised_files(folder: Path) -> tuple[Path, ...]:
    """The photographs or masks that the workflow makes in this folder; none in any other."""
    kinds = (FOLDER / "png2", FOLDER / "mask2")
    if folder.parent in kinds and folder.name in OBJECTS:
        return tuple(folder / name for name in photograph_names(folder.name))
    return ()


def is_promised(truth: Path) -> bool:
    """Whether the workflow makes this true mesh."""
    return truth.parent == FOLDER / "truth" and truth.suffix == ".ply" and truth.stem in OBJECTS
