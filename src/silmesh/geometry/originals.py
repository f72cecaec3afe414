"""The photographs at their own size, as pinhole cameras see them.

The fit sees working images of a few hundred pixels; colours, fine relief and their measures need
what was photographed. A photograph's pixels are those of the working image but for a scale and a
shift (``views.View``), so cameras of working images become cameras of photographs by their K alone,
also where the fit has refined them. A lens is taken away at the photograph's own size, where it
moves more pixels than in the working image, if need be only about the object. Photographs stay in
memory once they were read if there is room for all of them.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from PIL import Image

from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import find_box
from silmesh.geometry.resampling import resample
from silmesh.geometry.undistortion import Bent, follow
from silmesh.views import View, read_photograph

KEPT = 512_000_000  # bytes of all photographs that stay in memory; of more none does
AROUND = 0.05  # of the working image's side: how far about its silhouette an object is looked at


class Originals:
    """The photographs behind cameras of working images.

    Args:
        cameras: in pixels of the working images, without lenses, in any world
        views: of at least the same names
        lenses: of the views that had one what ``Bent.describe`` says of it, as ``scene.json`` does
        longest: pixels of the longer side; a larger photograph is scaled down to it
        silhouettes: [views, height, width] bool of the working images, far from which a photograph
            that had a lens is black; nowhere if not given
    Attributes:
        cameras: the same in pixels of the photographs as ``read`` gives them
    """

    def __init__(
        self,
        cameras: Cameras,
        views: Sequence[View],
        lenses: Mapping[str, Mapping[str, Any]] | None = None,
        longest: int | None = None,
        silhouettes: np.ndarray | None = None,
    ):
        named = {view.view: view for view in views}
        self._given = cameras, views, lenses
        self._silhouettes = silhouettes
        self._views = [named[view] for view in cameras.views]
        self._bent = {view: Bent.parse(said) for view, said in (lenses or {}).items()}
        sizes = [_scale_down(view, longest) for view in self._views]
        self._maps = [_find_map(*pair) for pair in zip(self._views, sizes, strict=True)]
        maps = torch.tensor(np.stack(self._maps))
        self.cameras = cameras.in_pixels_of(maps, torch.tensor(sizes, dtype=torch.int64))
        self._keeps = sum(3 * width * height for width, height in sizes) <= KEPT
        self._read: dict[int, np.ndarray] = {}

    def __len__(self) -> int:
        return len(self._views)

    def at_most(self, longest: int) -> "Originals":
        """The same, a larger photograph scaled down to so many pixels; itself if none is larger."""
        large = bool((self.cameras.sizes > longest).any())
        return Originals(*self._given, longest, self._silhouettes) if large else self

    def read(self, i: int) -> np.ndarray:
        """The photograph of the i-th camera, [height, width, 3] uint8 sRGB; black beyond its frame.

        It is not to be written to.

        Raises:
            InputError: it can no longer be read
        """
        if i in self._read:
            return self._read[i]
        photograph = self._read_file(i)
        if self._keeps:
            self._read[i] = photograph
        return photograph

    def _read_file(self, i: int) -> np.ndarray:
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
        corners = np.array([[[x, y] for x in (0.5, width - 0.5)] for y in (0.5, height - 0.5)])
        given = image if image.dtype == bool else image.astype(np.float32)
        return resample(given, self._to_working(corners, i), (height, width))

    def _straighten(self, pixels: np.ndarray, i: int) -> np.ndarray:
        """A photograph as a camera without its lens shows it."""
        bent = self._bent[self._views[i].view]

        def find(places: np.ndarray) -> np.ndarray:
            return _apply(self._maps[i], bent.find_sources(self._to_working(places, i)))

        shape = pixels.shape[:2]
        part = None if self._silhouettes is None else self._look_around(i)
        return resample(pixels, follow(find, shape), shape, cubic=True, part=part)

    def _look_around(self, i: int) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of what is looked at about the object, in the photograph."""
        silhouette = self._silhouettes[i]
        box = np.array(find_box(silhouette), float).reshape(2, 2)
        box += AROUND * max(silhouette.shape) * np.array([[-1], [1]])
        corners = _apply(self._maps[i], box).clip(0, self.cameras.sizes[i].numpy())
        return tuple(corners.round().astype(int).ravel().tolist())

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
