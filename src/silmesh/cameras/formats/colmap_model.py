"""COLMAP models, text and binary: ``cameras`` and ``images``; points are left where they are.

Poses are from world to camera as ours, quaternions w first, pixel centres at integer + 0.5. A model
is read here and not by pycolmap, whose reader wants the points too, which can be gigabytes, and
whose import before Pillow's lets Pillow crash.

https://colmap.github.io/format.html
"""

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from silmesh.cameras.formats.parsing import (
    Camera,
    gather,
    intrinsics,
    numbers,
    pixels,
    read_lines,
    refuse_skew,
)
from silmesh.cameras.locate import find_models, model_files
from silmesh.errors import InputError, blaming, cut, shorten
from silmesh.files import replacing, try_file
from silmesh.geometry.camera import Cameras
from silmesh.geometry.lens import CURVED, PLAIN, Lens, lens_of

MODELS = {  # by their number in a binary model
    0: "SIMPLE_PINHOLE",
    1: "PINHOLE",
    2: "SIMPLE_RADIAL",
    3: "RADIAL",
    4: "OPENCV",
    5: "OPENCV_FISHEYE",
    6: "FULL_OPENCV",
    7: "FOV",
    8: "SIMPLE_RADIAL_FISHEYE",
    9: "RADIAL_FISHEYE",
    10: "THIN_PRISM_FISHEYE",
    14: "SIMPLE_FISHEYE",
    15: "FISHEYE",
}
OTHER_MODELS = {  # that are not read
    11: "RAD_TAN_THIN_PRISM_FISHEYE",
    12: "SIMPLE_DIVISION",
    13: "DIVISION",
    16: "EUCM",
    17: "EQUIRECTANGULAR",
}
ONE_FOCAL = {  # f, cx, cy; the others have fx, fy, cx, cy
    *("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"),
    *("SIMPLE_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"),
}
WIDER = {  # with two focal lengths, as images that were stretched need
    "SIMPLE_RADIAL": "OPENCV",
    "RADIAL": "OPENCV",
    "SIMPLE_FISHEYE": "FISHEYE",
    "SIMPLE_RADIAL_FISHEYE": "OPENCV_FISHEYE",
    "RADIAL_FISHEYE": "OPENCV_FISHEYE",
}
NUMBER = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"
UNIT = 1e-3  # by which a quaternion's length may differ from 1
SMALLEST = 1e-6  # norm of a quaternion, which should be 1
OURS = b"written by silmesh"
HEADER = f"# {{}}, {OURS.decode()}; pixel centres lie at integer + 0.5\n"
Intrinsics = tuple[tuple[int, int], np.ndarray, Lens | None]  # size, K, lens


def split(model: str, parameters: Sequence[float], where: str) -> tuple[np.ndarray, Lens | None]:
    """K and the lens of a camera's model and all its parameters in COLMAP's order.

    Raises:
        InputError: the model is unknown, or has another number of parameters
    """
    count = 3 if model in ONE_FOCAL else 4
    if len(parameters) < count and model in (*PLAIN, *CURVED):
        raise InputError(f"{where}: {model} has {len(parameters)} parameters, which are too few")
    if len(parameters) > count and model in PLAIN:  # perhaps a lens's, which is not to be lost
        raise InputError(f"{where}: {model} has {len(parameters)} parameters, which are too many")
    with blaming(where):
        lens = lens_of(model, parameters[count:])
    cx, cy = parameters[count - 2 : count]
    return intrinsics((parameters[0], parameters[count - 3]), (cx, cy), where), lens


def read(folder: Path) -> dict[str, Cameras]:
    """Cameras by the names of the images, of each model that a folder is or holds.

    COLMAP numbers the parts of a scene that it could not join; one without images, or that cannot
    be read, is left out as long as another can.

    Raises:
        InputError: none can be read
    """
    models, wrong = {}, []
    for model in find_models(folder):
        try:
            models[model.name] = _read_model(model)
        except InputError as error:
            wrong.append(error)
    if not models:
        raise wrong[0] if wrong else InputError(f"{folder}: holds no COLMAP model")
    return models


def _read_model(folder: Path) -> Cameras:
    """A binary model goes before a text one."""
    camera_file, image_file = model_files(folder)
    if camera_file.suffix == ".bin":
        cameras = _by_number(_cameras_binary(camera_file), folder)
        images = list(_images_binary(image_file))
    else:
        cameras = _by_number(_cameras_text(camera_file), folder)
        images = list(_images_text(image_file))
    if not images:
        raise InputError(f"{folder}: the model has no image; no photograph was registered")
    return gather([_join(folder, cameras, *image) for image in images])


