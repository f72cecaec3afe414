"""ShapeNet in the files of the papers on differentiable rendering: a class and split in two files.

``<class>_<split>_images.npz`` has the renderings of all objects and ``<class>_<split>_voxels.npz``,
if it is there, their true voxels (``silmesh.reading``, ``silmesh.geometry.voxels``).
"""

from pathlib import Path

from silmesh.errors import InputError, blaming
from silmesh.intake.unpacked import Collection, Row
from silmesh.naming import natural_key
from silmesh.planning.datasets import to_name, usable
from silmesh.planning.numbers import parse_numbers, write_numbers
from silmesh.reading import IMAGES, count_objects

ENDING, TRUTH = "_images.npz", "_voxels.npz"


def find_rows(folder: Path, objects: str | None) -> Collection:
    """A row of each class and split, which stands for each of its objects.

    Args:
        folder: that the files lie in, and the table is to
        objects: their numbers from 0, as ``0-99,200``; all if not given

    Raises:
        InputError: there is no such file in it, one is of another shape, or has not so many objects
    """
    files = sorted((file.name for file in folder.glob(f"*{ENDING}")), key=natural_key)
    if not files:
        raise InputError(
            f"{folder}: has no file named <class>_<split>{ENDING}, as 02691156_test{ENDING}"
        )
    found = Collection(size=IMAGES[-1])
    for name in files:
        row, count = _describe(name, folder, objects)
        found.rows.append(row)
        found.said.append(f"{row['object']}: {count:,} object{'s' * (count > 1)}")
        if "truth" not in row:
            found.said.append(f"{row['object']}: no truth: {row['object']}{TRUTH} is not there")
    return found


def recognise(folder: Path) -> bool:
    """Whether files of renderings lie in a folder."""
    return any(folder.glob(f"*{ENDING}"))


def _describe(name: str, folder: Path, objects: str | None) -> tuple[Row, int]:
    """The row of a class, and how many objects it stands for."""
    count = count_objects(folder / usable(Path(name)), IMAGES)
    with blaming(f"--objects: {folder / name}"):
        numbers = parse_numbers(f"0-{count - 1}" if objects is None else objects, 0, count - 1)
    row = {
        "object": to_name(name.removesuffix(ENDING)),
        "images": f"{name}#{write_numbers(numbers)}",
        "silhouettes": "alpha",
        "cameras": "turntable",
    }
    truth = name.removesuffix(ENDING) + TRUTH
    return row | ({"truth": truth} if (folder / truth).is_file() else {}), len(numbers)
