"""Soft silhouettes on a GPU: Triton kernels, each of whose programs draws a few faces of one view.

The equations are those of ``silmesh.softras.reference``; scaled lengths, windows and lines are
those of ``silmesh.softras.cpu``. What is particular here:

- A program visits the pixels of the box about a face, enlarged by the face's softness, BLOCK at a
  time by rows. No lists of the faces of each tile are made: the faces of a fit are smaller than a
  tile, so that most pixels of a tile would be out of a listed face's reach.
- log2 (1 + 2^z) = -log2 (1 - D) is added atomically to an image, whose sums give T. The additions
  come in no fixed order, so the last bits change from run to run.
- Backward, a program sums the gradient of a face in registers and adds that to its corners.
- Edges are set up in float64 and seen from each window in float32, as in ``cpu``.
- The same kernel draws whole images and the wanted tiles of ``silmesh.softras.tiles``.

With TRITON_INTERPRET=1 in the environment it runs on the CPU, slowly, which is how it is tested
where there is no GPU. Only what renders on a GPU imports this module, and with it Triton.
"""

import math
from typing import TYPE_CHECKING

import torch
import triton
import triton.language as tl
from torch import Tensor

from silmesh.softras import cpu
from silmesh.softras.reference import TIE

if TYPE_CHECKING:
    from silmesh.softras.tiles import Tiles

# Pixels that a program visits at once, faces that it draws one after another, and its threads in
# groups of 32; ``benchmarks/gpu.py`` times others.
BLOCK, FACES, WARPS = 64, 4, 1

_WINDOW = tl.constexpr(32)  # pixels, no more than a tile has
_CUTOFF_Z = tl.constexpr(cpu.CUTOFF_Z)
_THIN_Z = tl.constexpr(cpu.THIN_Z)
_TIE = tl.constexpr(TIE)
_SLACK = tl.constexpr(cpu.SLACK)  # pixels: boxes are wider by this, so that rounding loses none
_FAR = tl.constexpr(1e18)  # pixels: the square of twice this is finite in float32
_NEAR = tl.constexpr(1e-36)  # squared pixels: a shorter edge is a point


@triton.jit
def _load_corner(points, faces, corner):
    """The index of a face's corner in its view's points, and its x and y, in pixels."""
    vert = tl.load(faces + corner)
    return vert, tl.load(points + 2 * vert), tl.load(points + 2 * vert + 1)


@triton.jit
def _find_pixels(a, b, c, reach, size):
    """First and past-the-last pixel from min - reach to max + reach, clipped to the image."""
    low = tl.minimum(tl.minimum(a, b), c) - reach - 0.5
    high = tl.maximum(tl.maximum(a, b), c) + reach - 0.5
    low = tl.ceil(tl.minimum(tl.maximum(low, 0.0), size))
    high = tl.floor(tl.minimum(tl.maximum(high, -1.0), size - 1.0))
    return low.to(tl.int32), high.to(tl.int32) + 1


@triton.jit
def _find_box(a, b, c, reach, height, width):
    """First and past-the-last column and row of a face's pixels; none if it is not finite."""
    x0, x1 = _find_pixels(a[1], b[1], c[1], reach, width.to(tl.float32))
    y0, y1 = _find_pixels(a[2], b[2], c[2], reach, height.to(tl.float32))
    within = (tl.abs(a[1]) < _FAR) & (tl.abs(b[1]) < _FAR) & (tl.abs(c[1]) < _FAR)
    within &= (tl.abs(a[2]) < _FAR) & (tl.abs(b[2]) < _FAR) & (tl.abs(c[2]) < _FAR)
    return x0, x1, y0, tl.where(within, y1, y0)