def _by_number(cameras: Iterator[tuple[int, Intrinsics]], folder: Path) -> dict[int, Intrinsics]:
    found: dict[int, Intrinsics] = {}
    for number, camera in cameras:
        if number in found:
            raise InputError(f"{folder}: has camera {number} twice")
        found[number] = camera
    return found


def _to_number(word: str, where: str) -> int:
    """A camera's number from a text."""
    if not (word.isascii() and word.isdecimal() and len(word) < 20):
        raise InputError(f"{where}: CAMERA_ID should be a number, not {shorten(word)}")
    return int(word)


def _join(
    folder: Path, cameras: Mapping[int, Intrinsics], number: int, pose: np.ndarray, name: str
) -> Camera:
    where = f"{folder}: image {cut(name, 80)}"
    if number not in cameras:
        raise InputError(f"{where}: has camera {number}, which the model does not hold")
    numbers(pose, (7,), f"{where}: its pose")
    if not np.linalg.norm(pose[:4]) > SMALLEST:
        raise InputError(f"{where}: its quaternion is zero")
    size, K, lens = cameras[number]
    R = Rotation.from_quat(pose[:4], scalar_first=True).as_matrix()
    return Camera(name, size, K, R, pose[4:], lens)


def _rows(path: Path) -> list[str]:
    return [line.strip() for line in read_lines(path) if not line.startswith("#")]


def _cameras_text(path: Path) -> Iterator[tuple[int, Intrinsics]]:
    for row in filter(None, _rows(path)):
        words = row.split()
        if len(words) < 5:
            raise InputError(
                f"{path}: a camera should be CAMERA_ID MODEL WIDTH HEIGHT PARAMS[], not "
                f"{shorten(row)}"
            )
        number, model, width, height, *values = words
        where = f"{path}: camera {cut(number, 20)}"
        size = pixels(width, height, where)
        values = numbers(values, (len(values),), where).tolist()
        yield _to_number(number, where), (size, *split(model, values, where))


def _images_text(path: Path) -> Iterator[tuple[int, np.ndarray, str]]:
    """Camera, quaternion and translation, name.

    After an image comes a line of its points or an empty one, which files written by hand may
    lack: a line of points is numbers in threes, one of an image is not.
    """
    points = False  # whether a line of points may come
    for row in _rows(path):
        as_points = _is_points(row)
        if points and row and as_points and _is_pose(row):
            raise InputError(
                f"{path}: {row[:80]!r} may be an image or the points of the one before; write an "
                "empty line after each image"
            )
        if row and not (points and as_points):
            yield _parse_image(row, path, as_points)
            points = True
        else:
            points = False


def _is_points(row: str) -> bool:
    """Whether a line is x y id x y id ..., or empty."""
    words = row.split()
    kinds = (NUMBER, NUMBER, r"-?\d+")
    return len(words) % 3 == 0 and all(
        re.fullmatch(kinds[i % 3], word) for i, word in enumerate(words)
    )


def _is_id(word: str) -> bool:
    return re.fullmatch(r"\d{1,19}", word) is not None


def _is_pose(row: str) -> bool:
    """Whether a line begins as an image's does, with a quaternion that is a rotation."""
    words = row.split(maxsplit=9)
    if len(words) != 10 or not _is_id(words[0]) or not _is_id(words[8]):
        return False
    quaternion = np.array([float(word) for word in words[1:5]])
    return bool(abs(np.linalg.norm(quaternion) - 1) < UNIT)


def _parse_image(row: str, path: Path, as_points: bool) -> tuple[int, np.ndarray, str]:
    parts = row.split(maxsplit=9)
    if (
        len(parts) != 10
        or not _is_id(parts[0])
        or not _is_id(parts[8])
        or (as_points and not _is_pose(row))
    ):
        raise InputError(
            f"{path}: an image should be IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, with a "
            f"line of its points or an empty one after it, not {row[:80]!r}"
        )
    where = f"{path}: image {cut(parts[9], 80)}"
    pose = numbers(parts[1:8], (7,), where)
    return int(parts[8]), pose, parts[9]


