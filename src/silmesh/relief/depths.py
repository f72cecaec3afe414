"""Depths that photographs agree on, by PatchMatch stereo on slanted planes.

Each pixel of a view holds a plane (depth and normal), which is scored by how well the neighbouring
views agree with it: the mean of the BEST greatest of their normalised cross-correlations.
The first plane is the mesh's own or the best of a few random ones; then good planes spread from
pixel to pixel, over the rows and back, and are tried a little changed (Bleyer, Rhemann and Rother
2011; Galliani, Lasinger and Schindler 2015). A depth lies on the ray between where the mesh is
entered and where it is left. It counts where several other views found it too, or all that see
that place: deep in a hollow few do. A view does not see it if its own depth there is nearer.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numba import njit
from scipy.ndimage import maximum_filter

from silmesh.relief.ncc import FLAT, OPTIONS, RADIUS, carry, correlate, find_detail, gather
from silmesh.relief.sights import Sights

NEIGHBOURS = 6  # views that a view is compared with
ANGLES = 5.0, 40.0  # degrees between lines of sight: closer ones tell no depth, wider ones no pixel
BEST_ANGLE = 15.0
BEST = 2  # views whose agreement scores a plane: deep in a hollow hardly more see a place
RANDOM = 4  # planes that a pixel first tries beside the mesh's
STEEPEST = 0.17  # cosine of the greatest angle between a plane's normal and its ray
MARGIN = 0.01  # world units: so far before the mesh the surface may be
SURE = 0.985  # cross-correlation from which a plane is not changed at random any more
ALIKE = 0.7  # cross-correlation from which a depth counts
TEXTURE = 3.0  # grey levels: deviation of a window from a slope from which a depth counts
CONFIRMED = 2  # other views that have to find the same depth, if as many see that place
SPECK = 0.01  # share of a silhouette: a smaller patch of depths is an accident
STEP = 3.0  # pixels by which depths of neighbouring pixels of a patch differ at most
NEAR = 1.5  # pixels by which their points may differ
WINDOW = ((2 * RADIUS + 1) ** 2 + 1) // 2  # pixels of a window


class Rays(NamedTuple):
    """Where the rays of each pixel enter and leave the mesh.

    Attributes:
        front, back: [views, height, width] float32, depths along the axis; 0 beside the mesh
        normals: [views, height, width, 3] float32, of the mesh where it is entered, in the view's
            axes
    """

    front: np.ndarray
    back: np.ndarray
    normals: np.ndarray


@dataclass(frozen=True)
class Depths:
    """A plane for every pixel of every view.

    Attributes:
        depth: [views, height, width] float32, 0 where there is none
        normals: [views, height, width, 3] float32, towards the view, in its axes
        score: [views, height, width] float32, cross-correlation, at most 1
    """

    depth: np.ndarray
    normals: np.ndarray
    score: np.ndarray

    def take(self, i: int, other: "Depths", at: int) -> None:
        """Take the i-th view's planes from another's, whose images may be padded by less."""
        height, width = other.depth.shape[1:]
        for part in ("depth", "normals", "score"):
            mine = getattr(self, part)
            mine[i], mine[i, :height, :width] = 0, getattr(other, part)[at]


class _View(NamedTuple):
    """A view, where its rays meet the mesh, and its neighbours, as the kernels take them."""

    image: np.ndarray  # [height, width]
    mask: np.ndarray
    front: np.ndarray
    rear: np.ndarray
    normals: np.ndarray  # [height, width, 3], the mesh's
    back: np.ndarray  # [3, 3], from pixels to rays
    images: np.ndarray  # [all views, height, width]
    views: np.ndarray  # as in ``_Pair``
    A: np.ndarray
    b: np.ndarray


class _Planes(NamedTuple):
    """What is found for one view, [height, width]."""

    depth: np.ndarray
    normals: np.ndarray
    score: np.ndarray


class _Window(NamedTuple):
    """Scratch space: the window about a pixel and the plane that is tried for it."""

    values: np.ndarray  # [WINDOW]
    weights: np.ndarray
    each: np.ndarray  # [neighbours] cross-correlations
    slopes: np.ndarray  # [2, 2]
    normal: np.ndarray  # [3]


class _Pair(NamedTuple):
    """From a view's axes to the pixels of its neighbours."""

    views: np.ndarray  # [neighbours]
    A: np.ndarray  # [neighbours, 3, 3]
    b: np.ndarray  # [neighbours, 3]


