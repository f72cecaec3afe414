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
    LOG2_E,
    OPTIONS,
    SPENT,
    _find_bounds,
    _find_face,
    _jit,
    _make_edges,
    _multiply_window,
    _run,
    _see_corners,
    _see_lines,
    _sum_window,
)
from silmesh.softras.simd import COLUMNS, ROWS

TILE = 32  # pixels
STRIDE = TILE + COLUMNS
PADDED = (TILE + ROWS) * STRIDE  # pixels of a tile whose last blocks may reach beyond its sides


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
def _any_tile(number, columns, rows):
    """Whether any tile of these pixels, first and past-the-last, is wanted."""
    if columns[0] >= columns[1] or rows[0] >= rows[1]:
        return False
    for row in range(rows[0] // TILE, (rows[1] - 1) // TILE + 1):
        for column in range(columns[0] // TILE, (columns[1] - 1) // TILE + 1):
            if number[row, column] >= 0:
                return True
    return False


@_jit
def _enter_tile(columns, rows, column, row):
    """First pixel and extent (height, width) of the part of a range that lies in a tile."""
    x = max(columns[0], column * TILE)
    y = max(rows[0], row * TILE)
    extent = min(rows[1], (row + 1) * TILE) - y, min(columns[1], (column + 1) * TILE) - x
    return x, y, extent


@_jit
def _fill_products(points, faces, number, first, size, scale, product):
    """Fill P of the wanted tiles of one view.

    Args:
        points, faces, scale: as in ``cpu``
        number: [rows, columns] of the tiles; ``first`` is that of ``product``'s first
        size: height and width of the image
        product: float32, flat, of PADDED pixels a tile, written
    """
    product[:] = 1
    band = 0, size[0], size[1]
    for face in range(faces.shape[0]):
        (a, b, c), columns, rows = _find_face(points, faces, face, band, scale)
        if not _any_tile(number, columns, rows):
            continue
        edges, inside, _ = _make_edges(a, b, c, scale)
        for row in range(rows[0] // TILE, (rows[1] - 1) // TILE + 1):
            for column in range(columns[0] // TILE, (columns[1] - 1) // TILE + 1):
                tile = number[row, column] - first
                if number[row, column] < 0:
                    continue
                x, y, extent = _enter_tile(columns, rows, column, row)
                start = tile * PADDED + (y - row * TILE) * STRIDE + x - column * TILE
                lines = _see_lines(edges, x, y)
                bounds = _find_bounds(edges, x, y, extent[1])
                _multiply_window(product, start, STRIDE, lines, bounds, inside, extent)


@_jit
def _fill_gradients(points, faces, number, first, size, scale, weight, gradient):
    """Add the gradient with respect to the points of one view, but for a common factor.

    Args:
        points, faces, number, first, size, scale: as in ``_fill_products``
        weight: laid out as its product: T times the gradient with respect to alpha
        gradient: [verts, 2] float32, added to
    """
    band = 0, size[0], size[1]
    for face in range(faces.shape[0]):
        (a, b, c), columns, rows = _find_face(points, faces, face, band, scale)
        if not _any_tile(number, columns, rows):
            continue
        edges, inside, tie = _make_edges(a, b, c, scale)
        for row in range(rows[0] // TILE, (rows[1] - 1) // TILE + 1):
            for column in range(columns[0] // TILE, (columns[1] - 1) // TILE + 1):
                tile = number[row, column] - first
                if number[row, column] < 0:
                    continue
                x, y, extent = _enter_tile(columns, rows, column, row)
                start = tile * PADDED + (y - row * TILE) * STRIDE + x - column * TILE
                lines = _see_lines(edges, x, y)
                corners = _see_corners(a, b, c, x, y)
                bounds = _find_bounds(edges, x, y, extent[1])
                gx, gy, gax, gay, gbx, gby = _sum_window(
                    weight, start, STRIDE, lines, bounds, inside, tie, corners, extent
                )
                gradient[faces[face, 0], 0] += gax
                gradient[faces[face, 0], 1] += gay
                gradient[faces[face, 1], 0] += gbx
                gradient[faces[face, 1], 1] += gby
                gradient[faces[face, 2], 0] += gx - gax - gbx
                gradient[faces[face, 2], 1] += gy - gay - gby


def _keep_compiled(code: str) -> tuple[Callable, Callable]:
    """The two kernels that Python calls, kept on disk as those of ``cpu`` are."""

    @njit(cache=True, **OPTIONS)
    def draw(points, faces, number, first, size, scale, product, alpha):
        code  # noqa: B018
        _fill_products(points, faces, number, first, size, scale, product)
        for tile in range(alpha.shape[0]):
            for y in range(TILE):
                for x in range(TILE):
                    p = product[tile * PADDED + y * STRIDE + x]
                    finite = p < np.float32(np.inf)
                    alpha[tile, y, x] = (p - np.float32(1)) / p if finite else np.float32(1)

    @njit(cache=True, **OPTIONS)
    def draw_back(points, faces, number, first, size, scale, product, upstream, gradient):
        code  # noqa: B018
        weight = np.zeros(product.shape[0], np.float32)
        for tile in range(upstream.shape[0]):
            for y in range(TILE):
                for x in range(TILE):
                    at = tile * PADDED + y * STRIDE + x
                    if product[at] < np.float32(SPENT):
                        weight[at] = upstream[tile, y, x] / product[at]
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
        product = points.new_empty(tiles.count * PADDED)
        ctx.save_for_backward(points, faces, product)

        def draw(view, _, __):
            first, end = ends[view : view + 2]
            of_view = product.numpy()[first * PADDED : end * PADDED]
            images = of_view, alpha.numpy()[first:end]
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
            of_view = product[first * PADDED : end * PADDED], upstream[first:end]
            place = tiles.number[view], first, tiles.size, ctx.scale
            _draw_back(points[view], faces, *place, *of_view, gradient[view])

        _run(draw_back, len(points), 1, 0)
        return torch.from_numpy(gradient), None, None, None
