"""Depths that photographs agree on, by PatchMatch stereo on slanted planes.

Each pixel of a view holds a plane (depth and normal), which is scored by how well the neighbouring
views agree with it: one less the mean of the better half of their normalised cross-correlations.
The first plane is the mesh's own or the best of a few random ones; then good planes spread from
pixel to pixel, over the rows and back, and are tried a little changed (Bleyer, Rhemann and Rother
2011; Galliani, Lasinger and Schindler 2015). A depth lies on the ray between where the mesh is
entered and where it is left. It counts where several other views found it too.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numba import njit

from silmesh.relief.ncc import FLAT, OPTIONS, RADIUS, carry, correlate, find_detail, gather
from silmesh.relief.sights import Sights

NEIGHBOURS = 6  # views that a view is compared with
ANGLES = 5.0, 40.0  # degrees between lines of sight: closer ones tell no depth, wider ones no pixel
BEST_ANGLE = 15.0
RANDOM = 4  # planes that a pixel first tries beside the mesh's
STEEPEST = 0.17  # cosine of the greatest angle between a plane's normal and its ray
MARGIN = 0.01  # of the object's size: so far before the mesh the surface may be
SURE = 0.985  # cross-correlation from which a plane is not changed at random any more
ALIKE = 0.7  # cross-correlation from which a depth counts
TEXTURE = 3.0  # grey levels: deviation of a window from a slope from which a depth counts
CONFIRMED = 2  # other views that have to find the same depth
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
    done: Callable[[], None] = lambda: None,
) -> Depths:
    """Find the plane of every pixel that the mesh covers.

    Args:
        passes: over all rows, every second from the end
        start: planes of the same images at half the size, which are then only improved
        done: is called after each view
    """
    shape = sights.images.shape
    found = Depths(np.zeros(shape, "f4"), np.zeros((*shape, 3), "f4"), np.full(shape, -1, "f4"))
    margin = np.float32(MARGIN * 2 * 0.5)

    def search(i: int) -> None:
        pair = _pair(sights, i, neighbours[i])
        if start is not None:
            _enlarge(start, found, i)
        back = _inverse(sights.K[i])
        planes = found.depth[i], found.normals[i], found.score[i]
        within = rays.front[i], rays.back[i], rays.normals[i]
        images = sights.images[i], sights.masks[i], sights.images
        _search(*images, *within, *planes, back, pair, passes, start is None, margin, seed + i)
        done()

    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        list(pool.map(search, range(shape[0])))
    return found


def find_texture(sights: Sights) -> np.ndarray:
    """Whether a pixel's window shows enough for a depth to count: [views, height, width] bool."""
    found = np.zeros(sights.masks.shape, np.bool_)
    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        list(pool.map(_find_texture, sights.images, sights.masks, found))
    return found


@njit(**OPTIONS)
def _find_texture(image, mask, found):
    values, weights = np.empty(WINDOW, np.float32), np.empty(WINDOW, np.float32)
    for r in range(image.shape[0]):
        for c in range(image.shape[1]):
            if mask[r, c]:
                total, _ = gather(image, mask, c, r, values, weights)
                found[r, c] = find_detail(values, weights, total) >= TEXTURE


