"""A class of made-up objects in the files of the papers that use ShapeNet, by their formulas.

Nothing of silmesh takes part, so that its axes and angles can be checked by it. SoftRas's world is
left-handed: x right, y up, and for azimuth 0 the camera stands on -z. Its evaluation compares
``voxels`` with its own [x, y, z] by ``transpose(1, 0, 2)[:, :, ::-1]``.
"""

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image, ImageDraw

# Corners of the boxes of an object without any symmetry, in SoftRas's world.
BOXES = (
    ((-0.3, -0.2, -0.12), (0.3, -0.05, 0.12)),  # a bar along x, low
    ((0.15, -0.2, -0.12), (0.3, 0.3, 0.05)),  # a tower at +x
    ((-0.3, -0.2, -0.12), (-0.18, 0.1, 0.35)),  # a wing at -x, towards +z
)


def write_class(folder: Path, name: str, scales: tuple[float, ...], split: str = "test") -> None:
    """Write ``<name>_<split>_images.npz`` and ``_voxels.npz`` of objects of these sizes."""
    objects = [scale * np.array(BOXES) for scale in scales]
    images = np.stack([np.stack([render(boxes, i) for i in range(24)]) for boxes in objects])
    voxels = np.stack([fill(boxes) for boxes in objects])
    np.savez_compressed(folder / f"{name}_{split}_images.npz", images)
    np.savez_compressed(folder / f"{name}_{split}_voxels.npz", voxels)


def render(boxes: np.ndarray, view: int, size: int = 64, fine: int = 8) -> np.ndarray:
    """An image [4, size, size] uint8 of SoftRas's ``look_at`` camera of this view."""
    azimuth, elevation, distance = np.radians(-15.0 * view), np.radians(30.0), 2.732
    sin, cos = np.sin(azimuth), np.cos(azimuth)
    eye = distance * np.array(
        [np.cos(elevation) * sin, np.sin(elevation), -np.cos(elevation) * cos]
    )
    z = -eye / distance
    x = np.cross([0, 1, 0], z) / np.linalg.norm(np.cross([0, 1, 0], z))
    y = np.cross(z, x)
    alpha = Image.new("L", (size * fine,) * 2)
    pen = ImageDraw.Draw(alpha)
    for low, high in boxes:
        box = trimesh.creation.box(bounds=[low, high])
        seen = (np.asarray(box.vertices) - eye) @ np.stack([x, y, z], axis=1)
        plane = seen[:, :2] / seen[:, 2:] / np.tan(np.radians(15))
        pixels = (plane * (1, -1) + 1) / 2 * size * fine
        for face in box.faces:
            pen.polygon([tuple(pixels[i]) for i in face], fill=255)
    small = np.array(alpha.resize((size, size), Image.Resampling.BOX))
    return np.stack([small // 2, small // 3, small // 4, small])


def fill(boxes: np.ndarray) -> np.ndarray:
    """The voxels [32, 32, 32] uint8 of a file: those that a box enters."""
    full = np.zeros((32, 32, 32), np.uint8)
    for low, high in boxes:
        first, last = np.floor(31 * low + 16).astype(int), np.floor(31 * high + 16).astype(int)
        full[tuple(slice(a, b + 1) for a, b in zip(first, last, strict=True))] = 1
    return full.transpose(1, 0, 2)[:, :, ::-1]
