"""Which files a path to cameras, a file or a folder, stands for, and in which format.

The Snakefile asks for every object each time it is read, so nothing heavy is imported here, and
files are told by their names; a ``.json`` has one of three formats by its content, which the reader
looks at.
"""

from dataclasses import dataclass
from pathlib import Path

from silmesh.errors import InputError

COLMAP = ("cameras", "images")  # stems of a model's two files
WITHIN = ("", "sparse/0", "sparse", "0")  # where a COLMAP model lies in a folder
ENDINGS = {  # of a file that holds all cameras: the kind
    "_par.txt": "middlebury",
    ".json": "json",
    ".sfm": "json",
    ".npy": "softras",
    ".npz": "npz",
    ".mat": "mat",
}
NAMED = (
    "transforms.json",
    "cameras.sfm",
    "cameras.json",
    "camera.npy",
    "*_par.txt",
    "cameras*.npz",
)
KNOWN = (
    "a COLMAP model (a folder with cameras and images, .bin or .txt), Meshroom's cameras.sfm, "
    "NeRF's transforms.json, silmesh's cameras.json, a folder of 3x4 matrices in .txt files, a "
    ".mat of P, an .npz of world_mat_0, world_mat_1, ..., Middlebury's _par.txt and "
    "SoftRas's camera.npy"
)


@dataclass(frozen=True)
class Located:
    """Cameras on disk.

    Attributes:
        kind: ``colmap``, ``texts``, or a value of ``ENDINGS``
        path: the file, or the folder of a COLMAP model or of texts
        files: what is read
    """

    kind: str
    path: Path
    files: tuple[Path, ...]


def locate(path: Path) -> Located:
    """Find the cameras that a file or a folder holds.

    Raises:
        InputError: it is not there, or holds none that are known
    """
    if path.is_file():
        if path.stem in COLMAP and path.suffix in (".txt", ".bin"):
            path = path.parent
        else:
            for ending, kind in ENDINGS.items():
                if path.name.lower().endswith(ending):
                    return Located(kind, path, (path,))
            raise InputError(f"{path}: unknown camera format; known are {KNOWN}")
    if not path.is_dir():
        raise InputError(f"{path}: is not there")
    if found := _find_within(path):
        return found
    raise InputError(f"{path}: holds no cameras; known are {KNOWN}")


def _find_within(folder: Path) -> Located | None:
    for within in WITHIN:
        for ending in (".bin", ".txt"):
            files = tuple(folder / within / f"{stem}{ending}" for stem in COLMAP)
            if all(file.is_file() for file in files):
                return Located("colmap", folder / within, files)
    for name in NAMED:
        for file in sorted(folder.glob(name)):
            return locate(file)
    if texts := tuple(sorted(f for f in folder.glob("*.[tT][xX][tT]") if f.is_file())):
        return Located("texts", folder, texts)
    return None
