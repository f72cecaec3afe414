"""NeRF's ``transforms.json``: poses from camera to world with OpenGL's axes, a pinhole or a lens.

    {"camera_angle_x": 0.69, "frames": [{"file_path": "./train/r_0", "transform_matrix": [...]}]}

OpenGL's camera has x right, y up and looks along -z, so R = diag(1, -1, -1) of the pose's inverse.
The intrinsics fl_x, fl_y, cx, cy, w, h, k1, k2, p1, p2 and camera_model stand at the top or in a
frame (instant-ngp, nerfstudio); without them camera_angle_x is the angle across the photograph.
Pixel centres lie at integer + 0.5, as instant-ngp and nerfstudio have them. What a frame says of a
lens, a shutter or a projection that is not known here is refused, never left out.

A folder may hold transforms_train.json, transforms_val.json and transforms_test.json, as NeRF's
synthetic scenes do: their frames are read together, and told apart by the folders in their names.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from silmesh.cameras.formats.assignment import Sizes, is_scaled
from silmesh.cameras.formats.parsing import (
    UNSAID,
    Camera,
    gather,
    intrinsics,
    nearest_rotation,
    numbers,
    pixels,
    refuse_skew,
)
from silmesh.cameras.locate import SPLITS
from silmesh.errors import InputError, blaming, cut
from silmesh.files import replacing
from silmesh.geometry.camera import OPENGL, Cameras, refuse_many
from silmesh.geometry.lens import CURVED, PLAIN, Lens, lens_of, refuse_strange
from silmesh.reading import read_json
from silmesh.views import View

WHOLE = 1e-6  # by which twice a principal point may differ from a whole number of pixels
SAME = 0.02  # by which a width in the file may differ from the photograph's own
NEEDED = ("file_path", "transform_matrix")  # of each frame
NARROWEST = 1e-6  # radians across a photograph
LENS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "s1", "s2", "omega")
USUAL = (*PLAIN, "PERSPECTIVE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")  # OpenCV's k1 k2 p1 p2 k3
KEPT = (*PLAIN, "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE")  # that are written


def is_transforms(content: Any) -> bool:
    """Whether this is what a ``transforms.json`` holds."""
    return isinstance(content, dict) and "frames" in content


def read(path: Path, views: Sequence[View]) -> Cameras:
    """Cameras by the names of their images; the views say the size that an angle is across.

    Args:
        path: a file, or the folder of the files of a scene's parts
    """
    files = [path / name for name in SPLITS if (path / name).is_file()] if path.is_dir() else [path]
    sizes = Sizes(views)
    return gather([camera for file in files for camera in _read_file(file, sizes)])


def _read_file(path: Path, sizes: Sizes) -> list[Camera]:
    content = read_json(path)
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames or not all(isinstance(f, dict) for f in frames):
        raise InputError(f"{path}: should hold a list 'frames' of {{file_path, transform_matrix}}")
    refuse_many(path, len(frames))
    shared = {key: value for key, value in content.items() if key != "frames"}
    return [_parse(shared | f, f"{path}: frame {i}", sizes) for i, f in enumerate(frames)]


def _parse(frame: Mapping[str, Any], where: str, sizes: Sizes) -> Camera:
    with blaming(where):
        refuse_strange(frame, (*LENS, "is_fisheye"))
    for key in NEEDED:
        if key not in frame:
            raise InputError(f"{where}: {key!r} is missing")
    name = str(frame["file_path"])
    where = f"{where} ({cut(name, 80)})"
    pose = frame["transform_matrix"]
    pose = pose[:3] if isinstance(pose, list) else pose
    pose = numbers(pose, (3, 4), f"{where}: transform_matrix")
    R = OPENGL @ nearest_rotation(pose[:, :3], where).T
    own = sizes.of(name)
    size = _parse_size(frame, own, where)
    K = _parse_intrinsics(frame, size if all(size) else own, where)
    with blaming(where):
        lens = _parse_lens(frame, where)
    return Camera(name, size, K, R, -R @ pose[:, 3], lens)


def _parse_size(frame: Mapping[str, Any], own: tuple[int, int], where: str) -> tuple[int, int]:
    """Width and height that a frame's pixels are of; UNSAID if it is not given.

    Where w and h are missing, fl_x beside camera_angle_x tells the width, and a principal point in
    the middle of another size of the photograph's aspect tells that size.
    """
    given = frame.get("w"), frame.get("h")
    if None not in given:
        return pixels(*given, where)
    focal, across = (_number(frame, key, where, 0) for key in ("fl_x", "camera_angle_x"))
    width, height = 2 * _number(frame, "cx", where, 0), 2 * _number(frame, "cy", where, 0)
    if focal > 0 and 0 < across < math.pi:
        width = 2 * focal * math.tan(across / 2)
        height = width * own[1] / own[0]
    elif any(abs(side - round(side)) > WHOLE for side in (width, height)):
        return UNSAID
    size = round(width), round(height)
    return size if is_scaled(size, own) and abs(size[0] / own[0] - 1) > SAME else UNSAID


def _number(frame: Mapping[str, Any], key: str, where: str, default: float) -> float:
    value = frame.get(key, default)
    return float(numbers(default if value is None else value, (), f"{where}: {key}"))


def _parse_intrinsics(frame: Mapping[str, Any], size: tuple[int, int], where: str) -> np.ndarray:
    width, height = size
    across = _number(frame, "camera_angle_x", where, 0)
    fx = _number(frame, "fl_x", where, 0)
    if not fx and not NARROWEST < across < math.pi:
        raise InputError(
            f"{where}: should have fl_x, or camera_angle_x between 0 and pi, not {across:g}"
        )
    fx = fx or width / 2 / math.tan(across / 2)
    fy = _number(frame, "fl_y", where, fx)
    centre = _number(frame, "cx", where, width / 2), _number(frame, "cy", where, height / 2)
    return intrinsics((fx, fy), centre, where)


def _parse_lens(frame: Mapping[str, Any], where: str) -> Lens | None:
    """Its model as ``camera_model`` names it; OpenCV's where that is a usual one, or missing."""
    value = {key: _number(frame, key, where, 0) for key in LENS if key in frame}
    model = str(frame.get("camera_model") or "OPENCV").upper()
    if frame.get("is_fisheye"):
        model = "OPENCV_FISHEYE"
    if model in USUAL:
        if value.get("k4"):
            raise InputError("k4 of a lens that is no fisheye cannot be read; undistort the images")
        model = "FULL_OPENCV" if value.get("k3") else "OPENCV"
    lens = lens_of(model, [value.pop(name, 0.0) for name in CURVED.get(model, ())])
    extra = {name: k for name, k in value.items() if k}
    if extra and not model.endswith("FISHEYE"):
        raise InputError(f"a lens {model} has no {', '.join(extra)}, which the file gives")
    return lens


