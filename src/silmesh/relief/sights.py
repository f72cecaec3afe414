"""Grey photographs, cropped to the object and of one scale: what depths are found in.

Where the object fills half of the frame a photograph is twice as sharp on it as its size says. So
each is cropped to its silhouette, and all are scaled by one number, by which the object of most of
them is as large as is wanted.
"""

from dataclasses import dataclass

import numpy as np
import torch
from PIL import Image

from silmesh.ahead import ahead
from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import find_box
from silmesh.geometry.originals import Originals

MARGIN = 4  # pixels of the working image about a silhouette


@dataclass(frozen=True)
class Sights:
    """What the views see, padded to one size.

    Attributes:
        images: [views, height, width] float32, grey, 0 to 255
        masks: [views, height, width] bool, the object
        K: [views, 3, 3] float64, in pixels of these images
        R: [views, 3, 3]
        t: [views, 3]
        scale: pixels of these images a pixel of the photographs
    """

    images: np.ndarray
    masks: np.ndarray
    K: np.ndarray
    R: np.ndarray
    t: np.ndarray
    scale: float

    @property
    def centres(self) -> np.ndarray:
        """Where the cameras stand: [views, 3]."""
        return -np.einsum("vji,vj->vi", self.R, self.t)

    def halved(self) -> "Sights":
        """The same at half the size."""
        height, width = (2 * (n // 2) for n in self.images.shape[1:])
        images = self.images[:, :height, :width]
        blocks = images.reshape(len(images), height // 2, 2, width // 2, 2)
        masks = self.masks[:, :height, :width].reshape(blocks.shape)
        K = np.diag([0.5, 0.5, 1.0]) @ self.K
        images, masks = blocks.mean(axis=(2, 4)), masks.all(axis=(2, 4))
        return Sights(images, masks, K, self.R, self.t, self.scale / 2)


def look(
    originals: Originals,
    silhouettes: np.ndarray,
    cameras: Cameras,
    views: list[int],
    longest: int,
    scale: float | None = None,
) -> Sights:
    """Read the photographs of some views, whose objects are mostly no longer than ``longest``.

    Args:
        originals: of the same cameras
        silhouettes: [all views, height, width] bool, of the working images
        cameras: of the working images
        views: positions of those that are read
        longest: pixels
        scale: of the images, where it is known
    """
    boxes = [_box(silhouettes[i], originals, cameras, i) for i in views]
    sides = [max(right - left, bottom - top) for left, top, right, bottom in boxes]
    scale = scale or min(1.0, longest / float(np.percentile(sides, 75)))
    sizes = [
        (round(scale * (right - left)), round(scale * (bottom - top)))
        for left, top, right, bottom in boxes
    ]
    width, height = np.max(sizes, axis=0)
    images = np.zeros((len(views), height, width), np.float32)
    masks = np.zeros(images.shape, bool)
    K = originals.cameras.K[views].numpy().copy()
    photographs = ahead(originals.read, views, torch.get_num_threads())
    given = zip(views, boxes, sizes, photographs, strict=True)
    for at, (i, box, (w, h), photograph) in enumerate(given):
        grey = Image.fromarray(photograph).convert("L").convert("F")
        images[at, :h, :w] = grey.resize((w, h), Image.Resampling.BOX, box=box)
        across, down = w / (box[2] - box[0]), h / (box[3] - box[1])
        K[at] = (
            np.array([[across, 0, -across * box[0]], [0, down, -down * box[1]], [0, 0, 1]]) @ K[at]
        )
        masks[at, :h, :w] = _cut_out(
            silhouettes[i], cameras.K[i].numpy() @ np.linalg.inv(K[at]), w, h
        )
    R, t = (part[views].numpy() for part in (cameras.R, cameras.t))
    return Sights(images, masks, K, R, t, scale)


def _box(silhouette: np.ndarray, originals: Originals, cameras: Cameras, i: int):
    """Left, top, right and bottom of a silhouette in pixels of its photograph, whole numbers."""
    width, height = originals.cameras.sizes[i].tolist()
    left, top, right, bottom = find_box(silhouette)
    if right == left:
        return 0, 0, min(width, 2), min(height, 2)
    corners = np.array([[left - MARGIN, top - MARGIN, 1.0], [right + MARGIN, bottom + MARGIN, 1.0]])
    to_photograph = originals.cameras.K[i].numpy() @ np.linalg.inv(cameras.K[i].numpy())
    (left, top), (right, bottom) = (corners @ to_photograph.T)[:, :2]
    left, top = max(0, int(left)), max(0, int(top))
    return left, top, max(left + 2, min(width, int(right))), max(top + 2, min(height, int(bottom)))


def _cut_out(silhouette: np.ndarray, to_working: np.ndarray, width: int, height: int) -> np.ndarray:
    """The silhouette where a cropped image shows it, [height, width] bool."""
    column = ((np.arange(width) + 0.5) * to_working[0, 0] + to_working[0, 2]).astype(int)
    row = ((np.arange(height) + 0.5) * to_working[1, 1] + to_working[1, 2]).astype(int)
    inside = np.ix_(row.clip(0, len(silhouette) - 1), column.clip(0, silhouette.shape[1] - 1))
    return silhouette[inside]
