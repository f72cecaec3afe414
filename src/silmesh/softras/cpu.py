"""Soft silhouettes on the CPU: numba kernels, one pass over the triangles of each view.

The equations are those of ``silmesh.softras.reference``. What is particular here:

- All lengths are scaled so that D = 2^z / (1 + 2^z), z = +-d^2.
- 1 / (1 - D) = 1 + 2^z, so a view keeps the product P = 1 / T of these in one image, and no list
  of the faces of a pixel or of the pixels of a face: memory grows with views x pixels alone.
- P is kept block after block, a block of pixels being what one register holds (``simd``).
- CHUNK faces are set up together, in loops without branches, which LLVM turns into SIMD.
- A face is drawn in windows of at most 64 x 64 pixels. Their origins are set in float64, so within
  a window distances in float32 are right to about 1e-6 pixel however large the face. (The foot of
  the gradient's p - c is placed along its edge to 1e-7 of the edge's length, which shows only where
  sqrt(sigma) is a thousandth of that length.)
- In each row of blocks only those are visited that the cutoff of all three edges' half-planes
  reaches, without branches.
- A pixel whose P has reached SPENT is opaque to within 1 / SPENT and passes no gradient. A face
  that reaches only blocks of such pixels is passed over before it is set up: as the image fills,
  and on the way back.

Views are independent of each other, and so are the bands of rows that the views of a small batch
are cut into. The faces of a band are visited in order by one thread, and the cut depends on the
batch alone: the result is bitwise the same for any number of threads.
"""

import hashlib
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise, product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numba import njit
from torch import Tensor

from silmesh.softras import reference, simd
from silmesh.softras.reference import CUTOFF, THIN, TIE
from silmesh.softras.simd import (
    COLUMNS,
    LANES,
    ROWS,
    any_nonzero,
    columns,
    exp2,
    gather,
    larger,
    load,
    minus_product,
    plus_product,
    rows,
    scatter,
    smaller,
    splat,
    store,
    totals,
    where_less,
)

WINDOW = 64  # pixels
LOG2_E = math.log2(math.e)
CUTOFF_Z = CUTOFF * LOG2_E
THIN_Z = THIN * math.sqrt(LOG2_E)
LARGEST_Z = 126  # 2^z stays finite
SPENT = 1e6  # at this P nothing can change a pixel any more
CHUNK = 64  # faces that are set up together
REFRESH = 1024  # faces between looks for blocks that are spent
MADE = 41  # numbers that ``_see`` makes of a face
TASKS = 2  # a batch of fewer views is cut into about so many bands
BAND = 32  # rows that a band has at least
FAR = 1e9  # pixels: no bound
SLACK = 0.01  # pixels: spans are wider by this, so that rounding loses no pixel
NARROW = 3  # blocks: in a window no wider, whole rows are visited
LEVEL = 0.02  # an edge that rises less than this bounds no span

OPTIONS = {"nogil": True, "fastmath": {"contract"}, "error_model": "numpy"}
_jit = njit(forceinline=True, **OPTIONS)


class Edge(NamedTuple):
    """An edge from a to b and its own frame: u along it, v across it, positive inside.

    a is in pixels; u, v and the length are scaled. From one pixel to the next, u and v change by
    (ux, uy) and (vx, vy). All are float64.
    """

    ax: float
    ay: float
    ux: float
    uy: float
    vx: float
    vy: float
    length: float


class Line(NamedTuple):
    """An edge as seen from a window's first pixel, in float32.

    There, ``before`` = -u and ``after`` = u - length (positive past the ends) and ``across`` = v.
    ``before`` times ``share`` is the share of the way from a to b.
    """

    before: float
    after: float
    across: float
    ux: float
    uy: float
    vx: float
    vy: float
    share: float


class Bound(NamedTuple):
    """Where an edge's inner half-plane and its cutoff lie in the ROWS rows from j on of a window.

    From the column ``left + slope j``, or up to ``right + slope j``, in float32.
    """

    left: float
    right: float
    slope: float