def find_neighbours(sights: Sights, count: int = NEIGHBOURS) -> list[np.ndarray]:
    """For each view the positions of those that it is best compared with, best first."""
    towards = sights.centres / np.linalg.norm(sights.centres, axis=1, keepdims=True)
    angles = np.degrees(np.arccos((towards @ towards.T).clip(-1, 1)))
    found = []
    for row in angles:
        order = np.argsort(np.abs(row - BEST_ANGLE), kind="stable")
        fit = (row[order] >= ANGLES[0]) & (row[order] <= ANGLES[1])
        found.append(order[fit][:count])
    return found


def cast_rays(mesh: trimesh.Trimesh, sights: Sights) -> Rays:
    """Meet the mesh by the rays of all pixels, from the cameras and from behind."""
    scene = EmbreeScene()
    TriangleMesh(scene, np.float32(mesh.vertices), np.int32(mesh.faces))
    shape = sights.images.shape
    rays = Rays(np.zeros(shape, "f4"), np.zeros(shape, "f4"), np.zeros((*shape, 3), "f4"))
    far = 2 * float(np.linalg.norm(sights.centres, axis=1).max())
    for i in range(shape[0]):
        rows, columns = np.nonzero(sights.masks[i])
        pixels = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))], axis=1)
        ahead = pixels @ np.linalg.inv(sights.K[i]).T  # depth 1
        ways = np.float32(ahead @ sights.R[i])
        eye = np.tile(np.float32(sights.centres[i]), (len(ways), 1))
        hit = scene.run(eye, ways, output=True)
        behind = scene.run(eye + np.float32(far) * ways, -ways, output=True)
        met = (hit["primID"] >= 0) & (behind["primID"] >= 0)
        at = rows[met], columns[met]
        rays.front[i][at] = hit["tfar"][met]
        rays.back[i][at] = far - behind["tfar"][met]
        normals = mesh.face_normals[hit["primID"][met]] @ sights.R[i].T
        rays.normals[i][at] = normals * -np.sign((normals * ahead[met]).sum(axis=1, keepdims=True))
    return rays


def sweep(
    sights: Sights,
    rays: Rays,
    neighbours: list[np.ndarray],
    passes: int,
    seed: int,
    start: Depths | None = None,
    only: Sequence[int] | None = None,
    done: Callable[[], None] = lambda: None,
) -> Depths:
    """Find the plane of every pixel that the mesh covers.

    Args:
        passes: over all rows, every second from the end
        start: planes of the same images, at this size or half of it, which are then only improved
        only: positions of the views whose planes are looked for; all if not given
        done: is called after each view
    """
    shape = sights.images.shape
    found = Depths(np.zeros(shape, "f4"), np.zeros((*shape, 3), "f4"), np.full(shape, -2, "f4"))

    def search(i: int) -> None:
        if start is not None:
            _enlarge(start, found, i)
        own = sights.images[i], sights.masks[i], rays.front[i], rays.back[i], rays.normals[i]
        pair = _pair(sights, i, neighbours[i])
        view = _View(*own, _inverse(sights.K[i]), sights.images, *pair)
        planes = _Planes(found.depth[i], found.normals[i], found.score[i])
        _search(view, planes, passes, start is None, np.random.default_rng([seed, i]))
        done()

    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        list(pool.map(search, range(shape[0]) if only is None else only))
    return found


