"""The photographs at their own size, as pinhole cameras see them; one is in memory at a time.

The fit sees working images of a few hundred pixels; colours, fine relief and their measures need
what was photographed. A photograph's pixels are those of the working image but for a scale and a
shift (``views.View``), so cameras of working images become cameras of photographs by their K alone,
also where the fit has refined them. A lens is taken away at the photograph's own size, where it
moves more pixels than in the working image.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from PIL import Image

from silmesh.geometry.camera import Cameras
from silmesh.geometry.undistortion import Bent, sample
from silmesh.views import View, read_photograph

ROWS = 256  # of a photograph whose sources are computed at a time, which bounds the memory


class Originals:
    """The photographs behind cameras of working images.

    Args:
        cameras: in pixels of the working images, without lenses, in any world
        views: of at least the same names
        lenses: of the views that had one what ``Bent.describe`` says of it, as ``scene.json`` does
        longest: pixels of the longer side; a larger photograph is scaled down to it
    Attributes:
        cameras: the same in pixels of the photographs as ``read`` gives them
    """

    def __init__(
        self,
        cameras: Cameras,
        views: Sequence[View],
        lenses: Mapping[str, Mapping[str, Any]] | None = None,
        longest: int | None = None,
    ):
        named = {view.view: view for view in views}
        self._views = [named[view] for view in cameras.views]
        self._bent = {view: Bent.parse(said) for view, said in (lenses or {}).items()}
        sizes = [_scale_down(view, longest) for view in self._views]
        self._maps = [_find_map(*pair) for pair in zip(self._views, sizes, strict=True)]
        maps = torch.tensor(np.stack(self._maps))
        self.cameras = cameras.in_pixels_of(maps, torch.tensor(sizes, dtype=torch.int64))

    def __len__(self) -> int:
        return len(self._views)

    def read(self, i: int) -> np.ndarray:
        """The photograph of the i-th camera, [height, width, 3] uint8 sRGB; black beyond its frame.

        Raises:
            InputError: it can no longer be read
        """
        view, size = self._views[i], tuple(self.cameras.sizes[i].tolist())
        image = read_photograph(view, size).convert("RGB")
        if image.size != size:
            image = image.resize(size, Image.Resampling.LANCZOS)
        pixels = np.asarray(image)
        return self._straighten(pixels, i) if view.view in self._bent else pixels

    def enlarge(self, i: int, image: np.ndarray) -> np.ndarray:
        """What a working image shows at each pixel of the i-th photograph, bilinear.

        Args:
            image: [height, width] bool, as a silhouette, or numbers; without the lens
        Returns:
            [height, width] of the same kind, numbers as float32
        """
        width, height = self.cameras.sizes[i].tolist()
        found = np.empty((height, width), np.float32)
        for rows in _bands(height):
            sources = self._to_working(_centres(rows, width), i).astype(np.float32)
            found[rows] = sample(image[..., None].astype(np.float32), sources, "bilinear")[..., 0]
        return found >= 0.5 if image.dtype == bool else found

    def _straighten(self, pixels: np.ndarray, i: int) -> np.ndarray:
        """A photograph as a camera without its lens shows it."""
        bent, straight = self._bent[self._views[i].view], np.empty_like(pixels)
        height, width = pixels.shape[:2]
        for rows in _bands(height):
            working = bent.find_sources(self._to_working(_centres(rows, width), i))
            sources = _apply(self._maps[i], working).astype(np.float32)
            sampled = sample(pixels.astype(np.float32), sources, "bicubic")
            straight[rows] = sampled.round().clip(0, 255)
        return straight

    def _to_working(self, pixels: np.ndarray, i: int) -> np.ndarray:
        return _apply(np.linalg.inv(self._maps[i]), pixels)


def _scale_down(view: View, longest: int | None) -> tuple[int, int]:
    """Width and height of a view's photograph, of which none is longer than that."""
    scale = min(1.0, (longest or np.inf) / max(view.width, view.height))
    return max(1, round(view.width * scale)), max(1, round(view.height * scale))


def _find_map(view: View, size: tuple[int, int]) -> np.ndarray:
    """[3, 3] from pixels of the working image to those of the photograph at this size."""
    scale = np.diag([size[0] / view.width, size[1] / view.height, 1.0])
    return scale @ np.linalg.inv(view.pixel_map)


def _apply(matrix: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """A scale and a shift of pixels [..., 2]."""
    return pixels * matrix[[0, 1], [0, 1]] + matrix[:2, 2]


def _bands(height: int) -> list[slice]:
    return [slice(top, min(top + ROWS, height)) for top in range(0, height, ROWS)]


def _centres(rows: slice, width: int) -> np.ndarray:
    """The centres of the pixels of some rows: [rows, width, 2], x and y."""
    y, x = np.mgrid[rows, :width]
    return np.stack([x, y], axis=-1) + 0.5