class Row(NamedTuple):
    """What a ``Line`` becomes in one row of a window's blocks, each number in all simd."""

    before: object
    after: object
    across: object
    ux: object
    vx: object


class Chunk(NamedTuple):
    """What is known of up to CHUNK faces: of each, numbers that lie CHUNK apart.

    Attributes:
        faces: int64, which they are
        corners: float64, ax, ay, bx, by, cx and cy
        boxes: int64, first and past-the-last column and row of the pixels that each may reach
        made: float32, what ``_see`` made of each
    """

    faces: np.ndarray
    corners: np.ndarray
    boxes: np.ndarray
    made: np.ndarray


@_jit
def _make_chunk():
    return Chunk(
        np.empty(CHUNK, np.int64),
        np.empty(6 * CHUNK, np.float64),
        np.empty(4 * CHUNK, np.int64),
        np.empty(MADE * CHUNK, np.float32),
    )


@_jit
def _make_edge(ax, ay, bx, by, sign, scale):
    """An edge of no length is a point: there any frame measures the distance rightly."""
    x = bx - ax
    y = by - ay
    length = math.sqrt(x * x + y * y)
    per_pixel = scale / length if length > 0 else 0.0
    x = x * per_pixel if length > 0 else scale
    y = y * per_pixel
    return Edge(ax, ay, x, y, -y * sign, x * sign, length * scale)


@_jit
def _make_edges(a, b, c, scale):
    """The edges of a triangle, the v above which a pixel is inside, and what breaks ties.

    A thin triangle has no inside, and of its edges the first is preferred (see ``reference``).
    """
    area2 = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    sign = -1.0 if area2 < 0 else 1.0
    ab = _make_edge(a[0], a[1], b[0], b[1], sign, scale)
    bc = _make_edge(b[0], b[1], c[0], c[1], sign, scale)
    ca = _make_edge(c[0], c[1], a[0], a[1], sign, scale)
    longest = max(ab.length, bc.length, ca.length)
    thick = abs(area2) * scale * scale > THIN_Z * longest
    inside = np.float32(0.0) if thick else np.float32(np.inf)
    tie = np.float32(1.0) if thick else np.float32(TIE)
    return (ab, bc, ca), inside, tie


@_jit
def _find_pixels(a, b, c, radius, size):
    """First and past-the-last pixel from min - radius to max + radius, clipped to the image.

    The centre of pixel i is at i + 1/2. A number that is not finite gives an empty range.
    """
    finite = math.isfinite(a + b + c)
    low = min(max(min(a, b, c) - radius - 0.5, 0.0), np.float64(size))
    high = min(max(max(a, b, c) + radius - 0.5, -1.0), size - 1.0)
    first = np.int64(math.ceil(low if finite else 0.0))
    return first, np.int64(math.floor(high if finite else -1.0)) + 1


@_jit
def _find_boxes(points, faces, first, count, band, scale, chunk):
    """Enter the corners and boxes of ``count`` faces from ``first`` on."""
    top, height, width = band
    radius = math.sqrt(CUTOFF_Z) / scale
    corners, boxes = chunk.corners, chunk.boxes
    for f in range(count):
        for k in range(3):
            vert = faces[first + f, k]
            corners[2 * k * CHUNK + f] = points[vert, 0]
            corners[(2 * k + 1) * CHUNK + f] = np.float64(points[vert, 1]) - top
    for f in range(count):
        (ax, ay), (bx, by), (cx, cy) = _read_corners(chunk, f)
        boxes[f], boxes[CHUNK + f] = _find_pixels(ax, bx, cx, radius, width)
        boxes[2 * CHUNK + f], boxes[3 * CHUNK + f] = _find_pixels(ay, by, cy, radius, height)


@_jit
def _read_corners(chunk, f):
    """Corners a, b and c of a chunk's face."""
    corners = chunk.corners
    return (
        (corners[f], corners[CHUNK + f]),
        (corners[2 * CHUNK + f], corners[3 * CHUNK + f]),
        (corners[4 * CHUNK + f], corners[5 * CHUNK + f]),
    )