@triton.jit
def _make_edge(a, b, scale):
    """An edge from a to b: where it begins, its direction and length, scaled, all in float64.

    The reciprocal of its length is one of float32, made precise by a step of Newton's. An edge of
    no length is a point, in any frame. In float32 follow its direction and its share of the way
    from a to b that a length before it is, which grows from 0 to -1.
    """
    near_x, near_y = b[1] - a[1], b[2] - a[2]
    square = near_x * near_x + near_y * near_y
    some = square > _NEAR
    root = tl.where(some, tl.rsqrt(tl.where(some, square, 1.0)), 0.0)
    ux, uy = tl.where(some, near_x * (root * scale), scale), near_y * (root * scale)
    share = -root / scale

    ax, ay = a[1].to(tl.float64), a[2].to(tl.float64)
    x, y = b[1].to(tl.float64) - ax, b[2].to(tl.float64) - ay
    square = x * x + y * y
    root = root.to(tl.float64)
    root *= 1.5 - 0.5 * square * root * root
    factor = root * scale
    return ax, ay, tl.where(some, x * factor, scale), y * factor, square * factor, ux, uy, share


@triton.jit
def _judge_face(ab, bc, ca):
    """1 or -1 by orientation, the v above which a pixel is inside, and what breaks ties.

    A thin triangle has no inside, and of its edges the first is preferred (see ``reference``).
    """
    height = ab[2] * (ca[1] - ab[1]) - ab[3] * (ca[0] - ab[0])  # of c above ab, scaled
    longest = tl.maximum(tl.maximum(ab[4], bc[4]), ca[4])
    thick = tl.abs(height) * ab[4] > _THIN_Z * longest
    sign = tl.where(height < 0, -1.0, 1.0)
    inside = tl.where(thick, 0.0, float("inf"))
    return sign, inside, tl.where(thick, 1.0, _TIE)


@triton.jit
def _see_line(edge, sign, x, y):
    """An edge from the middle (x, y) of a window's first pixel, in float32: see ``cpu.Line``."""
    ax, ay, ux, uy, length, near_ux, near_uy, share = edge
    u = ux * (x - ax) + uy * (y - ay)
    v = (ux * (y - ay) - uy * (x - ax)).to(tl.float32)
    before, after = -u.to(tl.float32), (u - length).to(tl.float32)
    return before, after, sign * v, near_ux, near_uy, -sign * near_uy, sign * near_ux, share


@triton.jit
def _measure(line, i, j):
    """How far pixels (i, j) of a window lie before an edge, across it, and from it (squared)."""
    along = line[3] * i + line[4] * j
    before = line[0] - along
    beyond = tl.maximum(tl.maximum(before, line[1] + along), 0.0)
    across = (line[2] + line[5] * i) + line[6] * j
    return before, across, beyond * beyond + across * across


@triton.jit
def _log2_of_one_plus(t):
    """log2 (1 + t) of t from 0 to 1, to 3e-7 in float32: a polynomial fitted by least maximum."""
    p = -0.0093091577 * t + 0.05205898
    p = p * t - 0.13752131
    p = p * t + 0.24186476
    p = p * t - 0.34730107
    p = p * t + 0.47868371
    p = p * t - 0.72116578
    return (p * t + 1.4426899) * t


@triton.jit
def _clip(share):
    return tl.minimum(tl.maximum(share, 0.0), 1.0)


@triton.jit
def _find_nearest(s_ab, s_bc, s_ca, d_ab, d_bc, d_ca, tie):
    """Barycentric coordinates, a's and b's, of a triangle's points nearest to pixels.

    Args:
        s_ab, s_bc, s_ca: the share of the way along each edge at which its nearest point lies
        d_ab, d_bc, d_ca: squared distances of these
    """
    s_ab, s_bc, s_ca = _clip(s_ab), _clip(s_bc), _clip(s_ca)
    on_bc = d_bc < d_ca * tie
    on_ab = tl.minimum(d_bc, d_ca) >= d_ab * tie
    of_a = tl.where(on_ab, 1 - s_ab, tl.where(on_bc, 0.0, s_ca))
    of_b = tl.where(on_ab, s_ab, tl.where(on_bc, 1 - s_bc, 0.0))
    return of_a, of_b


@triton.jit
def _locate(number, x, y, width, within, TILE: tl.constexpr):
    """Where pixels lie in their image, or among the wanted tiles, and which of them do."""
    if TILE == 0:
        return y * width + x, within
    else:
        tile = y // TILE * tl.cdiv(width, TILE) + x // TILE
        tile = tl.load(number + tile, mask=within, other=-1)
        return (tile.to(tl.int64) * TILE + y % TILE) * TILE + x % TILE, within & (tile >= 0)


