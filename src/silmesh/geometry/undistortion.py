"""Undistortion: silhouettes and images as pinhole cameras would show them.

Each pixel of the new image is sampled where the lens projects it in the old image. A lens that
moves no pixel around the silhouette by more than ``MATTERS`` is ignored, since resampling would
cost more sharpness than it corrects. The new camera has the old K, unless the undistorted
silhouette would leave its image; then its focal lengths are shorter.

An undistorted photograph has a curved border. It is taken to fill its image, and where its frame
cuts the silhouette to reach as far as a box does in which it showed something everywhere.
"""

import math
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from silmesh.ahead import ahead
from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import count_on_frame, find_box, whole_frames
from silmesh.geometry.lens import Lens
from silmesh.geometry.small_images import LARGEST
from silmesh.views import choose_compression

MATTERS = 0.1  # pixels of the working image: a lens that moves the silhouette less is ignored
# If a silhouette would leave its image, the focal length is shortened until it lies this many
# pixels within the image.
MARGIN = 1.0
COARSE = 8  # pixels of a large image, at every so many of which the lens is asked


@dataclass(frozen=True)
class Bent:
    """How a photograph's lens bends what a pinhole camera would show.

    Attributes:
        lens: that it was taken with
        K: [3, 3] behind the lens, in pixels of the working image as it was taken
        straight: [3, 3] of the pinhole, in pixels of the working image without the lens
    """

    lens: Lens
    K: np.ndarray
    straight: np.ndarray

    def find_sources(self, pixels: np.ndarray) -> np.ndarray:
        """Where the pinhole's pixels [..., 2] lie in the image as it was taken; NaN where nowhere.

        Both in pixels of working images.
        """
        return _to_pixels(self.lens.distort(_normalise(pixels, self.straight)), self.K)

    def describe(self) -> dict[str, Any]:
        """The same for JSON."""
        return {**asdict(self.lens), "K": self.K.tolist(), "straight": self.straight.tolist()}

    @staticmethod
    def parse(said: Mapping[str, Any]) -> "Bent":
        """What ``describe`` described."""
        lens = Lens(said["model"], tuple(said["parameters"]))
        return Bent(lens, np.array(said["K"]), np.array(said["straight"]))


@dataclass(frozen=True)
class Undistorted:
    """Pinhole cameras, and how to make their images.

    Attributes:
        cameras: without lenses
        sources: by the views that change: where pixels of the new image lie in the old one, as
            ``resample`` takes it
        displacement: in pixels of the working images, the largest that any lens causes
        frames: [views, 4] left, top, right and bottom of the photographs within the new
            images; None if that was not asked
        bent: by the views that had a lens, also one that is ignored at the size of working images
    """

    cameras: Cameras
    sources: Mapping[str, np.ndarray]
    displacement: float
    frames: np.ndarray | None = None
    bent: Mapping[str, Bent] = field(default_factory=dict)

    def silhouettes(self, old: np.ndarray) -> np.ndarray:
        """Silhouettes [views, height, width] bool in the order of the cameras, undistorted.

        Those themselves if none changes.
        """
        if not self.sources:
            return old
        pairs = zip(self.cameras.views, old, strict=True)
        changed = ahead(lambda pair: self._change(*pair), pairs, torch.get_num_threads())
        return np.stack(list(changed))

    def image(self, view: str, old: Image.Image) -> Image.Image:
        """A view's working image, undistorted."""
        if view not in self.sources:
            return old
        return Image.fromarray(self._change(view, np.asarray(old), cubic=True))

    def _change(self, view: str, old: np.ndarray, cubic: bool = False) -> np.ndarray:
        if view not in self.sources:
            return old
        return _resample(old, self.sources[view], cubic)

    def write_image(self, view: str, old: Path, new: Path) -> None:
        """Write the file of a view's working image, undistorted."""
        if view not in self.sources:
            shutil.copyfile(old, new)
            return
        with Image.open(old) as image:
            self.image(view, image).save(new, compress_level=choose_compression(image))


def undistort(
    cameras: Cameras, silhouettes: np.ndarray, frames: Sequence[Sequence[int]] | None = None
) -> Undistorted:
    """Take the lenses away from cameras.

    A view whose silhouette is empty is taken to show the object where any of the others does.

    Args:
        cameras: in pixels of the silhouettes
        silhouettes: [views, height, width] bool, not all empty
        frames: [views, 4] of the photographs within the images; the whole images if not given

    Raises:
        InputError: a silhouette lies where its lens shows no direction that a pinhole sees
    """
    K, changed, bent, most = cameras.K.numpy().copy(), {}, {}, 0.0
    anywhere, whole = silhouettes.any(axis=0), whole_frames(silhouettes)
    frames = whole if frames is None else np.asarray(frames)
    left = frames.copy()
    for i, (view, lens, silhouette) in enumerate(
        zip(cameras.views, cameras.lenses, silhouettes, strict=True)
    ):
        if lens is None:
            continue
        silhouette = silhouette if silhouette.any() else anywhere
        outline = _box_points(silhouette)
        undistorted = _undistort_pixels(outline, K[i], lens)
        if not np.isfinite(undistorted).all():
            raise InputError(
                f"view {view!r}: its lens {lens.model} {list(lens.parameters)} shows nothing where "
                "the silhouette lies; the camera may be another photograph's"
            )
        moved = float(np.linalg.norm(undistorted - outline, axis=1).max())
        most = max(most, moved)
        bent[view] = Bent(lens, K[i].copy(), K[i].copy())
        if moved > MATTERS:
            K[i] = _fit(undistorted, silhouette) @ K[i]
            bent[view] = replace(bent[view], straight=K[i].copy())
            changed[view] = bent[view]
            cut = count_on_frame(silhouettes[i], frames[i]) > 0
            left[i] = whole[i]
            if cut:
                left[i] = _find_frame(silhouette.shape, bent[view], frames[i])
    pinholes = replace(cameras, K=torch.as_tensor(K), lenses=())
    sources = _Sources(changed, silhouettes.shape[1:])
    return Undistorted(pinholes, sources, most, left, bent)


