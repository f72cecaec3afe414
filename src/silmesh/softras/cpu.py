"""Soft silhouettes on the CPU: numba kernels, one pass over the triangles of each view.

The equations are those of ``silmesh.softras.reference``. What is particular here:

- All lengths are scaled so that D = 2^z / (1 + 2^z), z = +-d^2.
- 1 / (1 - D) = 1 + 2^z, so a view keeps the product P = 1 / T of these in one image, and no list
  of the faces of a pixel or of the pixels of a face: memory grows with views x pixels alone.
- A face is drawn in windows of at most 64 x 64 pixels. Their origins are set in float64, so within
  a window distances in float32 are right to about 1e-6 pixel however large the face. (The foot of
  the gradient's p - c is placed along its edge to 1e-7 of the edge's length, which shows only where
  sqrt(sigma) is a thousandth of that length.)
- In each row of a window only the span that lies within the cutoff of all three edges' half-planes
  is visited, eight pixels at a time, without branches.
- A pixel whose P has reached SPENT is opaque to within 1 / SPENT and passes no gradient. A face
  that reaches only cells of CELL x CELL such pixels is passed over before it is set up: as the
  image fills, and on the way back.

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
    ROWS,
    any_nonzero,
    columns,
    exp2,
    larger,
    load,
    minus_product,
    plus_product,
    rows,
    smaller,
    splat,
    store,
    total,
    where_less,
)

WINDOW = 64  # pixels
LOG2_E = math.log2(math.e)
CUTOFF_Z = CUTOFF * LOG2_E
THIN_Z = THIN * math.sqrt(LOG2_E)
LARGEST_Z = 126  # 2^z stays finite
SPENT = 1e6  # at this P nothing can change a pixel any more
CELL = 8  # pixels
REFRESH = 1024  # faces between looks for cells that are spent
TASKS = 2  # a batch of fewer views is cut into about so many bands
BAND = 32  # rows that a band has at least
FAR = 1e9  # pixels: no bound
SLACK = 0.01  # pixels: spans are wider by this, so that rounding loses no pixel
NARROW = 12  # pixels: in a window no wider, whole rows are visited
LEVEL = 0.02  # an edge that rises less than this bounds no span

OPTIONS = {"nogil": True, "fastmath": {"contract"}, "error_model": "numpy"}
_jit = njit(**OPTIONS)


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
    """Where an edge's inner half-plane and its cutoff lie in rows j and j + 1 of a window.

    From the column ``left + slope j``, or up to ``right + slope j``, in float32.
    """

    left: float
    right: float
    slope: float


class Row(NamedTuple):
    """What a ``Line`` becomes in one row of the window, each number in all simd."""

    before: object
    after: object
    across: object
    ux: object
    vx: object


@_jit
def _make_edge(ax, ay, bx, by, sign, scale):
    """An edge of no length is a point: there any frame measures the distance rightly."""
    x = bx - ax
    y = by - ay
    length = math.sqrt(x * x + y * y)
    if length > 0:
        x *= scale / length
        y *= scale / length
    else:
        x = scale
        y = 0.0
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
    if thick:
        return (ab, bc, ca), np.float32(0.0), np.float32(1.0)
    return (ab, bc, ca), np.float32(np.inf), np.float32(TIE)


@_jit
def _corner(points, vert, top):
    return np.float64(points[vert, 0]), np.float64(points[vert, 1]) - top


@_jit
def _find_pixels(a, b, c, radius, size):
    """First and past-the-last pixel from min - radius to max + radius, clipped to the image.

    The centre of pixel i is at i + 1/2. A number that is not finite gives an empty range.
    """
    if not math.isfinite(a + b + c):
        return 0, 0
    low = min(max(min(a, b, c) - radius - 0.5, 0.0), np.float64(size))
    high = min(max(max(a, b, c) + radius - 0.5, -1.0), size - 1.0)
    return math.ceil(low), math.floor(high) + 1


@_jit
def _find_face(points, faces, face, band, scale):
    """A face's corners, and first and past-the-last column and row of the pixels it may reach."""
    top, height, width = band
    radius = math.sqrt(CUTOFF_Z) / scale
    a = _corner(points, faces[face, 0], top)
    b = _corner(points, faces[face, 1], top)
    c = _corner(points, faces[face, 2], top)
    columns = _find_pixels(a[0], b[0], c[0], radius, width)
    rows = _find_pixels(a[1], b[1], c[1], radius, height)
    return (a, b, c), columns, rows