@triton.jit
def _count_pixels(number, x, y, across, down, width, TILE: tl.constexpr):
    """Of a window: none if it reaches no wanted tile, of which its corners tell."""
    if TILE == 0:
        return across * down
    else:
        above = number + y // TILE * tl.cdiv(width, TILE)
        below = number + (y + down - 1) // TILE * tl.cdiv(width, TILE)
        left, right = x // TILE, (x + across - 1) // TILE
        upper = tl.maximum(tl.load(above + left), tl.load(above + right))
        lower = tl.maximum(tl.load(below + left), tl.load(below + right))
        return tl.where(tl.maximum(upper, lower) >= 0, across * down, 0)


@triton.jit
def _add_corner(gradient, corner, x, y, some):
    """Add to the gradient of a corner, if there is something."""
    tl.atomic_add(gradient + 2 * corner[0], x, mask=some, sem="relaxed")
    tl.atomic_add(gradient + 2 * corner[0] + 1, y, mask=some, sem="relaxed")


@triton.jit
def _draw(
    points,
    faces,
    number,
    image,
    gradient,
    verts,
    count,
    height,
    width,
    scale,
    factor,
    TILE: tl.constexpr,
    BACK: tl.constexpr,
    BLOCK: tl.constexpr,
    FACES: tl.constexpr,
):
    """Draw some faces of a view; or, if BACK, pass the gradient of the pixels on to their corners.

    Args:
        points: [views, verts, 2] float32
        faces: [count, 3] int64
        number: [views, rows, columns] int32 as ``Tiles`` has it, if TILE is not 0
        image: [views, height, width] or [tiles, TILE, TILE] float32: -log2 T, added to; if BACK, T
            times the gradient with respect to alpha, read
        gradient: [views, verts, 2] float32, added to if BACK
        scale: from pixels to lengths whose square is z
        factor: of all gradients
    """
    view = tl.program_id(1).to(tl.int64)
    points += view * verts * 2
    gradient += view * verts * 2
    if TILE == 0:
        image += view * height * width
    else:
        number += view * tl.cdiv(height, TILE) * tl.cdiv(width, TILE)
    reach = tl.sqrt(tl.cast(_CUTOFF_Z, tl.float32)) / scale + _SLACK
    lane = tl.arange(0, BLOCK)
    first = tl.program_id(0) * FACES
    for face in range(first, tl.minimum(first + FACES, count)):
        a = _load_corner(points, faces, 3 * face)
        b = _load_corner(points, faces, 3 * face + 1)
        c = _load_corner(points, faces, 3 * face + 2)
        x0, x1, y0, y1 = _find_box(a, b, c, reach, height, width)
        ab = _make_edge(a, b, scale)
        bc = _make_edge(b, c, scale)
        ca = _make_edge(c, a, scale)
        sign, inside, tie = _judge_face(ab, bc, ca)
        sum_x = tl.zeros((BLOCK,), tl.float32)
        sum_y, sum_ax, sum_ay, sum_bx, sum_by = sum_x, sum_x, sum_x, sum_x, sum_x
        acx, acy, bcx, bcy = a[1] - c[1], a[2] - c[2], b[1] - c[1], b[2] - c[2]
        for y in range(y0, y1, _WINDOW):
            for x in range(x0, x1, _WINDOW):
                line_ab = _see_line(ab, sign, x + 0.5, y + 0.5)
                line_bc = _see_line(bc, sign, x + 0.5, y + 0.5)
                line_ca = _see_line(ca, sign, x + 0.5, y + 0.5)
                cx, cy = c[1] - (x + 0.5), c[2] - (y + 0.5)
                across = tl.minimum(x1 - x, _WINDOW)
                down = tl.minimum(y1 - y, _WINDOW)
                visited = _count_pixels(number, x, y, across, down, width, TILE)
                # k // across = k per >> 16 for the k and across of a window
                per = (65536.0 / across.to(tl.float32)).to(tl.int32) + 1
                for start in range(0, visited, BLOCK):
                    k = start + lane
                    row = (k * per) >> 16
                    column = k - row * across
                    i, j = column.to(tl.float32), row.to(tl.float32)
                    s_ab, v_ab, d_ab = _measure(line_ab, i, j)
                    s_bc, v_bc, d_bc = _measure(line_bc, i, j)
                    s_ca, v_ca, d_ca = _measure(line_ca, i, j)
                    nearest = tl.minimum(tl.minimum(d_ab, d_bc), d_ca)
                    within = tl.minimum(tl.minimum(v_ab, v_bc), v_ca) > inside
                    reached = (k < visited) & (within | (nearest <= _CUTOFF_Z))
                    into, reached = _locate(number, x + column, y + row, width, reached, TILE)
                    t = tl.exp2(-nearest)
                    if BACK:
                        w = tl.load(image + into, mask=reached, other=0.0) / (1 + t)
                        w = tl.where(within, w, -w * t)  # times D, or minus D
                        s_ab, s_bc, s_ca = s_ab * line_ab[7], s_bc * line_bc[7], s_ca * line_ca[7]
                        on_a, on_b = _find_nearest(s_ab, s_bc, s_ca, d_ab, d_bc, d_ca, tie)
                        wx = w * (i - cx - on_a * acx - on_b * bcx)
                        wy = w * (j - cy - on_a * acy - on_b * bcy)
                        sum_x += wx
                        sum_y += wy
                        sum_ax += on_a * wx
                        sum_ay += on_a * wy
                        sum_bx += on_b * wx
                        sum_by += on_b * wy
                    else:
                        gain = tl.where(within, nearest, 0.0) + _log2_of_one_plus(t)
                        tl.atomic_add(image + into, gain, mask=reached, sem="relaxed")
        if BACK:
            some = (x0 < x1) & (y0 < y1)
            gax, gay = factor * tl.sum(sum_ax), factor * tl.sum(sum_ay)
            gbx, gby = factor * tl.sum(sum_bx), factor * tl.sum(sum_by)
            gcx, gcy = factor * tl.sum(sum_x) - gax - gbx, factor * tl.sum(sum_y) - gay - gby
            _add_corner(gradient, a, gax, gay, some)
            _add_corner(gradient, b, gbx, gby, some)
            _add_corner(gradient, c, gcx, gcy, some)