class _Bytes:
    """A binary file from its beginning to its end."""

    def __init__(self, path: Path):
        self.path, self.at = path, 0
        try:
            self.data = path.read_bytes()
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from error

    def take(self, layout: str) -> tuple:
        """The next values by a layout of ``struct``, little-endian."""
        layout = f"<{layout}"
        return struct.unpack_from(layout, self.data, self.skip(struct.calcsize(layout)))

    def skip(self, count: int) -> int:
        """Go this many bytes on; gives where they begin."""
        start, self.at = self.at, self.at + count
        if self.at > len(self.data):
            raise self._truncated(self.at)
        return start

    def word(self) -> str:
        """Text up to a zero byte."""
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise self._truncated(len(self.data) + 1)
        start, self.at = self.at, end + 1
        return self.data[start:end].decode("utf-8", errors="replace")

    def _truncated(self, least: int) -> InputError:
        return InputError(
            f"{self.path}: is truncated, or no binary COLMAP model: has {len(self.data)} bytes, "
            f"should have {least} or more"
        )


def _cameras_binary(path: Path) -> Iterator[tuple[int, Intrinsics]]:
    file = _Bytes(path)
    for _ in range(*file.take("Q")):
        number, kind, width, height = file.take("IiQQ")
        where = f"{path}: camera {number}"
        if kind not in MODELS:
            raise InputError(
                f"{where}: camera model {OTHER_MODELS.get(kind, kind)} cannot be read; known are "
                f"{', '.join(MODELS.values())}"
            )
        model = MODELS[kind]
        count = len(CURVED.get(model, ())) + (3 if model in ONE_FOCAL else 4)
        K, lens = split(model, list(file.take(f"{count}d")), where)
        yield number, (pixels(width, height, where), K, lens)


def _images_binary(path: Path) -> Iterator[tuple[int, np.ndarray, str]]:
    file = _Bytes(path)
    for _ in range(*file.take("Q")):
        _, *pose, number = file.take("I7dI")
        name = file.word()
        file.skip(24 * file.take("Q")[0])  # points: x, y, number
        yield number, np.array(pose), name


def write(folder: Path, cameras: Cameras, images: Mapping[str, str]) -> None:
    """Write a text model of these cameras, each view with a camera of its own, and no points.

    Args:
        folder: where ``cameras.txt``, ``images.txt`` and ``points3D.txt`` go; what else is in it
            stays
        images: by its view the name of an image

    Raises:
        InputError: a camera has a skew, which COLMAP's models have not; a place cannot be written
    """
    camera_rows = [_camera_row(cameras, i) for i in range(len(cameras))]
    image_rows = [_image_rows(cameras, i, images[view]) for i, view in enumerate(cameras.views)]
    columns = "IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"
    files = {
        "cameras.txt": ["CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]", *camera_rows],
        "images.txt": [columns, *image_rows],
        "points3D.txt": ["no points"],
    }
    for name in files:
        _refuse_other_model(folder / name)
        try_file(folder / name)
    for name, (head, *rows) in files.items():
        with replacing(folder / name) as part:
            part.write_text(HEADER.format(head) + "".join(rows), encoding="utf-8")


def _refuse_other_model(file: Path) -> None:
    """Refuse to write over a file of a model that another program wrote."""
    if file.is_file() and OURS not in file.read_bytes()[: len(HEADER) + 80]:
        raise InputError(f"{file}: is there, and not of silmesh; should be in another folder")


def _camera_row(cameras: Cameras, i: int) -> str:
    refuse_skew(cameras, i)
    K, lens = cameras.K[i].tolist(), cameras.lenses[i]
    model, beyond = (lens.model, list(lens.parameters)) if lens else (PLAIN[1], [])
    if model not in (*PLAIN, *CURVED):
        raise InputError(
            f"view {cameras.views[i]!r}: COLMAP has no lens {model}; write the cameras of the "
            "scene, whose images are undistorted"
        )
    model = WIDER.get(model, model)  # its parameters are those and zeros
    beyond += [0.0] * (len(CURVED.get(model, ())) - len(beyond))
    values = [K[0][0], K[1][1], K[0][2], K[1][2], *beyond]
    width, height = cameras.sizes[i].tolist()
    return f"{i + 1} {model} {width} {height} {' '.join(map(repr, values))}\n"


def _image_rows(cameras: Cameras, i: int, name: str) -> str:
    quaternion = Rotation.from_matrix(cameras.R[i].numpy()).as_quat(scalar_first=True)
    pose = " ".join(map(repr, [*quaternion.tolist(), *cameras.t[i].tolist()]))
    return f"{i + 1} {pose} {i + 1} {name}\n\n"
