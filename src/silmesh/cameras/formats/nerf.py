"""NeRF's ``transforms.json``: poses from camera to world with OpenGL's axes, a pinhole or a lens.

    {"camera_angle_x": 0.69, "frames": [{"file_path": "./train/r_0", "transform_matrix": [...]}]}

OpenGL's camera has x right, y up and looks along -z, so R = diag(1, -1, -1) of the pose's inverse.
The intrinsics fl_x, fl_y, cx, cy, w, h, k1, k2, p1, p2 and camera_model stand at the top or in a
frame (instant-ngp, nerfstudio); without them camera_angle_x is the angle across the photograph.
Pixel centres lie at integer + 0.5, as instant-ngp and nerfstudio have them.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np

from silmesh.cameras.camera import Cameras, refuse_many
from silmesh.cameras.formats.parts import (
    UNSAID,
    Camera,
    gather,
    intrinsics,
    nearest_rotation,
    numbers,
    pixels,
    read_json,
    refuse_skew,
)
from silmesh.cameras.lens import CURVED, PLAIN, Lens, lens_of
from silmesh.errors import InputError, blaming, cut
from silmesh.files import replacing
from silmesh.views import View

FLIP = np.diag([1.0, -1.0, -1.0])  # between OpenGL's camera axes and ours
NEEDED = ("file_path", "transform_matrix")  # of each frame
NARROWEST = 1e-6  # radians across a photograph
LENS = ("k1", "k2", "k3", "k4", "p1", "p2")
KEPT = (*PLAIN, "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE")  # that are written


def is_transforms(content: Any) -> bool:
    """Whether this is what a ``transforms.json`` holds."""
    return isinstance(content, dict) and "frames" in content


def read(path: Path, views: Sequence[View]) -> Cameras:
    """Cameras by the names of their images; the views say the size that an angle is across."""
    content = read_json(path)
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames or not all(isinstance(f, dict) for f in frames):
        raise InputError(f"{path}: should hold a list 'frames' of {{file_path, transform_matrix}}")
    refuse_many(path, len(frames))
    shared = {key: value for key, value in content.items() if key != "frames"}
    return gather([_parse(shared | f, f"{path}: frame {i}", views) for i, f in enumerate(frames)])


def _parse(frame: Mapping[str, Any], where: str, views: Sequence[View]) -> Camera:
    for key in NEEDED:
        if key not in frame:
            raise InputError(f"{where}: {key!r} is missing")
    name = str(frame["file_path"])
    where = f"{where} ({cut(name, 80)})"
    pose = frame["transform_matrix"]
    pose = pose[:3] if isinstance(pose, list) else pose
    pose = numbers(pose, (3, 4), f"{where}: transform_matrix")
    R = FLIP @ nearest_rotation(pose[:, :3], where).T
    given = frame.get("w"), frame.get("h")
    size = UNSAID if None in given else pixels(*given, where)
    own = next((v for v in views if v.view == PureWindowsPath(name).stem), views[0])
    K = _parse_intrinsics(frame, size if all(size) else (own.width, own.height), where)
    with blaming(where):
        lens = _parse_lens(frame, where)
    return Camera(name, size if all(size) else UNSAID, K, R, -R @ pose[:, 3], lens)


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
    """Its model as ``camera_model`` names it; OPENCV where only its parameters are there."""
    value = {key: _number(frame, key, where, 0) for key in LENS}
    model = str(frame.get("camera_model", "OPENCV"))
    if frame.get("is_fisheye"):
        model = "OPENCV_FISHEYE"
    if model in (*PLAIN, "PERSPECTIVE") or (model not in CURVED and not any(value.values())):
        return None
    if model == "OPENCV" and value["k3"] and not value["k4"]:
        model, value = "FULL_OPENCV", value | {"k4": 0.0, "k5": 0.0, "k6": 0.0}
    elif model == "OPENCV" and value["k4"]:
        raise InputError("k4 of a lens that is no fisheye cannot be read; undistort the images")
    return lens_of(model, [value.get(name, 0.0) for name in CURVED.get(model, ())])


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
    pose[:3, :3] = cameras.R[i].numpy().T @ FLIP
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