def soft_silhouettes(points: Tensor, faces: Tensor, size: tuple[int, int], sigma: float) -> Tensor:
    """As ``silmesh.softras.soft_silhouettes``, without its checks, for float32 on a GPU."""
    return _SoftSilhouettes.apply(points, faces, None, (len(points), *size), size, sigma)


def soft_tiles(points: Tensor, faces: Tensor, tiles: "Tiles", sigma: float) -> Tensor:
    """As ``silmesh.softras.tiles.soft_tiles``, for float32 on a GPU."""
    number = tiles.number_on(points.device)
    return _SoftSilhouettes.apply(points, faces, number, tiles.shape, tiles.size, sigma)


class _SoftSilhouettes(torch.autograd.Function):
    @staticmethod
    def forward(ctx, points, faces, number, shape, size, sigma):
        points, faces = points.detach().contiguous(), faces.contiguous()
        ctx.side, ctx.size, ctx.half = 0 if number is None else shape[1], size, max(size) / 2
        ctx.sigma, number = sigma, points if number is None else number
        absorbed = points.new_zeros(shape)
        _launch(ctx, points, faces, number, absorbed, points)
        through = absorbed.neg_().exp2_()  # T
        ctx.save_for_backward(points, faces, number, through)
        return 1 - through

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, upstream):
        points, faces, number, through = ctx.saved_tensors
        gradient = torch.zeros_like(points)
        _launch(ctx, points, faces, number, upstream * through, gradient, back=True)
        return gradient, None, None, None, None, None


def _launch(ctx, points, faces, number, image, gradient, back=False):
    """Draw all faces of all views; see ``_draw``."""
    views, verts, _ = points.shape
    if not (views and len(faces) and image.numel()):
        return
    _draw[(triton.cdiv(len(faces), FACES), views)](
        points,
        faces,
        number,
        image,
        gradient,
        verts,
        len(faces),
        *ctx.size,
        math.sqrt(cpu.LOG2_E / ctx.sigma) / ctx.half,
        -2 / (ctx.sigma * ctx.half**2),
        TILE=ctx.side,
        BACK=back,
        BLOCK=BLOCK,
        FACES=FACES,
        num_warps=WARPS,
        enable_fp_fusion=True,
    )
