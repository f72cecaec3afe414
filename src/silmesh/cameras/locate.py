"""Which files a path to cameras, a file or a folder, stands for, and in which format.

The Snakefile asks for every object each time it is read, so nothing heavy is imported here, and
files are told by their names; a ``.json`` has one of three formats by its content, which the reader
looks at, and a ``.npy`` one of two by the shape in its header.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from silmesh.cameras.unread import find_within, read_beginning, recognise_file
from silmesh.errors import InputError, name_some

COLMAP = ("cameras", "images")  # stems of a model's two files
WITHIN = ("", "sparse", "colmap/sparse", "colmap", "dense/sparse")  # where models lie in a folder
ENDINGS = {  # of a file that holds all cameras: the kind
    "_par.txt": "middlebury",
    ".json": "json",
    ".sfm": "json",
    ".npy": "npy",
    ".npz": "npz",
    ".mat": "mat",
    ".xml": "metashape",
    ".out": "bundler",
    ".csv": "realitycapture",
}
NAMED = (
    "transforms.json",
    "cameras.sfm",
    "cameras.json",
    "camera.npy",
    "poses_bounds.npy",
    "*_par.txt",
    "cameras*.npz",
    "cameras.xml",
    "bundle.out",
    "bundle/bundle.out",
)
SPLITS = tuple(f"transforms_{name}.json" for name in ("train", "val", "test"))
ALONE = (  # files without a name of their own, taken where there is one: what they begin with
    ("*.sfm", b""),
    ("*.xml", b"<document"),
    ("*.out", b"# Bundle"),
    ("*.csv", b"#name,"),
    ("transforms*.json", b""),
)
LIST = ("list.txt", "*.list.txt", "*list*.txt", "*.lst")  # of a Bundler file's photographs
LLFF = 17  # numbers a view in its array
KNOWN = (
    "a COLMAP model (a folder with cameras and images, .bin or .txt), Meshroom's cameras.sfm, "
    "NeRF's transforms.json, also as transforms_train.json and its siblings, LLFF's "
    "poses_bounds.npy, Metashape's cameras.xml, Bundler's .out, RealityCapture's .csv, silmesh's "
    "cameras.json, a folder of 3x4 matrices in .txt files, a .mat of P, an .npz of world_mat_0, "
    "world_mat_1, ..., Middlebury's _par.txt and SoftRas's camera.npy"
)


@dataclass(frozen=True)
class Located:
    """Cameras on disk.

    Attributes:
        kind: ``colmap``, ``texts``, ``nerf``, ``llff``, ``softras``, or another value of
            ``ENDINGS``
        path: the file, or the folder of a COLMAP model or of several, of texts or of NeRF's splits
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
    try:
        return _locate(path)
    except OSError as error:  # a name too long, a folder without permission
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def _locate(path: Path) -> Located:
    if path.is_file():
        if path.stem not in COLMAP or path.suffix not in (".txt", ".bin"):
            return _locate_file(path)
        path = path.parent
    if not path.is_dir():
        raise InputError(f"{path}: is not there")
    if found := _find_within(path):
        return found
    if unread := find_within(path):
        raise InputError(f"{unread[0]}: {unread[1]}")
    raise InputError(f"{path}: holds no cameras; known are {KNOWN}")


def find_models(folder: Path) -> list[Path]:
    """The COLMAP model that a folder is, or those in it that are numbered as COLMAP does."""
    if model_files(folder):
        return [folder]
    numbered = (path for path in folder.glob("[0-9]*") if path.name.isdecimal())
    return sorted((path for path in numbered if model_files(path)), key=lambda p: int(p.name))


def model_files(folder: Path) -> tuple[Path, ...]:
    """The two files of a COLMAP model, binary before text; none if the folder is none."""
    for ending in (".bin", ".txt"):
        files = tuple(folder / f"{stem}{ending}" for stem in COLMAP)
        if all(file.is_file() for file in files):
            return files
    return ()


def _locate_file(path: Path) -> Located:
    for ending, kind in ENDINGS.items():
        if path.name.lower().endswith(ending):
            if kind == "npy":
                kind = "llff" if _count_columns(path) == LLFF else "softras"
            lists = find_lists(path) if kind == "bundler" else []
            return Located(kind, path, (path, *lists))
    if unread := recognise_file(path):
        raise InputError(f"{path}: {unread}")
    raise InputError(f"{path}: unknown camera format; known are {KNOWN}")


def find_lists(path: Path) -> list[Path]:
    """The list of a Bundler file's photographs: named as it is, or in its folder or the one above.

    At most one.
    """
    stem = path.name.removesuffix(".out").removesuffix(".bundle")
    own = [path.with_name(stem + ending) for ending in (".list.txt", ".txt", ".lst")]
    own.append(path.with_name(f"{path.name}.list.txt"))
    folders = (path.parent, path.parent.parent) if path.parent.name == "bundle" else (path.parent,)
    others = [file for folder in folders for name in LIST for file in sorted(folder.glob(name))]
    return [file for file in (*own, *others) if file.is_file()][:1]


def _count_columns(path: Path) -> int | None:
    """How many columns an array has by the header of its ``.npy`` file; None if it has no such."""
    shape = re.search(rb"'shape': \(\d{1,9}, (\d{1,9})\)", read_beginning(path))
    return int(shape[1]) if shape else None


def _find_within(folder: Path) -> Located | None:
    for within in WITHIN:
        if models := find_models(folder / within):
            folder_or_model = models[0] if len(models) == 1 else folder / within
            files = tuple(file for model in models for file in model_files(model))
            return Located("colmap", folder_or_model, files)
    for name in NAMED:
        for file in sorted(folder.glob(name)):
            return locate(file)
    if splits := tuple(folder / name for name in SPLITS if (folder / name).is_file()):
        return Located("nerf", folder, splits)
    if file := _find_alone(folder):
        return locate(file)
    if texts := tuple(sorted(f for f in folder.glob("*.[tT][xX][tT]") if f.is_file())):
        return Located("texts", folder, texts)
    return None


def _find_alone(folder: Path) -> Path | None:
    """The one file of a format whose files are named as one likes."""
    for pattern, marker in ALONE:
        files = sorted(file for file in folder.glob(pattern) if file.is_file())
        files = [file for file in files if marker in read_beginning(file)]
        if len(files) > 1:
            names = name_some([file.name for file in files])
            raise InputError(f"{folder}: holds {len(files)} files of cameras; name one of {names}")
        if files:
            return files[0]
    return None