def _enlarge(small: Depths, found: Depths, i: int) -> None:
    """Each pixel's plane from the smaller image."""
    height, width = found.depth.shape[1:]
    rows = np.minimum(np.arange(height) // 2, small.depth.shape[1] - 1)
    columns = np.minimum(np.arange(width) // 2, small.depth.shape[2] - 1)
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
def _search(
    image, mask, images, front, rear, mesh_normals, depth, normals, score, back, pair, passes, new,
    margin, seed,
):  # fmt: skip
    """Fill the planes of one view, [height, width], in place."""
    np.random.seed(seed)
    height, width = image.shape
    values, weights = np.empty(WINDOW, np.float32), np.empty(WINDOW, np.float32)
    each = np.empty(len(pair.views), np.float32)
    scratch = np.empty((2, 2))
    n = np.empty(3)
    for turn in range(passes + 1):
        first = turn == 0
        forth = turn % 2 == 1
        step = -1 if forth else 1
        size = 0.5 ** (turn + 1 if new else turn + 3)
        for p in range(height):
            r = p if forth else height - 1 - p
            for q in range(width):
                c = q if forth else width - 1 - q
                low, high = front[r, c] - margin, rear[r, c]
                if front[r, c] <= 0:
                    depth[r, c] = 0
                    continue
                total, deviation = gather(image, mask, c, r, values, weights)
                if deviation < FLAT or total < WINDOW / 2:
                    depth[r, c] = 0
                    continue
                x = back[0, 0] * c + back[0, 1] * r + back[0, 2]
                y = back[1, 1] * r + back[1, 2]
                if first:
                    if not new and depth[r, c] > 0:
                        n[:] = normals[r, c]
                        z = min(max(np.float64(depth[r, c]), low), high)
                        score[r, c] = -2
                        _try(
                            images,
                            back,
                            pair,
                            c,
                            r,
                            z,
                            n,
                            values,
                            weights,
                            total,
                            deviation,
                            each,
                            scratch,
                            depth,
                            normals,
                            score,
                        )
                    elif not new:
                        score[r, c] = -2
                    if new:
                        score[r, c] = -2
                        n[:] = mesh_normals[r, c]
                        _face(n, x, y)
                        _try(
                            images,
                            back,
                            pair,
                            c,
                            r,
                            np.float64(front[r, c]),
                            n,
                            values,
                            weights,
                            total,
                            deviation,
                            each,
                            scratch,
                            depth,
                            normals,
                            score,
                        )
                        for k in range(RANDOM):
                            z = low + (high - low) * np.random.random()
                            for axis in range(3):
                                n[axis] = np.random.normal()
                            _face(n, x, y)
                            _try(
                                images,
                                back,
                                pair,
                                c,
                                r,
                                z,
                                n,
                                values,
                                weights,
                                total,
                                deviation,
                                each,
                                scratch,
                                depth,
                                normals,
                                score,
                            )
                    continue
                for k in range(2):
                    i, j = (r + step, c) if k else (r, c + step)
                    if not (0 <= i < height and 0 <= j < width) or depth[i, j] <= 0:
                        continue
                    n[:] = normals[i, j]
                    xi = back[0, 0] * j + back[0, 1] * i + back[0, 2]
                    yi = back[1, 1] * i + back[1, 2]
                    facing = n[0] * x + n[1] * y + n[2]
                    if facing >= -1e-3:
                        continue
                    z = depth[i, j] * (n[0] * xi + n[1] * yi + n[2]) / facing
                    if low <= z <= high:
                        _face(n, x, y)
                        _try(
                            images,
                            back,
                            pair,
                            c,
                            r,
                            z,
                            n,
                            values,
                            weights,
                            total,
                            deviation,
                            each,
                            scratch,
                            depth,
                            normals,
                            score,
                        )
                if depth[r, c] <= 0 or score[r, c] > SURE:
                    continue
                for k in range(2):
                    spread = size * (1.0 if k == 0 else 0.25)
                    z = depth[r, c] + spread * (high - low) * (2 * np.random.random() - 1)
                    for axis in range(3):
                        n[axis] = normals[r, c, axis] + spread * 2 * np.random.normal()
                    if low <= z <= high:
                        _face(n, x, y)
                        _try(
                            images,
                            back,
                            pair,
                            c,
                            r,
                            z,
                            n,
                            values,
                            weights,
                            total,
                            deviation,
                            each,
                            scratch,
                            depth,
                            normals,
                            score,
                        )


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
def _try(
    images,
    back,
    pair,
    c,
    r,
    z,
    n,
    values,
    weights,
    total,
    deviation,
    each,
    scratch,
    depth,
    normals,
    score,
):
    """Take a plane for a pixel if the neighbours agree more with it than with its own."""
    count = 0
    views = len(pair.views)
    best = min(views, max(2, (views + 1) // 2))
    for k in range(views):
        u, v = carry(back, pair.A[k], pair.b[k], c, r, z, n, scratch[0], scratch[1])
        if not u >= 0:
            continue
        alike = correlate(
            values, weights, total, deviation, images[pair.views[k]], u, v, scratch[0], scratch[1]
        )
        at = count  # in falling order
        while at and each[at - 1] < alike:
            each[at] = each[at - 1]
            at -= 1
        each[at] = alike
        count += 1
        ahead = min(best, views - 1 - k)  # if all further ones agreed fully
        most = np.float32(ahead)
        for at in range(min(best - ahead, count)):
            most += each[at]
        if most <= best * score[r, c]:
            return
    if count < 2:
        return
    mean = 0.0
    for k in range(min(best, count)):
        mean += each[k]
    mean /= best
    if mean > score[r, c]:
        score[r, c] = mean
        depth[r, c] = z
        normals[r, c, 0], normals[r, c, 1], normals[r, c, 2] = n[0], n[1], n[2]


def confirm(sights: Sights, found: Depths, neighbours: list[np.ndarray]) -> np.ndarray:
    """How many other views found the same point, for each depth that counts: [views, h, w] uint8.

    It is 0 where the photographs are hardly alike, where they show too little, or where fewer than
    CONFIRMED other views agree.
    """
    votes = np.zeros(found.depth.shape, np.uint8)

    def judge(i: int) -> None:
        pair = _pair(sights, i, neighbours[i])
        seen = sights.images[i], sights.masks[i], found.depth, found.score
        _confirm(*seen, i, _inverse(sights.K[i]), pair, votes[i])
        least = int(SPECK * sights.masks[i].sum())
        _drop_specks(votes[i], found.depth[i], STEP * np.linalg.inv(sights.K[i])[0, 0], least)

    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        list(pool.map(judge, range(len(votes))))
    return votes


@njit(**OPTIONS)
def _confirm(image, mask, depths, scores, view, back, pair, votes):
    height, width = image.shape
    values, weights = np.empty(WINDOW, np.float32), np.empty(WINDOW, np.float32)
    for r in range(height):
        for c in range(width):
            z = depths[view, r, c]
            if z <= 0 or scores[view, r, c] < ALIKE:
                continue
            total, _ = gather(image, mask, c, r, values, weights)
            if find_detail(values, weights, total) < TEXTURE:
                continue
            x = (back[0, 0] * c + back[0, 1] * r + back[0, 2]) * z
            y = (back[1, 1] * r + back[1, 2]) * z
            count = 0
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
                if other <= 0 or scores[pair.views[k], i, j] < ALIKE:
                    continue
                if abs(other - p2) < 2 * NEAR * back[0, 0] * z:  # twice as far as across
                    count += 1
            if count >= CONFIRMED:
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