def write(path: Path, cameras: Cameras, images: Mapping[str, str]) -> None:
    """Write ``transforms.json``; what all frames share stands at its top.

    Args:
        images: by its view the path of an image, as it will stand in the file

    Raises:
        InputError: a camera has a lens or a skew that the format has no words for
    """
    frames = [_frame(cameras, i, images[view]) for i, view in enumerate(cameras.views)]
    shared = {k: v for k, v in frames[0].items() if all(f.get(k) == v for f in frames)}
    own = [{k: v for k, v in f.items() if k not in shared or k in NEEDED} for f in frames]
    with replacing(path) as part:
        part.write_text(json.dumps({**shared, "frames": own}, indent=1) + "\n", encoding="utf-8")


def _frame(cameras: Cameras, i: int, image: str) -> dict[str, Any]:
    pose = np.eye(4)
    pose[:3, :3] = cameras.R[i].numpy().T @ OPENGL
    pose[:3, 3] = cameras.centres[i].numpy()
    K, (width, height) = cameras.K[i].numpy(), cameras.sizes[i].tolist()
    refuse_skew(cameras, i)
    frame = {"camera_model": "OPENCV", "w": width, "h": height, "fl_x": K[0, 0], "fl_y": K[1, 1]}
    frame |= {"cx": K[0, 2], "cy": K[1, 2]}
    if (lens := cameras.lenses[i]) is not None:
        if lens.model not in KEPT:
            raise InputError(
                f"view {cameras.views[i]!r}: a lens {lens.model} cannot be written to "
                f"transforms.json, which knows {', '.join(KEPT)}; write the cameras of the scene, "
                "whose images are undistorted"
            )
        if lens.model == "OPENCV_FISHEYE":
            frame["camera_model"] = lens.model
        frame |= dict(zip(CURVED[lens.model], lens.parameters, strict=True))
    return frame | {"file_path": image, "transform_matrix": pose.tolist()}
