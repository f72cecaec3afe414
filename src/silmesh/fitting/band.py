"""The band about the outlines: all of a large image that a fit has to look at.

An image is cut into tiles. A tile through which neither an outline of the given silhouette passes
nor one of the mesh shows one thing throughout, in which no small step of the mesh changes anything:
it counts in the loss as it is, once for all, and only the others are rendered. So time and memory
of a step grow with the outlines' length. The mesh's outlines are edges between a triangle that
faces the camera and one that does not; the band follows the mesh when that has moved by as much as
it was widened.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from numba import njit
from scipy import ndimage
from torch import Tensor

from silmesh.ahead import ahead
from silmesh.fitting.losses import complement
from silmesh.geometry.camera import Cameras, places
from silmesh.geometry.edges import number_edges
from silmesh.softras import soft_silhouettes
from silmesh.softras.tiles import TILE, Tiles, count_tiles, find_tiles

CELL = 8  # pixels: the grain in which outlines are looked for
MARGIN = 8.0  # pixels: the band reaches so far, and is found anew when a vertex moved that far
FARTHEST = 1e5  # pixels: of a vertex near a camera's plane nothing is to be seen
CENTRE = 1e-6  # sigma with which the centres of tiles are looked at, in images of a pixel a tile


@dataclass(frozen=True)
class BandLevel:
    """One level of the image pyramid of which only a band is looked at.

    Attributes:
        factor: by which the images are smaller than the working images
        silhouettes: [views, height, width] bool of these
        sigma: in squared half-image units
        pixel: size of a pixel at the object's distance, in world units
        known: as the silhouettes, the pixels of which each view says anything; None if of all
    """

    factor: int
    silhouettes: np.ndarray
    sigma: float
    pixel: float
    known: np.ndarray | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the images; the last pixels may go on beyond the working images."""
        height, width = self.silhouettes.shape[1:]
        return -(-height // self.factor), -(-width // self.factor)

    def scale_cameras(self, cameras: Cameras) -> Cameras:
        """Cameras of the working images, scaled to the images of this level."""
        return cameras.shrink(self.factor, self.size)

    @cached_property
    def cells(self) -> np.ndarray:
        """How many pixels are shown and how many are known in each cell of CELL x CELL pixels.

        [views, 2, rows, columns] float32 of the level's pixels, with whole tiles.
        """
        every = _sum_cells(np.ones(self.silhouettes.shape[1:], bool), self)
        cells = np.empty((len(self.silhouettes), 2, *every.shape), np.float32)
        for view, (into, seen) in enumerate(zip(cells, self.silhouettes, strict=True)):
            known = None if self.known is None else self.known[view]
            into[0] = _sum_cells(seen if known is None else seen & known, self)
            into[1] = every if known is None else _sum_cells(known, self)
        return cells

    @cached_property
    def outlines(self) -> np.ndarray:
        """The cells beside which a silhouette shows both: [views, rows, columns] bool."""
        return np.stack([_find_outline_cells(cells) for cells in self.cells])

    @cached_property
    def sums(self) -> np.ndarray:
        """The cells summed over the tiles: [views, 2, rows, columns]."""
        return np.stack([_sum_tiles(cells) for cells in self.cells])


class Hinges(NamedTuple):
    """The edges of a closed mesh with the two faces about each.

    Attributes:
        faces: [faces, 3] int64
        ends: [edges, 2] vertices
        sides: [edges, 2] faces
    """

    faces: Tensor
    ends: np.ndarray
    sides: np.ndarray

    @classmethod
    def of(cls, faces: Tensor) -> "Hinges":
        """Those of a mesh."""
        ends, of_face = number_edges(faces.cpu().numpy())
        order = np.argsort(of_face.ravel(), kind="stable")
        return cls(faces, ends, order.reshape(len(ends), 2) // 3)


class Band:
    """The tiles about the outlines of a level's silhouettes and of a mesh, and what is outside.

    Args:
        level: whose images they are of
        points: [views, verts, 2] of the mesh, in pixels of the level
        hinges: of the mesh
    """

    def __init__(self, level: BandLevel, points: Tensor, hinges: Hinges):
        self._points = points
        faces, mesh = hinges.faces, (hinges.faces.cpu().numpy(), hinges.ends, hinges.sides)
        pixels, sums, outlines = points.cpu().numpy(), level.sums, level.outlines

        def want(view: int) -> np.ndarray:
            found = outlines[view].copy()
            _mark_contour(found, pixels[view], *mesh)
            return _pool(found)

        wanted = np.stack(list(ahead(want, range(len(sums)), torch.get_num_threads())))
        self.tiles, on = find_tiles(wanted, level.size), points.device
        self._shown, self._counted = (part.to(on) for part in _cut_out(level, self.tiles))
        self._total = torch.tensor(sums[:, 0].sum(axis=(1, 2)), dtype=torch.float32).to(on)
        self._rest = self._sum_rest(sums, _see_centres(points, faces, sums.shape[2:])).to(on)
        self._parts: dict[tuple[int, ...], _Part] = {}

    def _sum_rest(self, sums: np.ndarray, covered: np.ndarray) -> Tensor:
        """What is shown and rendered, and what is rendered, beside the wanted tiles: [views, 2]."""
        outside = covered & (self.tiles.number < 0)
        return torch.tensor((sums * outside[:, None]).sum(axis=(2, 3)), dtype=torch.float32)

    def holds(self, points: Tensor, index: Sequence[int]) -> bool:
        """Whether points [views, verts, 2] of the views at ``index`` have moved by little."""
        moved = (points - self._points[places(index)]).abs()
        return not bool((moved > MARGIN).any())

    def iou_loss(
        self, alpha: Tensor, index: Sequence[int], weights: Tensor | None = None
    ) -> Tensor:
        """``losses.iou_loss`` of whole images, of which only the wanted tiles were rendered.

        Args:
            alpha: [tiles, TILE, TILE] of the views at ``index``
            weights: [views at index] how much each counts; all the same if not given
        """
        part, at = self._part(index), places(index)
        shown, counted = (cut[part.rows].to(alpha) for cut in (self._shown, self._counted))
        sums = _TileSums.apply(alpha.flatten(1), shown.flatten(1), counted.flatten(1))
        both, rendered = self._rest[at].to(alpha).index_add(0, part.view, sums).unbind(1)
        return complement(both, rendered, self._total[at].to(alpha), weights)

    def select(self, index: Sequence[int]) -> Tiles:
        """The tiles of the views at ``index``."""
        return self._part(index).tiles

    def _part(self, index: Sequence[int]) -> "_Part":
        """Of the views at ``index``, kept: batches come again and again."""
        if tuple(index) not in self._parts:
            ends = self.tiles.ends
            rows = np.concatenate([np.arange(*ends[i : i + 2]) for i in index])
            view = np.repeat(np.arange(len(index)), np.diff(ends)[list(index)])
            rows, view = (torch.from_numpy(at).to(self._rest.device) for at in (rows, view))
            self._parts[tuple(index)] = _Part(self.tiles.select(list(index)), rows, view)
        return self._parts[tuple(index)]


class _Part(NamedTuple):
    """Tiles of some views, and of each its place among those of all and its view, [tiles]."""

    tiles: Tiles
    rows: Tensor
    view: Tensor


class _TileSums(torch.autograd.Function):
    """sum(p t) and sum(p k) of each row: [rows, 2], with a gradient for p alone."""

    @staticmethod
    def forward(ctx, p, t, k):
        ctx.save_for_backward(t, k)
        return torch.stack([torch.linalg.vecdot(p, t), torch.linalg.vecdot(p, k)], dim=1)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, upstream):
        t, k = ctx.saved_tensors
        return t * upstream[:, :1] + k * upstream[:, 1:], None, None


def _sum_cells(image: np.ndarray, level: BandLevel) -> np.ndarray:
    """How many pixels of the level are set in each cell, [rows, columns] of whole tiles."""
    sums = np.zeros([TILE // CELL * n for n in count_tiles(level.size)], np.int32)
    _count_cells(image, CELL * level.factor, sums)
    return sums / level.factor**2


@njit(nogil=True, cache=True)
def _count_cells(image, side, sums):
    """Add to each cell of ``side`` pixels how many pixels of an image [height, width] are set."""
    height, width = image.shape
    for y in range(height):
        for left in range(0, width, side):
            count = 0
            for x in range(left, min(left + side, width)):
                count += image[y, x]
            sums[y // side, left // side] += count


def _find_outline_cells(cells: np.ndarray) -> np.ndarray:
    """The cells [rows, columns] bool beside which a silhouette shows both, what is in and out.

    Args:
        cells: [2, rows, columns], how many pixels are shown and how many are known
    """
    shown, known = cells
    around = np.ones((3, 3), bool)
    inside, outside = shown > 0, shown < known
    return ndimage.binary_dilation(inside, around) & ndimage.binary_dilation(outside, around)


@njit(nogil=True, cache=True, error_model="numpy")
def _mark_contour(cells, points, faces, edges, sides):
    """Mark the cells within ``MARGIN`` of edges about which a mesh turns away from the camera.

    Args:
        cells: [rows, columns] bool, marked
        points: [verts, 2] in pixels
        faces, edges, sides: as ``Hinges`` has them
    """
    rows, columns = cells.shape
    facing = np.empty(len(faces), np.bool_)
    for f in range(len(faces)):
        a, b, c = points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]]
        facing[f] = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0
    for e in range(len(edges)):
        if facing[sides[e, 0]] == facing[sides[e, 1]]:
            continue
        x, y = points[edges[e, 0]]
        along, down = points[edges[e, 1], 0] - x, points[edges[e, 1], 1] - y
        near = abs(x) < FARTHEST and abs(y) < FARTHEST
        if not (near and abs(along) < FARTHEST and abs(down) < FARTHEST):  # or NaN
            continue
        count = 1 + int(max(abs(along), abs(down)) / CELL)
        for k in range(count + 1):
            u, v = x + k / count * along, y + k / count * down
            top, bottom = int((v - MARGIN) // CELL), int((v + MARGIN) // CELL)
            left, right = int((u - MARGIN) // CELL), int((u + MARGIN) // CELL)
            for row in range(max(top, 0), min(bottom + 1, rows)):
                for column in range(max(left, 0), min(right + 1, columns)):
                    cells[row, column] = True


def _pool(cells: np.ndarray) -> np.ndarray:
    """The tiles of which a cell is marked: [rows, columns] bool."""
    side = TILE // CELL
    return cells.reshape(cells.shape[0] // side, side, -1, side).any(axis=(1, 3))


def _sum_tiles(cells: np.ndarray) -> np.ndarray:
    """Cells [2, rows, columns] summed over the tiles."""
    side = TILE // CELL
    return cells.reshape(2, cells.shape[1] // side, side, -1, side).sum(axis=(2, 4))


def _see_centres(points: Tensor, faces: Tensor, size: tuple[int, int]) -> np.ndarray:
    """Which tiles' centres a mesh covers: [views, rows, columns] bool."""
    with torch.no_grad():
        covered = [soft_silhouettes(p[None] / TILE, faces, size, CENTRE) for p in points]
    return (torch.cat(covered) > 0.5).cpu().numpy()


def _cut_out(level: BandLevel, tiles: Tiles) -> tuple[Tensor, Tensor]:
    """What is shown and what is known in the wanted tiles: twice [tiles, TILE, TILE] float16.

    Shares of whole pixels, which this type holds exactly.
    """
    shown, counted = (np.zeros((tiles.count, TILE, TILE), np.uint16) for _ in range(2))

    def count(view: int) -> None:
        seen = level.silhouettes[view]
        known = seen if level.known is None else level.known[view]
        every = level.known is None
        _count_pixels(seen, known, every, tiles.number[view], level.factor, shown, counted)

    for _ in ahead(count, range(len(tiles.number)), torch.get_num_threads()):
        pass
    return tuple(torch.from_numpy(part).half() / level.factor**2 for part in (shown, counted))


@njit(nogil=True, cache=True)
def _count_pixels(seen, known, every, number, factor, shown, counted):
    """Count in the wanted tiles of a view which of each pixel's pixels are shown and known.

    Args:
        seen, known: [height, width] bool of the working image, ``factor`` pixels to each of these
        every: whether all are known, whatever ``known`` says
        number: [rows, columns] of the tiles
        shown, counted: [tiles, TILE, TILE], added to
    """
    height, width = seen.shape
    side = TILE * factor
    for row in range(number.shape[0]):
        for column in range(number.shape[1]):
            tile = number[row, column]
            if tile < 0:
                continue
            for y in range(row * side, min((row + 1) * side, height)):
                i = y // factor - row * TILE
                for j in range(TILE):
                    left = column * side + j * factor
                    for x in range(left, min(left + factor, width)):
                        there = every or known[y, x]
                        counted[tile, i, j] += there
                        shown[tile, i, j] += there and seen[y, x]


def choose_factors(size: int, base: int) -> list[int]:
    """By which the images of the levels are smaller, from just above ``base`` pixels to their own.

    Args:
        size: of the longer side of the working images
    """
    highest = max(0, math.ceil(math.log2(size / base)) - 1)
    return [2**k for k in range(highest, -1, -1)] if size > base else []