def _box_points(silhouette: np.ndarray) -> np.ndarray:
    """Pixels [n, 2] all around a silhouette: the border of its box, and its corners."""
    left, top, right, bottom = find_box(silhouette)
    x, y = np.linspace(left, right, 17), np.linspace(top, bottom, 17)
    sides = [np.stack(np.meshgrid(x, y[[0, -1]]), -1), np.stack(np.meshgrid(x[[0, -1]], y), -1)]
    return np.concatenate([side.reshape(-1, 2) for side in sides])


def _normalise(pixels: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Pixels [..., 2] to normalised coordinates."""
    homogeneous = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)
    return (homogeneous @ np.linalg.inv(K).T)[..., :2]


def _to_pixels(points: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Normalised coordinates [..., 2] to pixels."""
    return points @ K[:2, :2].T + K[:2, 2]


def _undistort_pixels(pixels: np.ndarray, K: np.ndarray, lens: Lens) -> np.ndarray:
    """Where the pinhole K sees what lies at these pixels behind the lens."""
    return _to_pixels(lens.undistort(_normalise(pixels, K)), K)


def _fit(undistorted: np.ndarray, silhouette: np.ndarray) -> np.ndarray:
    """The scaling [3, 3] about the image's middle that keeps a silhouette's box within it."""
    middle = np.array(silhouette.shape[::-1]) / 2
    reach = (np.abs(undistorted - middle) / (middle - MARGIN)).max()
    touches = silhouette[[0, -1]].any() or silhouette[:, [0, -1]].any()
    scale = 1.0 if touches else 1 / max(1.0, float(reach))
    return np.array([[scale, 0, 0], [0, scale, 0], [0, 0, 1]]) + np.outer(
        [*middle * (1 - scale), 0], [0, 0, 1]
    )


class _Sources(Mapping[str, np.ndarray]):
    """Where pixels of a new image lie in the old one, by view; worked out when it is asked for."""

    def __init__(self, bent: Mapping[str, Bent], shape: tuple[int, int]):
        self._bent, self._shape = bent, shape

    def __getitem__(self, view: str) -> np.ndarray:
        return follow(self._bent[view].find_sources, self._shape)

    def __contains__(self, view: object) -> bool:
        return view in self._bent

    def __iter__(self) -> Iterator[str]:
        return iter(self._bent)

    def __len__(self) -> int:
        return len(self._bent)


def follow(find: Callable[[np.ndarray], np.ndarray], shape: tuple[int, int]) -> np.ndarray:
    """Where a lens leads pixels of an image [height, width], as ``resample`` takes it.

    Of a large image about every COARSE-th, unless the lens ends within it: what a lens moves is so
    smooth that what lies between is less than a hundredth of a pixel off.

    Args:
        find: leads pixels [..., 2] to others, NaN for nowhere
    """
    if max(shape) > LARGEST:
        coarse = find(_spread(shape, [math.ceil(side / COARSE) + 1 for side in shape]))
        if np.isfinite(coarse).all():
            return coarse
    return find(_spread(shape, shape))


def _spread(shape: tuple[int, int], counts: Sequence[int]) -> np.ndarray:
    """Pixels' centres from the first to the last along both sides: [rows, columns, 2]."""
    y, x = (np.linspace(0.5, side - 0.5, count) for side, count in zip(shape, counts, strict=True))
    return np.stack(np.meshgrid(x, y), axis=-1)


def _find_frame(shape: tuple[int, int], bent: Bent, frame: np.ndarray) -> list[int]:
    """A box of new pixels of which each was within the photograph's frame in the old image.

    From the whole image on, the side that holds the largest share of others is moved inwards.
    """
    photographed = np.zeros(shape, bool)
    photographed[frame[1] : frame[3], frame[0] : frame[2]] = True
    there = _resample(photographed, follow(bent.find_sources, shape))
    left, top, bottom, right = 0, 0, *there.shape
    while not (box := there[top:bottom, left:right]).all():
        sides = [box[:, 0], box[0], box[:, -1], box[-1]]
        worst = int(np.argmin([side.mean() for side in sides]))
        left, top = left + (worst == 0), top + (worst == 1)
        right, bottom = right - (worst == 2), bottom - (worst == 3)
    return [left, top, right, bottom]


def _resample(old: np.ndarray, sources: np.ndarray, cubic: bool = False) -> np.ndarray:
    """An image at other places, of the same size."""
    from silmesh.geometry.resampling import resample  # numba loads in a second, for few cameras

    return resample(old, sources, old.shape[:2], cubic)
