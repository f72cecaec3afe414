"""What goes wrong with silhouettes and cameras, each damage at a strength and from a seed.

Every function is pure: the same arguments give the same result, and what is given stays as it is.
Silhouettes are [views, height, width] bool, frames [views, 4] left, top, right and bottom of the
photographs within the images, in pixels. What is returned last are the positions of the views that
were damaged, sorted; but for damages of all views.
"""

import zlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation

from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import whole_frames

Masks = NDArray[np.bool_]
Frames = NDArray[np.int64]
Positions = list[int]

PORTRAIT = 3 / 4  # width over height
MARGIN = 0.9  # of the frame: the most that an object fills that is not cut
NEARER = (1.1, 1.6)  # factors by which a close-up is larger than what just fits
CUT_OFF = (0.1, 0.4)  # shares of the object's box beyond the edge of a close-up


def choose_views(views: int, share: float, seed: int, kind: str) -> Positions:
    """The positions of a share of the views, rounded, at least one unless the share is 0."""
    count = max(round(share * views), 1 if share > 0 else 0)
    return sorted(_generator(seed, kind).permutation(views)[:count].tolist())


def bite(masks: Masks, area: float, share: float, seed: int = 0) -> tuple[Masks, Positions]:
    """Take a round bite off the outline of a share of the silhouettes.

    Args:
        area: share of the silhouette's pixels that it lacks then, exactly but for rounding
        share: of the views
    """
    wrong = choose_views(len(masks), share, seed, "bite")
    out = masks.copy()
    for view in wrong:
        seen = masks[view]
        outline = seen & ~ndimage.binary_erosion(seen)
        _set_nearest(out[view], seen, outline, area * seen.sum(), False, (seed, view, "bite"))
    return out, wrong


def add_blobs(masks: Masks, area: float, share: float, seed: int = 0) -> tuple[Masks, Positions]:
    """Add a round blob somewhere beside the object to a share of the silhouettes.

    Args:
        area: of the blob, as a share of the silhouette's
        share: of the views
    """
    wrong = choose_views(len(masks), share, seed, "blob")
    out = masks.copy()
    for view in wrong:
        beside = ~masks[view]
        count = area * masks[view].sum()
        _set_nearest(out[view], beside, beside, count, True, (seed, view, "blob"))
    return out, wrong


def add_specks(masks: Masks, amount: float, share: float, seed: int = 0) -> tuple[Masks, Positions]:
    """Flip single pixels, as a threshold does in noise: as many on the object as beside it.

    Args:
        amount: flipped pixels of each kind, as a share of the silhouette's area
        share: of the views
    """
    wrong = choose_views(len(masks), share, seed, "speck")
    out = masks.copy()
    for view in wrong:
        rng = _generator(seed, "speck", view)
        count = round(amount * masks[view].sum())
        for part in (masks[view], ~masks[view]):
            pixels = np.flatnonzero(part)
            flipped = rng.choice(pixels, min(count, len(pixels)), replace=False)
            out[view].flat[flipped] ^= True
    return out, wrong


def grow(masks: Masks, pixels: float, share: float = 1.0, seed: int = 0) -> tuple[Masks, Positions]:
    """Move the outlines outwards by so many pixels, or inwards by a negative number."""
    wrong = choose_views(len(masks), share, seed, "grow")
    out = masks.copy()
    for view in wrong:
        inside = pixels < 0
        gap = ndimage.distance_transform_edt(masks[view] if inside else ~masks[view])
        out[view] = gap > -pixels if inside else gap <= pixels
    return out, wrong


def cut_off(masks: Masks, share: float = 0.1) -> Masks:
    """Cut the lowest share of the rows that any mask has off all masks, by one straight line."""
    rows, left = np.flatnonzero(masks.any(axis=(0, 2))), masks.copy()
    left[:, rows[-1] - round(share * len(rows)) :] = False
    return left