def find_texture(sights: Sights) -> np.ndarray:
    """Whether there is enough about a pixel for a depth to count: [views, height, width] bool.

    It lies in a window that shows enough.
    """
    found = np.zeros(sights.masks.shape, np.bool_)
    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        list(pool.map(_find_texture, sights.images, sights.masks, found))
    return maximum_filter(found, (1, 2 * RADIUS + 1, 2 * RADIUS + 1)) & sights.masks


@njit(**OPTIONS)
def _find_texture(image, mask, found):
    values, weights = np.empty(WINDOW, np.float32), np.empty(WINDOW, np.float32)
    for r in range(image.shape[0]):
        for c in range(image.shape[1]):
            if mask[r, c]:
                total, _ = gather(image, mask, c, r, values, weights)
                found[r, c] = find_detail(values, weights, total) >= TEXTURE


def _enlarge(small: Depths, found: Depths, i: int) -> None:
    """Each pixel's plane from an image of half the size, or of the same."""
    height, width = found.depth.shape[1:]
    times = 1 if small.depth.shape == found.depth.shape else 2
    rows = np.minimum(np.arange(height) // times, small.depth.shape[1] - 1)
    columns = np.minimum(np.arange(width) // times, small.depth.shape[2] - 1)
    found.depth[i] = small.depth[i][np.ix_(rows, columns)]
    found.normals[i] = small.normals[i][np.ix_(rows, columns)]


def _inverse(K: np.ndarray) -> np.ndarray:
    """From pixels, whose centres are whole numbers, to rays."""
    return np.linalg.inv(_whole(K))


def _whole(K: np.ndarray) -> np.ndarray:
    """Intrinsics where the centres of pixels are whole numbers."""
    return np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1.0]]) @ K


def _pair(sights: Sights, i: int, views: np.ndarray) -> _Pair:
    A = np.array([_whole(sights.K[j]) @ sights.R[j] @ sights.R[i].T for j in views])
    b = np.array([_whole(sights.K[j]) @ sights.t[j] for j in views]).reshape(-1, 3)
    A = A.reshape(-1, 3, 3)
    return _Pair(np.int64(views), A, b - A @ sights.t[i])


@njit(**OPTIONS)
def _search(view, planes, passes, new, rng):
    """Fill the planes of one view in place; ``new`` if there are none to begin with."""
    height, width = view.image.shape
    window = _Window(
        np.empty(WINDOW, np.float32),
        np.empty(WINDOW, np.float32),
        np.empty(len(view.views), np.float32),
        np.empty((2, 2)),
        np.empty(3),
    )
    for turn in range(passes + 1):
        forth = turn % 2 == 1
        spread = 0.5 ** (turn + (1 if new else 3))
        for p in range(height):
            r = p if forth else height - 1 - p
            for q in range(width):
                c = q if forth else width - 1 - q
                total, deviation = np.float32(0), 0.0
                if view.front[r, c] > 0:
                    total, deviation = gather(
                        view.image, view.mask, c, r, window.values, window.weights
                    )
                if deviation < FLAT or total < WINDOW / 2:
                    planes.depth[r, c] = 0
                elif turn == 0:
                    _begin(view, planes, window, c, r, total, deviation, new, rng)
                else:
                    step = -1 if forth else 1
                    _spread(view, planes, window, c, r, total, deviation, step)
                    _shake(view, planes, window, c, r, total, deviation, spread, rng)


@njit(**OPTIONS)
def _begin(view, planes, window, c, r, total, deviation, new, rng):
    """Give a pixel the best of the mesh's plane and random ones, or score the one that it has."""
    low, high = view.front[r, c] - MARGIN, np.float64(view.rear[r, c])
    n = window.normal
    if not new:
        z = np.float64(planes.depth[r, c])
        if z > 0:
            n[:] = planes.normals[r, c]
            _try(view, planes, window, c, r, min(max(z, low), high), total, deviation)
        return
    n[:] = view.normals[r, c]
    _try(view, planes, window, c, r, np.float64(view.front[r, c]), total, deviation)
    for _ in range(RANDOM):
        z = low + (high - low) * rng.random()
        for axis in range(3):
            n[axis] = rng.normal()
        _try(view, planes, window, c, r, z, total, deviation)