@_jit
def _make_cells(height, width):
    """Which cells of an image are live, that is not spent throughout: all, at first."""
    return np.ones(((height + CELL - 1) // CELL, (width + CELL - 1) // CELL), np.bool_)


@_jit
def _is_live(product, stride, cell, height, width):
    """Whether any pixel of a cell is not spent."""
    for y in range(CELL * cell[0], min(CELL * cell[0] + CELL, height)):
        for x in range(CELL * cell[1], min(CELL * cell[1] + CELL, width)):
            if product[y * stride + x] < np.float32(SPENT):
                return True
    return False


@_jit
def _refresh(cells, product, stride, height, width):
    """Look which of the live cells are still live."""
    for row in range(cells.shape[0]):
        for column in range(cells.shape[1]):
            if cells[row, column]:
                cell = row, column
                cells[row, column] = _is_live(product, stride, cell, height, width)


@_jit
def _any_live(cells, columns, rows):
    """Whether any of the pixels in these columns and rows, first and past-the-last, is live."""
    if columns[0] >= columns[1]:
        return False
    for row in range(rows[0] // CELL, (rows[1] + CELL - 1) // CELL):
        for column in range(columns[0] // CELL, (columns[1] + CELL - 1) // CELL):
            if cells[row, column]:
                return True
    return False


@_jit
def _see_line(edge, x, y):
    """An edge from the pixel whose centre is (x, y)."""
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
    """An edge's bound from the pixel whose centre is (x, y); no branch, which would be a guess."""
    reach = -math.sqrt(CUTOFF_Z) - edge.vx * (x - edge.ax) - edge.vy * (y - edge.ay)
    level = LEVEL * abs(edge.vy)
    per_row = 1 / edge.vx
    slope = -edge.vy * per_row
    left = max(min(reach * per_row + min(slope, 0.0) - SLACK, FAR), -FAR)
    right = max(min(reach * per_row + max(slope, 0.0) + SLACK, FAR), -FAR)
    left = left if edge.vx > level else -FAR
    right = right if -edge.vx > level else FAR
    slope = slope if abs(edge.vx) > level else 0.0
    return Bound(np.float32(left), np.float32(right), np.float32(slope))


@_jit
def _find_bounds(edges, x, y, width):
    """The bounds of the edges from the centre of pixel (x, y); of a narrow window its sides do."""
    ab, bc, ca = edges
    if width <= NARROW:
        none = Bound(np.float32(-FAR), np.float32(FAR), np.float32(0.0))
        return none, none, none
    x += 0.5
    y += 0.5
    return _find_bound(ab, x, y), _find_bound(bc, x, y), _find_bound(ca, x, y)


@_jit
def _find_span(bounds, j, width):
    """First pixel and number of blocks to visit in rows j and j + 1 of a window."""
    if width <= NARROW:
        return np.int64(0), (width + COLUMNS - 1) // COLUMNS
    ab, bc, ca = bounds
    low = max(ab.left + ab.slope * j, bc.left + bc.slope * j, ca.left + ca.slope * j)
    high = min(ab.right + ab.slope * j, bc.right + bc.slope * j, ca.right + ca.slope * j)
    first = np.int64(max(low, np.float32(0)))
    if width == WINDOW:
        first -= first % COLUMNS  # so that no block reaches into the next window
    last = np.int64(min(high, np.float32(width - 1)))
    return first, (last - first + COLUMNS) // COLUMNS if last >= first else 0


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
def _multiply_window(product, start, stride, lines, bounds, inside, extent):
    """Multiply P by the 1 + 2^z of one triangle in one window."""
    ab, bc, ca = lines
    height, width = extent
    inside = splat(inside)
    for row in range(0, height, ROWS):
        first, blocks = _find_span(bounds, np.float32(row), width)
        j = splat(np.float32(row)) + rows()
        row_ab = _enter_rows(ab, j)
        row_bc = _enter_rows(bc, j)
        row_ca = _enter_rows(ca, j)
        i = splat(np.float32(first)) + columns()
        k = start + row * stride + first
        for _ in range(blocks):
            _, v_ab, d_ab = _measure(row_ab, i)
            _, v_bc, d_bc = _measure(row_bc, i)
            _, v_ca, d_ca = _measure(row_ca, i)
            nearest = smaller(smaller(d_ab, d_bc), d_ca)
            odds = _odds(nearest, smaller(smaller(v_ab, v_bc), v_ca), inside)
            p = load(product, k, stride)
            store(product, k, stride, plus_product(p, p, odds))
            i = i + splat(np.float32(COLUMNS))
            k += COLUMNS


@_jit
def _see_lines(edges, x, y):
    """The edges of a triangle from the centre of pixel (x, y)."""
    ab, bc, ca = edges
    x += 0.5
    y += 0.5
    return _see_line(ab, x, y), _see_line(bc, x, y), _see_line(ca, x, y)


@_jit
def _fill_product(points, faces, band, scale, product):
    """Fill P of one band of a view.

    Args:
        points: [verts, 2] float32
        faces: [faces, 3] int64
        band: its first row in the image, its height and its width
        scale: from pixels to lengths whose square is z
        product: float32, flat, of ``_count_padded`` pixels, written
    """
    _, height, width = band
    stride = width + COLUMNS
    product[:] = 1
    cells = _make_cells(height, width)
    for face in range(faces.shape[0]):
        if face % REFRESH == 0 and face:
            _refresh(cells, product, stride, height, width)
        (a, b, c), (x0, x1), (y0, y1) = _find_face(points, faces, face, band, scale)
        if not _any_live(cells, (x0, x1), (y0, y1)):
            continue
        edges, inside, _ = _make_edges(a, b, c, scale)
        for y in range(y0, y1, WINDOW):
            for x in range(x0, x1, WINDOW):
                lines = _see_lines(edges, x, y)
                extent = min(WINDOW, y1 - y), min(WINDOW, x1 - x)
                bounds = _find_bounds(edges, x, y, extent[1])
                _multiply_window(product, y * stride + x, stride, lines, bounds, inside, extent)


@_jit
def _sum_window(weight, start, stride, lines, bounds, inside, tie, corners, extent):
    """Sum over a window: w (p - c) times the barycentric coordinates of c, the nearest point.

    w is ``weight`` times D with the sign of z. Returns the sums of all, of a's share and of b's.
    """
    ab, bc, ca = lines
    (ax, ay), (bx, by), (cx, cy) = corners
    height, width = extent
    zero = splat(np.float32(0))
    one = splat(np.float32(1))
    inside = splat(inside)
    tie = splat(tie)
    sum_x, sum_y, sum_ax, sum_ay, sum_bx, sum_by = zero, zero, zero, zero, zero, zero
    for row in range(0, height, ROWS):
        first, blocks = _find_span(bounds, np.float32(row), width)
        j = splat(np.float32(row)) + rows()
        row_ab = _enter_rows(ab, j)
        row_bc = _enter_rows(bc, j)
        row_ca = _enter_rows(ca, j)
        below = j - splat(cy)
        i = splat(np.float32(first - COLUMNS)) + columns()
        k = start + row * stride + first - COLUMNS
        for _ in range(blocks):
            i = i + splat(np.float32(COLUMNS))
            k += COLUMNS
            w = load(weight, k, stride)
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

            x = minus_product(minus_product(i - splat(cx), on_a, splat(ax)), on_b, splat(bx))
            y = minus_product(minus_product(below, on_a, splat(ay)), on_b, splat(by))
            x = w * x
            y = w * y
            sum_x = sum_x + x
            sum_y = sum_y + y
            sum_ax = plus_product(sum_ax, on_a, x)
            sum_ay = plus_product(sum_ay, on_a, y)
            sum_bx = plus_product(sum_bx, on_b, x)
            sum_by = plus_product(sum_by, on_b, y)
    return total(sum_x), total(sum_y), total(sum_ax), total(sum_ay), total(sum_bx), total(sum_by)


@_jit
def _see_corners(a, b, c, x, y):
    """c from the centre of pixel (x, y), a and b from c, in pixels, float32."""
    return (
        (np.float32(a[0] - c[0]), np.float32(a[1] - c[1])),
        (np.float32(b[0] - c[0]), np.float32(b[1] - c[1])),
        (np.float32(c[0] - x - 0.5), np.float32(c[1] - y - 0.5)),
    )


@_jit
def _fill_gradient(points, faces, band, scale, product, weight, gradient):
    """Add the gradient with respect to the points of one view, but for a common factor.

    Args:
        points, faces, band, scale, product: as in ``_fill_product``
        weight: float32, laid out as ``product``: T times the gradient with respect to alpha
        gradient: [verts, 2] float32, added to
    """
    _, height, width = band
    stride = width + COLUMNS
    cells = _make_cells(height, width)
    _refresh(cells, product, stride, height, width)
    for face in range(faces.shape[0]):
        (a, b, c), (x0, x1), (y0, y1) = _find_face(points, faces, face, band, scale)
        if not _any_live(cells, (x0, x1), (y0, y1)):
            continue
        edges, inside, tie = _make_edges(a, b, c, scale)
        for y in range(y0, y1, WINDOW):
            for x in range(x0, x1, WINDOW):
                lines = _see_lines(edges, x, y)
                corners = _see_corners(a, b, c, x, y)
                extent = min(WINDOW, y1 - y), min(WINDOW, x1 - x)
                bounds = _find_bounds(edges, x, y, extent[1])
                gx, gy, gax, gay, gbx, gby = _sum_window(
                    weight, y * stride + x, stride, lines, bounds, inside, tie, corners, extent
                )
                gradient[faces[face, 0], 0] += gax
                gradient[faces[face, 0], 1] += gay
                gradient[faces[face, 1], 0] += gbx
                gradient[faces[face, 1], 1] += gby
                gradient[faces[face, 2], 0] += gx - gax - gbx
                gradient[faces[face, 2], 1] += gy - gay - gby


@_jit
def _fill_alpha(points, faces, top, scale, product, alpha):
    """P and alpha = 1 - 1 / P of one band of a view, alpha [height, width], from row ``top``."""
    height, width = alpha.shape
    _fill_product(points, faces, (top, height, width), scale, product)
    for y in range(height):
        for x in range(width):
            p = product[y * (width + COLUMNS) + x]
            alpha[y, x] = (p - np.float32(1)) / p if p < np.float32(np.inf) else np.float32(1)


@_jit
def _fill_back(points, faces, top, scale, product, upstream, weight, gradient):
    """The gradient [verts, 2] of one band from that with respect to its alpha [height, width]."""
    height, width = upstream.shape
    stride = width + COLUMNS
    weight[:] = 0
    for y in range(height):
        for x in range(width):
            p = product[y * stride + x]
            if p < np.float32(SPENT):
                weight[y * stride + x] = upstream[y, x] / p
    gradient[:] = 0
    _fill_gradient(points, faces, (top, height, width), scale, product, weight, gradient)
    factor = np.float32(-2 * scale * scale / LOG2_E)
    for vert in range(gradient.shape[0]):
        gradient[vert, 0] *= factor
        gradient[vert, 1] *= factor


def _keep_compiled(code: str) -> tuple[Callable, Callable]:
    """The two kernels that Python calls, kept on disk once they are compiled.

    numba compiles anew what it has kept when the function's own file changed. Of the files that the
    function's callees and constants come from it knows nothing; but what a function closes over is
    in its key, so these close over a digest of those files.
    """

    @njit(cache=True, **OPTIONS)
    def draw(points, faces, top, scale, product, alpha):
        code  # noqa: B018
        _fill_alpha(points, faces, top, scale, product, alpha)

    @njit(cache=True, **OPTIONS)
    def draw_back(points, faces, top, scale, product, upstream, weight, gradient):
        code  # noqa: B018
        _fill_back(points, faces, top, scale, product, upstream, weight, gradient)

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
            into = product[view, band] if kept else scratch
            _draw(points[view], faces, top, ctx.scale, into, alpha[view, top : top + rows])

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
            here, into = product[view, band], gradient[view, band]
            part = upstream[view, top : top + rows]
            _draw_back(points[view], faces, top, ctx.scale, here, part, weight, into)

        _run(draw_back, len(points), len(bands), product.shape[2])
        return torch.from_numpy(gradient.sum(axis=1)), None, None, None


def _count_padded(size: tuple[int, int]) -> int:
    """Pixels of an image whose last blocks may reach beyond its right and lower sides."""
    height, width = size
    return (height + ROWS) * (width + COLUMNS)


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