def put_on_plate(masks: Masks, share: float = 0.1, off: float = 3.0) -> Masks:
    """Take a plate for the object in all masks: an ellipse about the lowest share of the rows.

    Args:
        off: pixels by which it stands beside the image's middle, where the axis is
    """
    rows, columns = (np.flatnonzero(masks.any(axis=axes)) for axes in ((0, 2), (0, 1)))
    v, u = np.mgrid[: masks.shape[1], : masks.shape[2]] + 0.5
    across = (u - masks.shape[2] / 2 - off) / (0.6 * len(columns))
    down = (v - rows[-1]) / (share * len(rows)) + 0.5
    return masks | (across**2 + down**2 < 1)


def empty(masks: Masks, share: float, seed: int = 0) -> tuple[Masks, Positions]:
    """Lose a share of the silhouettes: nothing is seen in them."""
    wrong = choose_views(len(masks), share, seed, "empty")
    return _put(masks, wrong, np.zeros_like(masks)), wrong


def fill(
    masks: Masks, share: float, seed: int = 0, frames: Frames | None = None
) -> tuple[Masks, Positions]:
    """Take the whole photograph for the object, in a share of the views."""
    wrong = choose_views(len(masks), share, seed, "fill")
    return _put(masks, wrong, keep_inside(np.ones_like(masks), frames)), wrong


def swap(masks: Masks, others: Masks, share: float, seed: int = 0) -> tuple[Masks, Positions]:
    """Put another object's silhouettes, of as many views, in place of a share of them."""
    wrong = choose_views(len(masks), share, seed, "swap")
    return _put(masks, wrong, others), wrong


