"""Soft silhouettes in some tiles of the images: where nothing is drawn nothing is paid for.

An image is cut into tiles of TILE x TILE pixels, the last ones going on beyond its right and lower
sides. A face that may reach no wanted tile is passed over before it is set up, and each wanted tile
keeps its own pixels, so that time and memory grow with the number of wanted tiles and not with the
images. The plain twin is ``gather_tiles`` of a whole rendering; equations and kernels are those of
``silmesh.softras.cpu``.
"""

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from numba import njit
from torch import Tensor

from silmesh.softras import cpu, find_kernel, reference, simd, soft_silhouettes
from silmesh.softras.cpu import (
    CHUNK,
    LOG2_E,
    OPTIONS,
    WINDOW,
    _add_gradient,
    _fill_alpha,
    _fill_weight,
    _jit,
    _make_chunk,
    _multiply_window,
    _read_box,
    _run,
    _see,
    _set_up,
    _sum_window,
)
from silmesh.softras.simd import COLUMNS, LANES, ROWS

TILE = 32  # pixels
PIXELS = TILE**2
STRIDE = TILE // COLUMNS  # blocks in a row of a tile


@dataclass(frozen=True)
class Tiles:
    """Which tiles of some images of one size are wanted.

    Attributes:
        number: [views, rows, columns] int32, the number of each tile that is wanted, -1 of others;
            those of a view follow one another by rows, those of views likewise
        size: height and width of the images in pixels
    """

    number: np.ndarray
    size: tuple[int, int]
    _on: dict[torch.device, Tensor] = field(default_factory=dict, compare=False, repr=False)

    @property
    def ends(self) -> np.ndarray:
        """[views + 1], where each view's tiles begin and the last one's end."""
        return np.concatenate([[0], (self.number >= 0).sum(axis=(1, 2)).cumsum()])

    @property
    def count(self) -> int:
        """How many are wanted."""
        return int((self.number >= 0).sum())

    def number_on(self, device: torch.device) -> Tensor:
        """``number`` in the memory of a device, where it was brought once."""
        if device not in self._on:
            self._on[device] = torch.from_numpy(self.number).to(device)
        return self._on[device]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of what is rendered: [tiles, TILE, TILE]."""
        return self.count, TILE, TILE

    def select(self, views: list[int]) -> "Tiles":
        """The tiles of these views, numbered anew."""
        return find_tiles(self.number[views] >= 0, self.size)


def find_tiles(wanted: np.ndarray, size: tuple[int, int]) -> Tiles:
    """The tiles [views, rows, columns] bool that are wanted, numbered."""
    number = np.full(wanted.shape, -1, np.int32)
    number[wanted] = np.arange(wanted.sum())
    return Tiles(number, size)


def count_tiles(size: tuple[int, int]) -> tuple[int, int]:
    """Rows and columns of the tiles of an image of this height and width."""
    return -(-size[0] // TILE), -(-size[1] // TILE)


def soft_tiles(points: Tensor, faces: Tensor, tiles: Tiles, sigma: float) -> Tensor:
    """Render soft silhouettes in the tiles that are wanted.

    Args:
        points, faces, sigma: as ``silmesh.softras.soft_silhouettes`` takes them
        tiles: of as many views
    Returns:
        alpha [tiles, TILE, TILE], differentiable once with respect to ``points``
    """
    kernel = find_kernel(points)
    if kernel is cpu:
        return _SoftTiles.apply(points, faces, tiles, float(sigma))
    if kernel is not reference:
        return kernel.soft_tiles(points, faces, tiles, float(sigma))
    return gather_tiles(soft_silhouettes(points, faces, tiles.size, sigma), tiles)


def gather_tiles(images: Tensor, tiles: Tiles) -> Tensor:
    """The wanted tiles of images [views, height, width], 0 beyond them: [tiles, TILE, TILE]."""
    views, rows, columns = tiles.number.shape
    beyond = columns * TILE - images.shape[2], rows * TILE - images.shape[1]
    padded = torch.nn.functional.pad(images, (0, beyond[0], 0, beyond[1]))
    cut = padded.reshape(views, rows, TILE, columns, TILE).transpose(2, 3)
    wanted = torch.from_numpy(tiles.number >= 0).to(images.device)
    return cut[wanted]


@_jit
def _find_origin(columns, rows):
    """First pixel of the block in which a range of pixels begins."""
    return columns[0] - columns[0] % COLUMNS, rows[0] - rows[0] % ROWS


@_jit
def _find_tiles(columns, rows):
    """First and past-the-last column and row of the tiles that hold these pixels."""
    return (
        (columns[0] // TILE, (columns[1] - 1) // TILE + 1),
        (rows[0] // TILE, (rows[1] - 1) // TILE + 1),
    )


@_jit
def _enter_tile(chunk, f, column, row, scale):
    """A face's window in a tile, and where in the tile the face is seen from, in blocks.

    A large face is seen anew from where it enters the tile.

    Returns:
        window: as ``cpu._multiply_window`` takes it
        at: number of a block that begins at the tile's first, often a negative one
    """
    columns, rows = _read_box(chunk, f)
    x, y = _find_origin(columns, rows)
    left, right = max(x, column * TILE), min(columns[1], (column + 1) * TILE)
    top, bottom = max(y, row * TILE), min(rows[1], (row + 1) * TILE)
    if max(columns[1] - x, rows[1] - y) > WINDOW:
        x, y = left, top
        _see(chunk, f, x, y, scale)
    window = (
        ((left - x) // COLUMNS, (right - x + COLUMNS - 1) // COLUMNS),
        ((top - y) // ROWS, (bottom - y + ROWS - 1) // ROWS),
    )
    return window, (y - row * TILE) // ROWS * STRIDE + (x - column * TILE) // COLUMNS


@_jit
def _fill_products(points, faces, number, first, size, scale, product):
    """Fill P of the wanted tiles of one view.

    Args:
        points, faces, scale: as in ``cpu``
        number: [rows, columns] of the tiles; ``first`` is that of ``product``'s first
        size: height and width of the image
        product: float32, of PIXELS a tile, block after block, written
    """
    product[:] = 1
    band, wanted, chunk = (0, size[0], size[1]), number >= 0, _make_chunk()
    for begin in range(0, faces.shape[0], CHUNK):
        count = _set_up(points, faces, begin, band, scale, wanted, (TILE, TILE), chunk)
        for f in range(count):
            columns, rows = _find_tiles(*_read_box(chunk, f))
            for row in range(rows[0], rows[1]):
                for column in range(columns[0], columns[1]):
                    if wanted[row, column]:
                        window, at = _enter_tile(chunk, f, column, row, scale)
                        start = (number[row, column] - first) * PIXELS + at * LANES
                        _multiply_window(product, start, STRIDE, chunk, f, window)


@_jit
def _fill_gradients(points, faces, number, first, size, scale, weight, gradient):
    """Add the gradient with respect to the points of one view, but for a common factor.

    Args:
        points, faces, number, first, size, scale: as in ``_fill_products``
        weight: laid out as its product: T times the gradient with respect to alpha
        gradient: [verts, 2] float32, added to
    """
    band, wanted, chunk = (0, size[0], size[1]), number >= 0, _make_chunk()
    for begin in range(0, faces.shape[0], CHUNK):
        count = _set_up(points, faces, begin, band, scale, wanted, (TILE, TILE), chunk)
        for f in range(count):
            columns, rows = _find_tiles(*_read_box(chunk, f))
            for row in range(rows[0], rows[1]):
                for column in range(columns[0], columns[1]):
                    if wanted[row, column]:
                        window, at = _enter_tile(chunk, f, column, row, scale)
                        start = (number[row, column] - first) * PIXELS + at * LANES
                        sums = _sum_window(weight, start, STRIDE, chunk, f, window)
                        _add_gradient(gradient, faces, chunk.faces[f], sums)


def _keep_compiled(code: str) -> tuple[Callable, Callable]:
    """The two kernels that Python calls, kept on disk as those of ``cpu`` are."""

    @njit(cache=True, **OPTIONS)
    def draw(points, faces, number, first, size, scale, product, alpha):
        code  # noqa: B018
        _fill_products(points, faces, number, first, size, scale, product)
        _fill_alpha(product, STRIDE, alpha.shape[0] // TILE, TILE, alpha)

    @njit(cache=True, **OPTIONS)
    def draw_back(points, faces, number, first, size, scale, product, upstream, gradient):
        code  # noqa: B018
        weight = np.empty(product.shape[0], np.float32)
        _fill_weight(product, STRIDE, upstream, upstream.shape[0] // TILE, TILE, weight)
        gradient[:] = 0
        _fill_gradients(points, faces, number, first, size, scale, weight, gradient)
        gradient *= np.float32(-2 * scale * scale / LOG2_E)

    return draw, draw_back


_FILES = b"".join(Path(module.__file__).read_bytes() for module in (cpu, simd, reference))
_draw, _draw_back = _keep_compiled(hashlib.sha256(_FILES).hexdigest())


class _SoftTiles(torch.autograd.Function):
    @staticmethod
    def forward(ctx, points, faces, tiles, sigma):
        points, faces = points.detach().contiguous(), faces.contiguous()
        ctx.tiles, ctx.scale = tiles, math.sqrt(LOG2_E / sigma) / (max(tiles.size) / 2)
        ends = tiles.ends
        alpha = points.new_empty(tiles.count, TILE, TILE)
        product = points.new_empty(tiles.count * PIXELS)
        ctx.save_for_backward(points, faces, product)

        def draw(view, _, __):
            first, end = ends[view : view + 2]
            of_view = product.numpy()[first * PIXELS : end * PIXELS]
            images = of_view, alpha.numpy()[first:end].reshape(-1)
            place = tiles.number[view], first, tiles.size, ctx.scale
            _draw(points.numpy()[view], faces.numpy(), *place, *images)

        _run(draw, len(points), 1, 0)
        return alpha

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, upstream):
        points, faces, product = (t.numpy() for t in ctx.saved_tensors)
        upstream, tiles = upstream.contiguous().numpy(), ctx.tiles
        ends, gradient = tiles.ends, np.empty(points.shape, np.float32)

        def draw_back(view, _, __):
            first, end = ends[view : view + 2]
            of_view = product[first * PIXELS : end * PIXELS], upstream[first:end].reshape(-1)
            place = tiles.number[view], first, tiles.size, ctx.scale
            _draw_back(points[view], faces, *place, *of_view, gradient[view])

        _run(draw_back, len(points), 1, 0)
        return torch.from_numpy(gradient), None, None, None