@njit(**OPTIONS)
def _spread(view, planes, window, c, r, total, deviation, step):
    """Try the planes of the two neighbours of a pixel that were visited before it."""
    height, width = view.image.shape
    low, high = view.front[r, c] - MARGIN, view.rear[r, c]
    n = window.normal
    x, y = _ray(view.back, c, r)
    for k in range(2):
        i, j = (r + step, c) if k else (r, c + step)
        if not (0 <= i < height and 0 <= j < width) or planes.depth[i, j] <= 0:
            continue
        n[:] = planes.normals[i, j]
        there_x, there_y = _ray(view.back, j, i)
        facing = n[0] * x + n[1] * y + n[2]
        if facing < -1e-3:
            z = planes.depth[i, j] * (n[0] * there_x + n[1] * there_y + n[2]) / facing
            if low <= z <= high:
                _try(view, planes, window, c, r, z, total, deviation)


@njit(**OPTIONS)
def _shake(view, planes, window, c, r, total, deviation, spread, rng):
    """Try the plane of a pixel a little changed, by this share of what is possible and less."""
    low, high = view.front[r, c] - MARGIN, view.rear[r, c]
    for k in range(2):
        if planes.depth[r, c] <= 0 or planes.score[r, c] > SURE:
            return
        share = spread * (1.0 if k == 0 else 0.25)
        z = planes.depth[r, c] + share * (high - low) * (2 * rng.random() - 1)
        for axis in range(3):
            window.normal[axis] = planes.normals[r, c, axis] + share * 2 * rng.normal()
        if low <= z <= high:
            _try(view, planes, window, c, r, z, total, deviation)


@njit(**OPTIONS)
def _ray(back, c, r):
    """The ray of a pixel at depth 1: x and y."""
    return back[0, 0] * c + back[0, 1] * r + back[0, 2], back[1, 1] * r + back[1, 2]


@njit(**OPTIONS)
def _face(n, x, y):
    """Turn a normal towards the view, at most so far from the ray that its plane is seen."""
    length = np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2) + 1e-12
    ray = np.sqrt(x * x + y * y + 1)
    facing = (n[0] * x + n[1] * y + n[2]) / (length * ray)
    sign = -1.0 if facing > 0 else 1.0
    for axis in range(3):
        n[axis] *= sign / length
    facing = -abs(facing)
    if facing > -STEEPEST:  # bend it towards the eye
        more = (STEEPEST + 0.02 + facing) / ray
        n[0] -= more * x
        n[1] -= more * y
        n[2] -= more
        length = np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
        for axis in range(3):
            n[axis] /= length


@njit(**OPTIONS)
def _try(view, planes, window, c, r, z, total, deviation):
    """Take the window's plane for a pixel if the neighbours agree more with it than with its own.

    It ends early where the views that are left could not make it better.
    """
    x, y = _ray(view.back, c, r)
    _face(window.normal, x, y)
    count, views, each = 0, len(view.views), window.each
    du, dv = window.slopes
    for k in range(views):
        u, v = carry(view.back, view.A[k], view.b[k], c, r, z, window.normal, du, dv)
        if not u >= 0:
            continue
        other = view.images[view.views[k]]
        alike = correlate(window.values, window.weights, total, deviation, other, u, v, du, dv)
        at = count  # in falling order
        while at and each[at - 1] < alike:
            each[at] = each[at - 1]
            at -= 1
        each[at] = alike
        count += 1
        ahead = min(BEST, views - 1 - k)
        most = np.float32(ahead)  # if all of them agreed fully
        for at in range(min(BEST - ahead, count)):
            most += each[at]
        if most <= BEST * planes.score[r, c]:
            return
    if count < BEST:
        return
    mean = 0.0
    for k in range(BEST):
        mean += each[k]
    mean /= BEST
    if mean > planes.score[r, c]:
        planes.score[r, c] = mean
        planes.depth[r, c] = z
        planes.normals[r, c, :] = window.normal