def shake(cameras: Cameras, degrees: float, seed: int = 0) -> tuple[Cameras, Positions]:
    """Turn every camera by so many degrees about its own centre, each about another axis."""
    axes = _generator(seed, "shake").standard_normal((len(cameras), 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    turn = torch.from_numpy(Rotation.from_rotvec(np.radians(degrees) * axes).as_matrix())
    return _pose(cameras, turn @ cameras.R, cameras.centres), list(range(len(cameras)))


def misplace(cameras: Cameras, share: float, seed: int = 0) -> tuple[Cameras, Positions]:
    """Give a share of the views another view's pose: one of the half that stands further away."""
    wrong = choose_views(len(cameras), share, seed, "misplace")
    centres, R = cameras.centres, cameras.R.clone()
    moved = centres.clone()
    for view in wrong:
        away = (centres - centres[view]).norm(dim=1).argsort()
        taken = _generator(seed, "misplace", view).choice(away[len(away) // 2 :].numpy())
        R[view], moved[view] = cameras.R[taken], centres[taken]
    return _pose(cameras, R, moved), wrong


def step_nearer(
    masks: Masks, share: float, seed: int = 0, aspect: float = PORTRAIT
) -> tuple[NDArray[np.float64], Frames, Positions]:
    """Where photographs of a shape see the object, of which a share are close-ups that cut it.

        +--+------+--+   the working image is square, the photograph its middle part
        |  |  ____|  |
        |  | /    |  |   a close-up: the object's box goes on beyond one side, or more, of
        |  | \\____|  |   the photograph by CUT_OFF of its extent
        |  |      |  |
        +--+------+--+

    Args:
        masks: none of them cut, in square images
        share: of the views that are close-ups; the object is whole in the others
        aspect: width over height of the photographs
    Returns:
        maps [views, 3, 3] from the old images' pixels to the new ones', the frames, and the
        positions of the close-ups
    """
    close = choose_views(len(masks), share, seed, "nearer")
    frame = _central_frame(masks.shape[1], aspect)
    maps = [
        _fit(masks[view], frame, _generator(seed, "nearer", view) if view in close else None)
        for view in range(len(masks))
    ]
    return np.stack(maps), np.tile(frame, (len(masks), 1)), close


def look_through(masks: Masks, maps: NDArray[np.float64], frames: Frames) -> Masks:
    """The silhouettes in images that were scaled and shifted, by their nearest pixels.

    Args:
        maps: as ``step_nearer`` gives them
        frames: of the new images, outside of which nothing is seen
    """
    height, width = masks.shape[1:]
    v, u = np.mgrid[:height, :width] + 0.5
    out = np.zeros_like(masks)
    for view, (seen, way) in enumerate(zip(masks, np.linalg.inv(maps), strict=True)):
        column = np.floor(way[0, 0] * u + way[0, 2]).astype(int)
        row = np.floor(way[1, 1] * v + way[1, 2]).astype(int)
        there = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        out[view][there] = seen[row[there], column[there]]
    return keep_inside(out, frames)


def close_up(
    masks: Masks, cameras: Cameras, share: float, seed: int = 0, aspect: float = PORTRAIT
) -> tuple[Masks, Cameras, Frames, Positions]:
    """Photographs of a shape, padded into square images, a share of them cut by their frames.

    Arguments are those of ``step_nearer``.
    """
    maps, frames, close = step_nearer(masks, share, seed, aspect)
    nearer = cameras.in_pixels_of(torch.from_numpy(maps), cameras.sizes)
    return look_through(masks, maps, frames), nearer, frames, close


def thin_out(views: int, count: int) -> Positions:
    """The positions of so many of the views, evenly spread."""
    return [i * views // count for i in range(count)]


def keep_inside(masks: Masks, frames: Frames | None) -> Masks:
    """The silhouettes with nothing outside their frames; the whole images if not given."""
    frames = whole_frames(masks) if frames is None else frames
    out = np.zeros_like(masks)
    for inside, seen, (left, top, right, bottom) in zip(out, masks, frames, strict=True):
        inside[top:bottom, left:right] = seen[top:bottom, left:right]
    return out


def _generator(seed: int, kind: str, view: int = -1) -> np.random.Generator:
    """Of random numbers that other damages and other views do not share."""
    return np.random.default_rng([seed, zlib.crc32(kind.encode()), view + 1])


def _set_nearest(
    out: Masks, among: Masks, starts: Masks, count: float, value: bool, seeds: tuple
) -> None:
    """Set the ``count`` pixels of ``among`` that are nearest to one of ``starts``, at random."""
    seed, view, kind = seeds
    rows, columns = np.nonzero(starts)
    if not len(rows):
        return
    at = _generator(seed, kind, view).integers(len(rows))
    pixels = np.argwhere(among)
    distance2 = ((pixels - [rows[at], columns[at]]) ** 2).sum(axis=1)
    row, column = pixels[np.argsort(distance2, kind="stable")[: round(count)]].T
    out[row, column] = value


def _put(masks: Masks, wrong: Sequence[int], others: Masks) -> Masks:
    out = masks.copy()
    out[wrong] = others[wrong]
    return out


def _pose(cameras: Cameras, R: torch.Tensor, centres: torch.Tensor) -> Cameras:
    """The same cameras turned as R says, at these places."""
    return replace(cameras, R=R, t=-(R @ centres.unsqueeze(-1)).squeeze(-1))


def _central_frame(size: int, aspect: float) -> NDArray[np.int64]:
    """The middle of a square that has the aspect, as padding leaves it."""
    width, height = round(size * min(aspect, 1)), round(size / max(aspect, 1))
    left, top = (size - width) // 2, (size - height) // 2
    return np.array([left, top, left + width, top + height])


def _fit(seen: Masks, frame: NDArray[np.int64], rng: np.random.Generator | None) -> np.ndarray:
    """The map of an image [3, 3] that puts the object into a frame, or half out of it by chance."""
    rows, columns = np.nonzero(seen)
    low = np.array([columns.min(), rows.min()])
    high = np.array([columns.max(), rows.max()]) + 1
    sides = frame[2:] - frame[:2]
    scale = min(1.0, float((MARGIN * sides / (high - low)).min()))
    middle, shift = (low + high) / 2, np.zeros(2)
    if rng is not None:
        scale *= rng.uniform(*NEARER)
        axis, sign, off = rng.integers(2), rng.choice([-1, 1]), rng.uniform(*CUT_OFF)
        extent = scale * (high - low)[axis]
        shift[axis] = sign * ((sides[axis] - extent) / 2 + off * extent)
    out = np.diag([scale, scale, 1.0])
    out[:2, 2] = (frame[:2] + frame[2:]) / 2 + shift - scale * middle
    return out
