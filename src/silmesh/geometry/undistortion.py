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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import count_on_frame, whole_frames
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
        sources: by the views that change: [height, width, 2] float32, where each pixel of the new
            image lies in the old one, in pixels; NaN where it showed nothing
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
        views = zip(self.cameras.views, old, strict=True)
        return np.stack([self._silhouette(view, silhouette) for view, silhouette in views])

    def _silhouette(self, view: str, old: np.ndarray) -> np.ndarray:
        if view not in self.sources:
            return old
        return sample(old[..., None] * 1.0, self.sources[view], "bilinear")[..., 0] >= 0.5

    def image(self, view: str, old: Image.Image) -> Image.Image:
        """A view's working image, undistorted."""
        if view not in self.sources:
            return old
        pixels = np.asarray(old, np.float64)
        sampled = sample(np.atleast_3d(pixels), self.sources[view], "bicubic")
        rounded = sampled.round().clip(0, 255).astype(np.uint8)
        return Image.fromarray(rounded.reshape(pixels.shape))

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
                left[i] = _find_frame(_find_sources(silhouette.shape, bent[view]), frames[i])
    pinholes = replace(cameras, K=torch.as_tensor(K), lenses=())
    sources = _Sources(changed, silhouettes.shape[1:])
    return Undistorted(pinholes, sources, most, left, bent)


def _box_points(silhouette: np.ndarray) -> np.ndarray:
    """Pixels [n, 2] all around a silhouette: the border of its box, and its corners."""
    rows, columns = (np.flatnonzero(silhouette.any(axis=axis)) for axis in (1, 0))
    x = np.linspace(columns[0], columns[-1] + 1, 17)
    y = np.linspace(rows[0], rows[-1] + 1, 17)
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
    """Where each pixel's centre of a new image lies in the old one, by view.

    Worked out whenever it is asked for: that of many large images is more than fits in memory.
    """

    def __init__(self, bent: Mapping[str, Bent], shape: tuple[int, int]):
        self._bent, self._shape = bent, shape

    def __getitem__(self, view: str) -> np.ndarray:
        return _find_sources(self._shape, self._bent[view])

    def __contains__(self, view: object) -> bool:
        return view in self._bent

    def __iter__(self) -> Iterator[str]:
        return iter(self._bent)

    def __len__(self) -> int:
        return len(self._bent)


def _find_sources(shape: tuple[int, int], bent: Bent) -> np.ndarray:
    """Where each pixel's centre of a new image [height, width] lies in the old one.

    Between every COARSE-th pixel of a large image, unless the lens ends within it, along lines:
    what a lens moves is so smooth that this is less than a hundredth of a pixel off.
    """
    if max(shape) > LARGEST:
        y, x = (np.linspace(0.5, side - 0.5, math.ceil(side / COARSE) + 1) for side in shape)
        coarse = bent.find_sources(np.stack(np.meshgrid(x, y), axis=-1))
        if np.isfinite(coarse).all():
            planes = torch.from_numpy(coarse).permute(2, 0, 1)[None]
            fine = torch.nn.functional.interpolate(
                planes, shape, mode="bilinear", align_corners=True
            )
            return fine[0].permute(1, 2, 0).float().contiguous().numpy()
    rows, columns = np.indices(shape)
    return bent.find_sources(np.stack([columns, rows], axis=-1) + 0.5).astype(np.float32)


def _find_frame(sources: np.ndarray, frame: np.ndarray) -> list[int]:
    """A box of new pixels of which each was within the photograph's frame in the old image.

    From the whole image on, the side that holds the largest share of others is moved inwards.
    """
    with np.errstate(invalid="ignore"):
        there = ((sources > frame[:2]) & (sources < frame[2:])).all(axis=2)
    left, top, bottom, right = 0, 0, *there.shape
    while not (box := there[top:bottom, left:right]).all():
        sides = [box[:, 0], box[0], box[:, -1], box[-1]]
        worst = int(np.argmin([side.mean() for side in sides]))
        left, top = left + (worst == 0), top + (worst == 1)
        right, bottom = right - (worst == 2), bottom - (worst == 3)
    return [left, top, right, bottom]


def sample(image: np.ndarray, sources: np.ndarray, mode: str) -> np.ndarray:
    """An image [height, width, channels] at pixels [height, width, 2]; zero beyond it."""
    size = torch.tensor(image.shape[1::-1])
    grid = torch.as_tensor(sources) / size * 2 - 1  # -1 and 1 are the borders, not the centres
    grid = grid.nan_to_num(nan=-3.0).unsqueeze(0)
    planes = torch.as_tensor(np.moveaxis(image, -1, 0)).to(grid).unsqueeze(0)
    sampled = torch.nn.functional.grid_sample(planes, grid, mode, "zeros", align_corners=False)
    return np.moveaxis(sampled[0].numpy(), 0, -1)