def confirm(
    sights: Sights, found: Depths, textured: np.ndarray, neighbours: list[np.ndarray]
) -> np.ndarray:
    """How many other views found the same point, for each depth that counts: [views, h, w] uint8.

    It is 0 where the photographs are hardly alike, where they show too little (``textured`` is as
    ``find_texture`` gives it), or where fewer than CONFIRMED other views agree, unless all agree
    that may see the point.
    """
    votes = np.zeros(found.depth.shape, np.uint8)

    def judge(i: int) -> None:
        pair = _pair(sights, i, neighbours[i])
        given = found.depth, found.score, textured[i]
        _confirm(*given, i, _inverse(sights.K[i]), pair, votes[i])
        least = int(SPECK * sights.masks[i].sum())
        _drop_specks(votes[i], found.depth[i], STEP * np.linalg.inv(sights.K[i])[0, 0], least)

    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        list(pool.map(judge, range(len(votes))))
    return votes


@njit(**OPTIONS)
def _confirm(depths, scores, textured, view, back, pair, votes):
    height, width = votes.shape
    for r in range(height):
        for c in range(width):
            z = depths[view, r, c]
            if z <= 0 or scores[view, r, c] < ALIKE or not textured[r, c]:
                continue
            x = (back[0, 0] * c + back[0, 1] * r + back[0, 2]) * z
            y = (back[1, 1] * r + back[1, 2]) * z
            near = 2 * NEAR * back[0, 0] * z  # twice as far as across
            count = seers = 0
            for k in range(len(pair.views)):
                A, b = pair.A[k], pair.b[k]
                p2 = A[2, 0] * x + A[2, 1] * y + A[2, 2] * z + b[2]
                if p2 <= 0:
                    continue
                u = (A[0, 0] * x + A[0, 1] * y + A[0, 2] * z + b[0]) / p2
                v = (A[1, 0] * x + A[1, 1] * y + A[1, 2] * z + b[1]) / p2
                i, j = int(v + 0.5), int(u + 0.5)
                if not (0 <= i < height and 0 <= j < width):
                    continue
                other = depths[pair.views[k], i, j]
                believed = other > 0 and scores[pair.views[k], i, j] >= ALIKE
                if believed and other <= p2 - near:
                    continue  # the place is hidden
                seers += 1
                if believed and other <= p2 + near:
                    count += 1
            if count >= CONFIRMED or (0 < count == seers):
                votes[r, c] = count


@njit(**OPTIONS)
def _drop_specks(votes, depth, step, least):
    """Take the votes of patches [height, width] of fewer pixels than ``least``, in place.

    Args:
        step: by which neighbours' depths may differ, of the depth
    """
    height, width = votes.shape
    seen = np.zeros(votes.shape, np.bool_)
    queue = np.empty((height * width, 2), np.int64)
    for r in range(height):
        for c in range(width):
            if seen[r, c] or not votes[r, c]:
                continue
            queue[0] = r, c
            seen[r, c] = True
            at, end = 0, 1
            while at < end:
                i, j = queue[at]
                at += 1
                for m in range(4):
                    k, n = i + (1, -1, 0, 0)[m], j + (0, 0, 1, -1)[m]
                    if not (0 <= k < height and 0 <= n < width) or seen[k, n]:
                        continue
                    if votes[k, n] and abs(depth[k, n] - depth[i, j]) < step * depth[i, j]:
                        seen[k, n] = True
                        queue[end] = k, n
                        end += 1
            if end < least:
                for m in range(end):
                    votes[queue[m, 0], queue[m, 1]] = 0
