"""Visual hulls by reverse3d of the cases that ``stress.py`` names, one a line.

It runs in an environment of its own (``pip install reverse3d``). reverse3d takes cameras as a model
of COLMAP in text, and segments the photographs by itself, by GrabCut in a box, then by a network.
Here the masks are its photographs, and stand for what either would find.
"""

import json
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import trimesh
from reverse3d.reconstruction import silhouette
from scipy.spatial.transform import Rotation
from stress_lines import answer_lines

MOST = 176  # samples along each side of its cube: its default, for photographs of 640 pixels
FINE = 1.75  # of them for a pixel of smaller images, where they lie a pixel apart at the object


def write_colmap(cameras: list[dict], folder: Path) -> None:
    """A model of COLMAP in text, of pinhole cameras and without points."""
    lenses, images = [], []
    for i, camera in enumerate(cameras, 1):
        K, R, t = (np.array(camera[key]) for key in ("K", "R", "t"))
        x, y, z, w = Rotation.from_matrix(R).as_quat()
        size = camera["width"], camera["height"]
        lenses.append([i, "PINHOLE", *size, K[0, 0], K[1, 1], K[0, 2], K[1, 2]])
        images += [[i, w, x, y, z, *t, i, f"{camera['view']}.png"], []]
    for name, rows in (("cameras", lenses), ("images", images), ("points3D", [])):
        lines = [" ".join(map(str, row)) + "\n" for row in rows]
        (folder / f"{name}.txt").write_text("".join(lines))


class Given:
    """A segmenter that knows the masks: it is asked for each photograph in turn."""

    def __init__(self, masks: list[np.ndarray]):
        self._masks = masks
        self._next = -1

    def embed(self, image: np.ndarray) -> tuple[int, tuple[int, int]]:
        """Which photograph it is, and its height and width."""
        self._next += 1
        return self._next, image.shape[:2]

    def segment(self, state: tuple, box: tuple, point: tuple) -> np.ndarray:
        """Its mask."""
        view, (height, width) = state
        mask = cv2.resize(self._masks[view], (width, height), interpolation=cv2.INTER_NEAREST)
        return np.where(mask > 0, 255, 0).astype(np.uint8)


def read_in_box(image: np.ndarray, box: tuple[int, int, int, int]) -> np.ndarray:
    """The mask that a photograph is, within a box, in place of GrabCut's."""
    left, top, width, height = box
    out = np.zeros(image.shape[:2], np.uint8)
    inside = np.s_[top : top + height, left : left + width]
    out[inside] = np.where(image[inside][..., 0] > 127, 255, 0)
    return out


def carve(folder: Path, made: Path) -> dict:
    """The hull of a case, written in the world of its cameras."""
    cameras = json.loads((folder / "cameras.json").read_text())
    size = json.loads((folder / "case.json").read_text())["size"]
    masks = [cv2.imread(str(folder / "masks" / f"{c['view']}.png"), 0) for c in cameras]
    start = time.perf_counter()
    with TemporaryDirectory() as scratch:
        write_colmap(cameras, Path(scratch))
        path = Path(scratch) / "hull.ply"
        told = silhouette.visual_hull(
            folder / "masks",
            Path(scratch),
            path,
            resolution=min(MOST, round(FINE * size)),
            segmenter=lambda: Given(masks),
        )
        mesh = trimesh.load(path, process=False)
    mesh.apply_transform(np.array(told.to_world))
    mesh.export(made)
    return {"verdict": "made", "said": told.engine, "seconds": time.perf_counter() - start}


def main() -> None:
    """Answer each line of standard input."""
    cv2.setNumThreads(1)
    silhouette._coarse_grabcut = read_in_box
    answer_lines(carve, "refused")  # it refuses by exceptions of its own


if __name__ == "__main__":
    main()
