"""RealityCapture's (RealityScan's) CSV of internal and external camera parameters.

    #name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2

x, y, alt is the camera's place. Its axes right, up and back in the world are the columns of
Rz(-heading) Rx(pitch) Ry(roll), in degrees. f is for a sensor of 36 mm along the image's longer
side; px, py are in parts of that side, from the middle. Distortion is Brown's, with t1 and t2 in
the order that OpenCV calls p2 and p1. Newer versions write yaw, f_35mm, px_norm and py_norm.

These are the formulas of the program's own export templates (``$(f*36)``, OpenCV's
``$(px*scale+width*0.5)`` and ``k1,k2,t2,t1,k3,k4``), and of the importers of nerfstudio and others.
What the file does not say is whether k1 alone is Brown's or of the division model, so that is
refused.
"""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from silmesh.cameras.formats.assignment import Sizes
from silmesh.cameras.formats.parsing import UNSAID, Camera, gather, intrinsics, numbers, read_lines
from silmesh.errors import InputError, blaming
from silmesh.geometry.camera import OPENGL, Cameras
from silmesh.geometry.lens import Lens, lens_of
from silmesh.views import View

SENSOR = 36.0  # mm
NEWER = {"yaw": "heading", "f_35mm": "f", "px_norm": "px", "py_norm": "py"}
NEEDED = ("name", "x", "y", "alt", "heading", "pitch", "roll", "f")
OPTIONAL = ("px", "py", "k1", "k2", "k3", "k4", "t1", "t2")
LENS = ("k1", "k2", "k3", "k4", "t2", "t1")  # in the order of the lens BROWN


def read(path: Path, views: Sequence[View]) -> Cameras:
    """Cameras by the names of their images; the views say the sizes, which the file does not."""
    lines = [line for line in read_lines(path) if line.strip()]
    if lines and lines[0].startswith("#cameras"):
        lines = lines[1:]
    try:
        rows = list(csv.reader(lines))
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read as CSV: {error}") from error
    header = _parse_header(rows[0] if rows else [], path)
    if len(rows) < 2:
        raise InputError(f"{path}: holds no camera")
    sizes = Sizes(views)
    return gather(
        [_parse(header, row, sizes, f"{path}: row {i}") for i, row in enumerate(rows[1:])]
    )


def _parse_header(words: Sequence[str], path: Path) -> list[str]:
    """The columns' names, as older versions write them."""
    found = [word.strip().lstrip("#").lower() for word in words]
    header = [NEWER.get(name, name) for name in found]
    missing = [name for name in NEEDED if name not in header]
    unknown = [name for name in header if name not in NEEDED + OPTIONAL]
    if missing or unknown:
        raise InputError(
            f"{path}: should begin with the columns #{','.join(NEEDED + OPTIONAL)}; "
            + (f"{', '.join(missing)} are missing" if missing else f"{unknown[0]!r} is unknown")
            + ". Export it as Internal/External camera parameters"
        )
    return header


def _parse(header: Sequence[str], row: list[str], sizes: Sizes, where: str) -> Camera:
    if len(row) != len(header):
        raise InputError(f"{where}: has {len(row)} fields; should have {len(header)}")
    fields = dict(zip(header, row, strict=True))
    name = fields.pop("name").strip()
    where = f"{where} ({name})"
    value = dict.fromkeys(OPTIONAL, 0.0)
    value |= {key: float(numbers(word, (), f"{where}: {key}")) for key, word in fields.items()}
    size = np.array(sizes.of(name))
    longer = float(size.max())
    centre = size / 2 + longer * np.array([value["px"], value["py"]])
    K = intrinsics((value["f"] * longer / SENSOR,) * 2, tuple(centre), where)
    angles = [-value["heading"], value["pitch"], value["roll"]]
    R = OPENGL @ Rotation.from_euler("ZXY", angles, degrees=True).as_matrix().T
    t = -R @ np.array([value["x"], value["y"], value["alt"]])
    with blaming(where):
        return Camera(name, UNSAID, K, R, t, _parse_lens(value))


def _parse_lens(value: Mapping[str, float]) -> Lens | None:
    if value["k1"] and not any(value[name] for name in LENS[1:]):
        raise InputError(
            "a lens of k1 alone may be of the division model or Brown's, which the file does not "
            "tell; set the distortion model to Brown3 and align anew, or export undistorted images"
        )
    return lens_of("BROWN", [value[name] for name in LENS])