@_jit
def _read_box(chunk, f):
    """First and past-the-last column, and row, of the pixels that a chunk's face may reach."""
    boxes = chunk.boxes
    return (boxes[f], boxes[CHUNK + f]), (boxes[2 * CHUNK + f], boxes[3 * CHUNK + f])


@_jit
def _count_blocks(height, width):
    """Rows and columns of the blocks of an image, of which the last may go on beyond its sides.

    Their columns are of an odd number: with a power of two, blocks below each other would compete
    for the same lines of the cache.
    """
    return (height + ROWS - 1) // ROWS, (width + COLUMNS - 1) // COLUMNS | 1


@_jit
def _refresh(live, product):
    """Look which blocks hold a pixel that is not spent."""
    one = splat(np.float32(1))
    zero = splat(np.float32(0))
    for row in range(live.shape[0]):
        for column in range(live.shape[1]):
            p = load(product, (row * live.shape[1] + column) * LANES)
            live[row, column] = any_nonzero(where_less(p, splat(np.float32(SPENT)), one, zero))


@_jit
def _reaches(live, side, columns, rows):
    """Whether a live part of an image holds any of the pixels of these columns and rows.

    Args:
        live: [rows, columns] bool, which parts of height and width ``side`` are live
        columns, rows: first and past-the-last
    """
    if columns[0] >= columns[1] or rows[0] >= rows[1]:
        return False
    for row in range(rows[0] // side[0], (rows[1] - 1) // side[0] + 1):
        for column in range(columns[0] // side[1], (columns[1] - 1) // side[1] + 1):
            if live[row, column]:
                return True
    return False


@_jit
def _keep(chunk, f, kept):
    """Move what is known of a face of a chunk to the place of an earlier one."""
    for k in range(6):
        chunk.corners[k * CHUNK + kept] = chunk.corners[k * CHUNK + f]
    for k in range(4):
        chunk.boxes[k * CHUNK + kept] = chunk.boxes[k * CHUNK + f]


@_jit
def _set_up(points, faces, first, band, scale, live, side, chunk):
    """Enter what of CHUNK faces from ``first`` on reaches a live part; return how many do."""
    count = min(CHUNK, faces.shape[0] - first)
    _find_boxes(points, faces, first, count, band, scale, chunk)
    kept = 0
    for f in range(count):
        columns, rows = _read_box(chunk, f)
        if _reaches(live, side, columns, rows):
            if kept < f:
                _keep(chunk, f, kept)
            chunk.faces[kept] = first + f
            kept += 1
    for f in range(kept):
        (x, _), (y, _) = _read_box(chunk, f)
        _see(chunk, f, x - x % COLUMNS, y - y % ROWS, scale)
    return kept


@_jit
def _see_line(edge, x, y):
    """An edge from the point (x, y)."""
    u = edge.ux * (x - edge.ax) + edge.uy * (y - edge.ay)
    v = edge.vx * (x - edge.ax) + edge.vy * (y - edge.ay)
    share = 1.0 / edge.length if edge.length > 0 else 0.0
    return Line(
        np.float32(-u),
        np.float32(u - edge.length),
        np.float32(v),
        np.float32(edge.ux),
        np.float32(edge.uy),
        np.float32(edge.vx),
        np.float32(edge.vy),
        np.float32(-share),
    )


@_jit
def _find_bound(edge, x, y):
    """An edge's bound from the point (x, y); no branch, which would be a guess."""
    reach = -math.sqrt(CUTOFF_Z) - edge.vx * (x - edge.ax) - edge.vy * (y - edge.ay)
    level = LEVEL * abs(edge.vy)
    per_row = 1 / edge.vx
    slope = -edge.vy * per_row
    left = max(min(reach * per_row + (ROWS - 1) * min(slope, 0.0) - SLACK, FAR), -FAR)
    right = max(min(reach * per_row + (ROWS - 1) * max(slope, 0.0) + SLACK, FAR), -FAR)
    left = left if edge.vx > level else -FAR
    right = right if -edge.vx > level else FAR
    slope = slope if abs(edge.vx) > level else 0.0
    return Bound(np.float32(left), np.float32(right), np.float32(slope))


@_jit
def _see(chunk, f, x, y, scale):
    """Make a face's lines, bounds and corners as seen from the centre of pixel (x, y)."""
    made = chunk.made
    a, b, c = _read_corners(chunk, f)
    (ab, bc, ca), inside, tie = _make_edges(a, b, c, scale)
    centre = x + 0.5, y + 0.5
    _write_edge(made, 0, f, ab, centre)
    _write_edge(made, 1, f, bc, centre)
    _write_edge(made, 2, f, ca, centre)
    made[33 * CHUNK + f] = inside
    made[34 * CHUNK + f] = tie
    made[35 * CHUNK + f] = a[0] - c[0]
    made[36 * CHUNK + f] = a[1] - c[1]
    made[37 * CHUNK + f] = b[0] - c[0]
    made[38 * CHUNK + f] = b[1] - c[1]
    made[39 * CHUNK + f] = c[0] - centre[0]
    made[40 * CHUNK + f] = c[1] - centre[1]


@_jit
def _write_edge(made, k, f, edge, centre):
    """Enter the line and the bound of a face's edge as seen from a pixel's centre."""
    line, at = _see_line(edge, centre[0], centre[1]), 8 * k * CHUNK + f
    made[at] = line.before
    made[at + CHUNK] = line.after
    made[at + 2 * CHUNK] = line.across
    made[at + 3 * CHUNK] = line.ux
    made[at + 4 * CHUNK] = line.uy
    made[at + 5 * CHUNK] = line.vx
    made[at + 6 * CHUNK] = line.vy
    made[at + 7 * CHUNK] = line.share
    bound, at = _find_bound(edge, centre[0], centre[1]), (24 + 3 * k) * CHUNK + f
    made[at] = bound.left
    made[at + CHUNK] = bound.right
    made[at + 2 * CHUNK] = bound.slope


@_jit
def _read_line(made, k, f):
    at = 8 * k * CHUNK + f
    return Line(
        made[at],
        made[at + CHUNK],
        made[at + 2 * CHUNK],
        made[at + 3 * CHUNK],
        made[at + 4 * CHUNK],
        made[at + 5 * CHUNK],
        made[at + 6 * CHUNK],
        made[at + 7 * CHUNK],
    )


@_jit
def _read_bound(made, k, f):
    at = (24 + 3 * k) * CHUNK + f
    return Bound(made[at], made[at + CHUNK], made[at + 2 * CHUNK])


@_jit
def _read_lines(made, f):
    return _read_line(made, 0, f), _read_line(made, 1, f), _read_line(made, 2, f)


@_jit
def _read_bounds(made, f):
    return _read_bound(made, 0, f), _read_bound(made, 1, f), _read_bound(made, 2, f)


@_jit
def _find_span(bounds, row, columns):
    """First and past-the-last block to visit in a row of blocks, of those in ``columns``."""
    if columns[1] - columns[0] <= NARROW:
        return columns
    ab, bc, ca = bounds
    j = np.float32(ROWS * row)
    low = max(ab.left + ab.slope * j, bc.left + bc.slope * j, ca.left + ca.slope * j)
    high = min(ab.right + ab.slope * j, bc.right + bc.slope * j, ca.right + ca.slope * j)
    first = np.int64(max(low, np.float32(COLUMNS * columns[0]))) // COLUMNS
    last = np.int64(max(min(high, np.float32(COLUMNS * columns[1] - 1)), np.float32(-1)))
    return first, (last + COLUMNS) // COLUMNS


@_jit
def _enter_rows(line, j):
    """A line in the rows ``j`` of a block, at its window's first column."""
    uy = splat(line.uy)
    return Row(
        minus_product(splat(line.before), uy, j),
        plus_product(splat(line.after), uy, j),
        plus_product(splat(line.across), splat(line.vy), j),
        splat(line.ux),
        splat(line.vx),
    )


@_jit
def _measure(row, i):
    """How far pixels i lie before a, across the line, and from the edge (squared)."""
    before = minus_product(row.before, row.ux, i)
    after = plus_product(row.after, row.ux, i)
    across = plus_product(row.across, row.vx, i)
    beyond = larger(larger(before, after), splat(np.float32(0)))
    return before, across, plus_product(beyond * beyond, across, across)


@_jit
def _odds(distance2, across, inside):
    """D / (1 - D) = 2^z; zero past the cutoff. ``across`` is the smallest of the three."""
    zero = splat(np.float32(0))
    z = where_less(inside, across, distance2, zero - distance2)
    odds = exp2(smaller(z, splat(np.float32(LARGEST_Z))))
    return where_less(z, splat(np.float32(-CUTOFF_Z)), zero, odds)


@_jit
def _multiply_window(product, start, stride, chunk, f, window):
    """Multiply P by the 1 + 2^z of a face of a chunk in one window.

    Args:
        product: the image or tile begins at ``start``, its rows of blocks are ``stride`` blocks
            long
        window: first and past-the-last column, and row, of blocks from where the face is seen
    """
    ab, bc, ca = _read_lines(chunk.made, f)
    bounds = _read_bounds(chunk.made, f)
    inside = splat(chunk.made[33 * CHUNK + f])
    columns_, (top, bottom) = window
    for row in range(top, bottom):
        first, end = _find_span(bounds, row, columns_)
        j = splat(np.float32(ROWS * row)) + rows()
        row_ab = _enter_rows(ab, j)
        row_bc = _enter_rows(bc, j)
        row_ca = _enter_rows(ca, j)
        i = splat(np.float32(COLUMNS * first)) + columns()
        k = start + (row * stride + first) * LANES
        for _ in range(first, end):
            _, v_ab, d_ab = _measure(row_ab, i)
            _, v_bc, d_bc = _measure(row_bc, i)
            _, v_ca, d_ca = _measure(row_ca, i)
            nearest = smaller(smaller(d_ab, d_bc), d_ca)
            odds = _odds(nearest, smaller(smaller(v_ab, v_bc), v_ca), inside)
            p = load(product, k)
            store(product, k, plus_product(p, p, odds))
            i = i + splat(np.float32(COLUMNS))
            k += LANES


@_jit
def _find_window(columns, rows, x, y):
    """The blocks of a window from (x, y) on that hold pixels of these columns and rows."""
    right = min(columns[1] - x, WINDOW)
    bottom = min(rows[1] - y, WINDOW)
    return (
        (np.int64(0), (right + COLUMNS - 1) // COLUMNS),
        (np.int64(0), (bottom + ROWS - 1) // ROWS),
    )


@_jit
def _fill_product(points, faces, band, scale, product):
    """Fill P of one band of a view.

    Args:
        points: [verts, 2] float32
        faces: [faces, 3] int64
        band: its first row in the image, its height and its width
        scale: from pixels to lengths whose square is z
        product: float32, of ``_count_padded`` pixels, block after block, written
    """
    blocks = _count_blocks(band[1], band[2])
    live = np.ones(blocks, np.bool_)
    chunk = _make_chunk()
    product[:] = 1
    for first in range(0, faces.shape[0], CHUNK):
        if first % REFRESH == 0 and first:
            _refresh(live, product)
        count = _set_up(points, faces, first, band, scale, live, (ROWS, COLUMNS), chunk)
        for f in range(count):
            columns, rows = _read_box(chunk, f)
            left, top = columns[0] - columns[0] % COLUMNS, rows[0] - rows[0] % ROWS
            for y in range(top, rows[1], WINDOW):
                for x in range(left, columns[1], WINDOW):
                    if x > left or y > top:
                        _see(chunk, f, x, y, scale)
                    start = (y // ROWS * blocks[1] + x // COLUMNS) * LANES
                    window = _find_window(columns, rows, x, y)
                    _multiply_window(product, start, blocks[1], chunk, f, window)


@_jit
def _sum_window(weight, start, stride, chunk, f, window):
    """Sum over a window: w (p - c) times the barycentric coordinates of c, the nearest point.

    w is ``weight`` times D with the sign of z. Arguments as those of ``_multiply_window``.
    Returns the sums of all, of a's share and of b's.
    """
    made = chunk.made
    ab, bc, ca = _read_lines(made, f)
    bounds = _read_bounds(made, f)
    zero = splat(np.float32(0))
    one = splat(np.float32(1))
    inside = splat(made[33 * CHUNK + f])
    tie = splat(made[34 * CHUNK + f])
    ax = splat(made[35 * CHUNK + f])
    ay = splat(made[36 * CHUNK + f])
    bx = splat(made[37 * CHUNK + f])
    by = splat(made[38 * CHUNK + f])
    cx = splat(made[39 * CHUNK + f])
    cy = splat(made[40 * CHUNK + f])
    sum_x, sum_y, sum_ax, sum_ay, sum_bx, sum_by = zero, zero, zero, zero, zero, zero
    columns_, (top, bottom) = window
    for row in range(top, bottom):
        first, end = _find_span(bounds, row, columns_)
        j = splat(np.float32(ROWS * row)) + rows()
        row_ab = _enter_rows(ab, j)
        row_bc = _enter_rows(bc, j)
        row_ca = _enter_rows(ca, j)
        below = j - cy
        i = splat(np.float32(COLUMNS * (first - 1))) + columns()
        k = start + (row * stride + first - 1) * LANES
        for _ in range(first, end):
            i = i + splat(np.float32(COLUMNS))
            k += LANES
            w = load(weight, k)
            if not any_nonzero(w):
                continue
            s_ab, v_ab, d_ab = _measure(row_ab, i)
            s_bc, v_bc, d_bc = _measure(row_bc, i)
            s_ca, v_ca, d_ca = _measure(row_ca, i)
            others = smaller(d_bc, d_ca)
            rival_ab = d_ab * tie
            rival_bc = d_ca * tie
            across = smaller(smaller(v_ab, v_bc), v_ca)
            odds = _odds(smaller(d_ab, others), across, inside)
            w = w * odds / (one + odds)
            w = where_less(inside, across, w, zero - w)

            # barycentric coordinates of the nearest point: s of the way along the nearest edge
            s = where_less(d_bc, rival_bc, s_bc * splat(bc.share), s_ca * splat(ca.share))
            s = where_less(others, rival_ab, s, s_ab * splat(ab.share))
            s = smaller(larger(s, zero), one)
            on_a = where_less(d_bc, rival_bc, zero, s)
            on_b = where_less(d_bc, rival_bc, one - s, zero)
            on_a = where_less(others, rival_ab, on_a, one - s)
            on_b = where_less(others, rival_ab, on_b, s)

            x = minus_product(minus_product(i - cx, on_a, ax), on_b, bx)
            y = minus_product(minus_product(below, on_a, ay), on_b, by)
            x = w * x
            y = w * y
            sum_x = sum_x + x
            sum_y = sum_y + y
            sum_ax = plus_product(sum_ax, on_a, x)
            sum_ay = plus_product(sum_ay, on_a, y)
            sum_bx = plus_product(sum_bx, on_b, x)
            sum_by = plus_product(sum_by, on_b, y)
    return totals(sum_x, sum_y, sum_ax, sum_ay, sum_bx, sum_by)


@_jit
def _add_gradient(gradient, faces, face, sums):
    """Add the sums of ``_sum_window`` to the gradients of a face's corners."""
    x, y, ax, ay, bx, by = sums
    gradient[faces[face, 0], 0] += ax
    gradient[faces[face, 0], 1] += ay
    gradient[faces[face, 1], 0] += bx
    gradient[faces[face, 1], 1] += by
    gradient[faces[face, 2], 0] += x - ax - bx
    gradient[faces[face, 2], 1] += y - ay - by


@_jit
def _fill_gradient(points, faces, band, scale, product, weight, gradient):
    """Add the gradient with respect to the points of one view, but for a common factor.

    Args:
        points, faces, band, scale, product: as in ``_fill_product``
        weight: float32, laid out as ``product``: T times the gradient with respect to alpha
        gradient: [verts, 2] float32, added to
    """
    blocks = _count_blocks(band[1], band[2])
    live = np.empty(blocks, np.bool_)
    chunk = _make_chunk()
    _refresh(live, product)
    for first in range(0, faces.shape[0], CHUNK):
        count = _set_up(points, faces, first, band, scale, live, (ROWS, COLUMNS), chunk)
        for f in range(count):
            columns, rows = _read_box(chunk, f)
            left, top = columns[0] - columns[0] % COLUMNS, rows[0] - rows[0] % ROWS
            for y in range(top, rows[1], WINDOW):
                for x in range(left, columns[1], WINDOW):
                    if x > left or y > top:
                        _see(chunk, f, x, y, scale)
                    start = (y // ROWS * blocks[1] + x // COLUMNS) * LANES
                    window = _find_window(columns, rows, x, y)
                    sums = _sum_window(weight, start, blocks[1], chunk, f, window)
                    _add_gradient(gradient, faces, chunk.faces[f], sums)


@_jit
def _fill_alpha(product, stride, height, width, alpha):
    """alpha = 1 - 1 / P of an image, by rows, from P, in rows of ``stride`` blocks."""
    one = splat(np.float32(1))
    for row in range((height + ROWS - 1) // ROWS):
        for column in range((width + COLUMNS - 1) // COLUMNS):
            k = (row * stride + column) * LANES
            y, x = ROWS * row, COLUMNS * column
            p = load(product, k)
            shown = where_less(p, splat(np.float32(np.inf)), (p - one) / p, one)
            if y + ROWS <= height and x + COLUMNS <= width:
                scatter(alpha, y * width + x, width, shown)
                continue
            store(product, k, shown)
            for n in range(LANES):
                if y + n // COLUMNS < height and x + n % COLUMNS < width:
                    alpha[(y + n // COLUMNS) * width + x + n % COLUMNS] = product[k + n]
            store(product, k, p)


@_jit
def _fill_weight(product, stride, upstream, height, width, weight):
    """T times the gradient with respect to alpha, 0 where P is spent and beyond the image.

    Args:
        product: in rows of ``stride`` blocks, as ``weight``, which is written
        upstream: the gradient with respect to alpha, by rows
    """
    zero = splat(np.float32(0))
    for row in range((height + ROWS - 1) // ROWS):
        for column in range((width + COLUMNS - 1) // COLUMNS):
            k = (row * stride + column) * LANES
            y, x = ROWS * row, COLUMNS * column
            if y + ROWS <= height and x + COLUMNS <= width:
                above = gather(upstream, y * width + x, width)
            else:
                for n in range(LANES):
                    within = y + n // COLUMNS < height and x + n % COLUMNS < width
                    at = (y + n // COLUMNS) * width + x + n % COLUMNS
                    weight[k + n] = upstream[at] if within else np.float32(0)
                above = load(weight, k)
            p = load(product, k)
            store(weight, k, where_less(p, splat(np.float32(SPENT)), above / p, zero))


def _keep_compiled(code: str) -> tuple[Callable, Callable]:
    """The two kernels that Python calls, kept on disk once they are compiled.

    numba compiles anew what it has kept when the function's own file changed. Of the files that the
    function's callees and constants come from it knows nothing; but what a function closes over is
    in its key, so these close over a digest of those files.
    """

    @njit(cache=True, **OPTIONS)
    def draw(points, faces, band, scale, product, alpha):
        code  # noqa: B018
        _fill_product(points, faces, band, scale, product)
        stride = _count_blocks(band[1], band[2])[1]
        _fill_alpha(product, stride, band[1], band[2], alpha)

    @njit(cache=True, **OPTIONS)
    def draw_back(points, faces, band, scale, product, upstream, weight, gradient):
        code  # noqa: B018
        stride = _count_blocks(band[1], band[2])[1]
        _fill_weight(product, stride, upstream, band[1], band[2], weight)
        gradient[:] = 0
        _fill_gradient(points, faces, band, scale, product, weight, gradient)
        gradient *= np.float32(-2 * scale * scale / LOG2_E)

    return draw, draw_back


_FILES = b"".join(Path(module.__file__).read_bytes() for module in (simd, reference))
_draw, _draw_back = _keep_compiled(hashlib.sha256(_FILES).hexdigest())


def soft_silhouettes(points: Tensor, faces: Tensor, size: tuple[int, int], sigma: float) -> Tensor:
    """As ``silmesh.softras.soft_silhouettes``, without its checks, for float32 on the CPU."""
    return _SoftSilhouettes.apply(points, faces, size, sigma)


class _SoftSilhouettes(torch.autograd.Function):
    @staticmethod
    def forward(ctx, points, faces, size, sigma):
        points = points.detach().contiguous()
        faces = faces.contiguous()
        ctx.scale = math.sqrt(LOG2_E / sigma) / (max(size) / 2)
        alpha = points.new_empty(len(points), *size)
        bands = _cut(len(points), size[0])
        padded = _count_padded((max(rows for _, rows in bands), size[1]))
        kept = ctx.needs_input_grad[0]
        product = points.new_empty(len(points), len(bands), padded if kept else 0)
        ctx.save_for_backward(points, faces, product)
        arrays = points.numpy(), faces.numpy(), product.numpy(), alpha.numpy()

        def draw(view, band, scratch):
            points, faces, product, alpha = arrays
            top, rows = bands[band]
            place = (top, rows, size[1]), ctx.scale
            into = product[view, band] if kept else scratch
            into = into[: _count_padded((rows, size[1]))]
            _draw(points[view], faces, *place, into, alpha[view, top : top + rows].reshape(-1))

        _run(draw, len(points), len(bands), padded)
        return alpha

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, upstream):
        points, faces, product = (t.numpy() for t in ctx.saved_tensors)
        upstream = upstream.contiguous().numpy()
        bands = _cut(len(points), upstream.shape[1])
        gradient = np.empty((len(points), len(bands), *points.shape[1:]), np.float32)

        def draw_back(view, band, weight):
            top, rows = bands[band]
            place = (top, rows, upstream.shape[2]), ctx.scale
            here, into = product[view, band], gradient[view, band]
            part = upstream[view, top : top + rows].reshape(-1)
            _draw_back(points[view], faces, *place, here, part, weight, into)

        _run(draw_back, len(points), len(bands), product.shape[2])
        return torch.from_numpy(gradient.sum(axis=1)), None, None, None


def _count_padded(size: tuple[int, int]) -> int:
    """Pixels of an image's blocks, of which some may lie beyond its right and lower sides."""
    rows, columns = _count_blocks.py_func(*size)
    return rows * columns * LANES


def _cut(views: int, height: int) -> list[tuple[int, int]]:
    """First row and number of rows of the bands that each of so many views is cut into."""
    count = min(-(-TASKS // max(views, 1)), max(height // BAND, 1))
    ends = [height * k // count for k in range(count + 1)]
    return [(top, end - top) for top, end in pairwise(ends)]


def _run(work: Callable[[int, int, np.ndarray], None], views: int, bands: int, pixels: int) -> None:
    """Do the work of each band of each view, on as many threads as torch uses.

    Each thread has a scratch image of so many pixels of its own.
    """
    waiting = iter(list(product(range(views), range(bands))))  # shared: each task is taken once

    def take():
        scratch = np.empty(pixels, np.float32)
        for task in waiting:
            work(*task, scratch)

    others = min(torch.get_num_threads(), views * bands) - 1
    if others < 1:
        take()
        return
    with ThreadPoolExecutor(others) as pool:
        helpers = [pool.submit(take) for _ in range(others)]
        take()
        for helper in helpers:
            helper.result()
