"""A texture of a mesh from the photographs at their own size.

What a photograph says of the surface is weighed at the mesh's vertices, and of each texel by where
it lies between them:

    w = cos^SQUARE (normal, ray) f(d) s^2 / (1 + (r / SCALE)^2)

f rises from the outline inwards over the distance d, s is pixels a length on the surface, and r how
far the view's colour is from the mean of all, found anew ROUNDS times from their median on:
highlights move over the surface, paint does not. Slow colours are that mean, detail the best views'
(``bands``, ``choice``); exposures are evened out first (``exposure``). What no view sees is filled.
"""

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import trimesh
from numba import njit

from silmesh.geometry.camera import Cameras
from silmesh.geometry.originals import Originals
from silmesh.progress import Share, untold
from silmesh.texture.alignment import Alignment, take_details
from silmesh.texture.atlas import Atlas, Texels, find_texels, unwrap
from silmesh.texture.bands import Slow, take_slow
from silmesh.texture.choice import share_detail
from silmesh.texture.exposure import find_gains
from silmesh.texture.filling import fill_vertices
from silmesh.texture.padding import fill_gaps
from silmesh.texture.sampling import sample, sample_all
from silmesh.texture.visibility import Sight, look, measure

SQUARE = 3
ERODE, FEATHER = 1.0, 4.0  # pixels of the working image, from the outline inwards
FAINT = 1e-3  # f where all is near an outline
SCALE = 25.0  # of 255
ROUNDS = 5
SMALLEST, LARGEST, STEP = 256, 4096, 256  # sides of pictures
SURE = 0.02  # of the best weight anywhere: texels with less lean on what is filled in
THREADS = 2
POINTS = 15_000  # of the surface, by which cameras are refined


@dataclass(frozen=True)
class Texture:
    """A mesh with a picture laid on it.

    Attributes:
        verts: [verts, 3] float64, those of the mesh, some several times, where charts end
        faces: [faces, 3] int64, in the order of the mesh's
        uv: [verts, 2] float32 in 0..1, the origin at the picture's lower left
        origin: [verts] int64, the vertex of the mesh that each is
        image: [size, size, 3] uint8, sRGB
        seen: [size, size] bool, texels that some photograph shows; False between charts
        notes: of what was done, for JSON
    """

    verts: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    origin: np.ndarray
    image: np.ndarray
    seen: np.ndarray
    notes: dict[str, Any]


@dataclass(frozen=True)
class _View:
    """One photograph as the surface needs it.

    Attributes:
        index: of the photograph
        sight: what its camera sees of the mesh
        slow: its slow band
        near, far: distances to an outline, in pixels, between which f rises
        colours: [verts, 3] slow colours at the mesh's vertices
        weights: [verts], without r
    """

    index: int
    sight: Sight
    slow: Slow
    near: float
    far: float
    colours: np.ndarray
    weights: np.ndarray


def bake(
    mesh: trimesh.Trimesh,
    originals: Originals,
    silhouettes: np.ndarray,
    size: int | None = None,
    kept: Sequence[int] | None = None,
    progress: Share = untold,
    refine: bool = True,
) -> Texture:
    """Lay the photographs on a mesh.

    Args:
        mesh: the outside counterclockwise, in the cameras' world
        originals: the photographs and their cameras
        silhouettes: [views, size, size] bool, of the working images
        size: side of the picture in texels; chosen by the photographs' resolution if not given
        kept: the views that are used; all if not given
        progress: is told which share is done
        refine: whether cameras are refined where the photographs agree better for it

    Raises:
        InputError: a photograph can no longer be read
    """
    start = time.perf_counter()
    verts, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
    chosen = list(range(len(originals)) if kept is None else kept)
    with ThreadPoolExecutor(THREADS) as pool:
        flat = pool.submit(unwrap, verts, faces)
        cameras, moves = originals.cameras.select(chosen), {}
        if refine:
            cameras, moves = _refine(pool, mesh, originals, silhouettes, chosen)
        views = _look_all(pool, mesh, originals, cameras, silhouettes, chosen, progress)
        atlas = flat.result()
        weights = np.stack([view.weights for view in views])
        colours = np.stack([view.colours for view in views])
        gains = find_gains(colours, weights)
        colours *= gains[:, None]
        means, trust = _agree(colours, weights)
        side = size or _choose_size(verts, faces, atlas, views)
        texels = find_texels(atlas, side)
        shares = share_detail(trust, faces)
        layers, done = _Layers(verts, faces, texels), 0
        for view, gain, slow, fast, photo in zip(
            views, gains, trust, shares, _read_all(pool, originals, views), strict=True
        ):
            layers.add(pool, view, photo, gain, slow, fast)
            progress(0.5 + 0.45 * (done := done + 1) / len(views))
    filled = fill_vertices(means, trust.sum(axis=0) > 0, faces)
    return _finish(layers, atlas, verts, filled, side, gains, originals, chosen, start, moves)


def _refine(
    pool: ThreadPoolExecutor,
    mesh: trimesh.Trimesh,
    originals: Originals,
    silhouettes: np.ndarray,
    chosen: Sequence[int],
) -> tuple[Cameras, dict[str, Any]]:
    """The cameras of the chosen views, refined by the photographs, and what is to be said of it."""
    points, on = trimesh.sample.sample_surface(mesh, POINTS, seed=0)
    lenses = _Lens(mesh, points, mesh.face_normals[on])
    cameras = originals.cameras.select(chosen)

    def take(k: int) -> Any:
        photograph = originals.read(chosen[k])
        outline = originals.enlarge(chosen[k], silhouettes[chosen[k]])
        _, _, weights = lenses.weigh(cameras, k, outline, silhouettes.shape[-1])
        return take_details(photograph, outline, weights)

    return Alignment(cameras, points, list(pool.map(take, range(len(chosen))))).run()


@dataclass(frozen=True)
class _Lens:
    """Points of a mesh that views are weighed at, with their normals [points, 3]."""

    mesh: trimesh.Trimesh
    points: np.ndarray
    normals: np.ndarray

    def weigh(
        self, cameras: Cameras, k: int, outline: np.ndarray, working: int
    ) -> tuple[Sight, np.ndarray, np.ndarray]:
        """How well one camera sees the points: its sight, their pixels and their weights."""
        P, eye = cameras.projections[k].numpy(), cameras.centres[k].numpy()
        size = tuple(cameras.sizes[k].tolist())
        verts, faces = np.asarray(self.mesh.vertices), np.asarray(self.mesh.faces, np.int64)
        sight = look(verts, faces, P, size, outline)
        pixels, cosine, margin = measure(sight, eye, self.points, self.normals)
        near, far = find_edges(size, working)
        rise = np.where(margin > near, ((margin - near) / (far - near)).clip(FAINT, 1), 0)
        depths = self.points @ P[2, :3] + P[2, 3]
        squared_focal = float(np.linalg.det(cameras.K[k].numpy()))
        return sight, pixels, cosine**SQUARE * rise * squared_focal / depths**2


def find_edges(size: tuple[int, int], working: int) -> tuple[float, float]:
    """Distances to an outline, in pixels of a photograph, between which f rises."""
    pixel = max(size) / working
    return ERODE * pixel, (ERODE + FEATHER) * pixel


def _look_all(
    pool: ThreadPoolExecutor,
    mesh: trimesh.Trimesh,
    originals: Originals,
    cameras: Cameras,
    silhouettes: np.ndarray,
    chosen: Sequence[int],
    progress: Share,
) -> list[_View]:
    lenses = _Lens(mesh, np.asarray(mesh.vertices, float), np.asarray(mesh.vertex_normals))

    def see(k: int) -> _View:
        photograph = originals.read(chosen[k])
        outline = originals.enlarge(chosen[k], silhouettes[chosen[k]])
        sight, pixels, weights = lenses.weigh(cameras, k, outline, silhouettes.shape[-1])
        slow = take_slow(photograph, outline)
        edges = find_edges(tuple(cameras.sizes[k].tolist()), silhouettes.shape[-1])
        colours = sample_all(slow.image, pixels / slow.step)
        return _View(chosen[k], sight, slow, *edges, colours, weights)

    found = []
    for view in pool.map(see, range(len(chosen))):
        found.append(view)
        progress(0.5 * len(found) / len(chosen))
    scale = max(float(np.quantile(np.stack([v.weights for v in found]), 0.99)), 1e-12)
    for view in found:
        view.weights[:] /= scale
    return found


def _read_all(
    pool: ThreadPoolExecutor, originals: Originals, views: Sequence[_View]
) -> Iterator[np.ndarray]:
    """The photographs one after the other, the next one read meanwhile."""
    ahead = pool.submit(originals.read, views[0].index)
    for view in views[1:]:
        photograph, ahead = ahead.result(), pool.submit(originals.read, view.index)
        yield photograph
    yield ahead.result()


def _agree(colours: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Robust means over the views [verts, 3], and the weights that led to them [views, verts]."""
    mean = _take_medians(colours, np.sqrt(weights))
    for _ in range(ROUNDS):
        apart = np.linalg.norm(colours - mean, axis=2)
        trust = weights / (1 + (apart / SCALE) ** 2)
        total = np.maximum(trust.sum(axis=0), 1e-12)
        mean = np.einsum("vn,vnc->nc", trust, colours) / total[:, None]
    return mean, trust


def _take_medians(colours: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted medians over the views of each channel: [verts, 3]."""
    found = np.empty(colours.shape[1:])
    for channel in range(3):
        values = colours[..., channel]
        order = values.argsort(axis=0)
        below = np.take_along_axis(weights, order, axis=0).cumsum(axis=0)
        middle = (below >= below[-1] / 2).argmax(axis=0)
        at = np.take_along_axis(order, middle[None], axis=0)
        found[:, channel] = np.take_along_axis(values, at, axis=0)[0]
    return found


def _choose_size(verts: np.ndarray, faces: np.ndarray, atlas: Atlas, views: Sequence[_View]) -> int:
    """The side at which a texel is as large as a pixel of the photograph that shows it best."""
    best = np.zeros(len(faces))
    for view in views:
        seen = verts @ view.sight.P[:, :3].T + view.sight.P[:, 3]
        points = seen[:, :2] / seen[:, 2:]
        shown = (view.weights[faces] > 0).all(axis=1)
        best = np.maximum(best, np.where(shown, _measure_areas(points, faces), 0))
    flat = _measure_areas(atlas.uv.astype(float), atlas.faces)
    usable = (best > 0) & (flat > 0)
    if not usable.any():
        return SMALLEST
    ratio = best[usable] / flat[usable]
    order = np.argsort(ratio)
    share = np.cumsum(flat[usable][order])
    side = np.sqrt(ratio[order][np.searchsorted(share, share[-1] / 2)])
    return int(np.clip(STEP * np.ceil(side / STEP), SMALLEST, LARGEST))


def _measure_areas(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b = points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    return np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2


class _Layers:
    """Sums over the views at each texel: of slow colours, of detail, and of their weights."""

    def __init__(self, verts: np.ndarray, faces: np.ndarray, texels: Texels):
        self.verts, self.faces, self.texels = verts, faces, texels
        self.slow = np.zeros((len(texels.at), 4), np.float32)
        self.fast = np.zeros((len(texels.at), 4), np.float32)

    def add(
        self,
        pool: ThreadPoolExecutor,
        view: _View,
        photograph: np.ndarray,
        gain: np.ndarray,
        slow: np.ndarray,
        fast: np.ndarray,
    ) -> None:
        """Add one view, whose slow colours and detail have weights at the vertices: [verts]."""
        sight = view.sight

        def run(part: slice) -> None:
            _add(
                self.texels.faces[part],
                self.texels.weights[part],
                self.faces,
                self.verts,
                slow.astype(np.float32),
                fast.astype(np.float32),
                sight.P,
                (sight.scale, sight.slack, view.near, view.far),
                sight.depth,
                sight.margin,
                photograph,
                view.slow.image,
                view.slow.step,
                gain.astype(np.float32),
                self.slow[part],
                self.fast[part],
            )

        edges = np.linspace(0, len(self.texels.at), 4 * THREADS + 1).astype(int)
        list(pool.map(run, [slice(a, b) for a, b in pairwise(edges)]))


def _finish(layers, atlas, verts, filled, side, gains, originals, chosen, start, moves) -> Texture:
    texels = layers.texels
    weight = layers.slow[:, 3:]
    under = np.einsum(
        "nk,nkc->nc", texels.weights, filled[layers.faces[texels.faces]].astype(np.float32)
    )
    colours = (layers.slow[:, :3] + SURE * under) / (weight + SURE)
    colours += layers.fast[:, :3] / np.maximum(layers.fast[:, 3:], SURE)
    image, seen = np.zeros((side * side, 3), np.float32), np.zeros(side * side, bool)
    known = np.zeros(side * side, bool)
    image[texels.at], known[texels.at], seen[texels.at] = colours, True, weight[:, 0] > 0
    padded = fill_gaps(image.reshape(side, side, 3), known.reshape(side, side))
    return Texture(
        verts[atlas.origin],
        atlas.faces,
        atlas.uv,
        atlas.origin,
        padded.round().clip(0, 255).astype(np.uint8),
        seen.reshape(side, side),
        {
            "size": side,
            "charts": atlas.charts,
            "unseen": round(1 - float((weight > 0).mean()), 4),
            "views": len(chosen),
            "gains": {
                originals.cameras.views[i]: [round(float(g), 3) for g in gain]
                for i, gain in zip(chosen, gains, strict=True)
            },
            "cameras": moves,
            "seconds": round(time.perf_counter() - start, 2),
        },
    )


@njit(nogil=True, error_model="numpy", fastmath=True)
def _add(
    on, corners, faces, verts, slow, fast, P, numbers,
    depth, margin, photograph, low, step, gain, slow_out, fast_out,
):  # fmt: skip
    scale, slack, near, far = numbers
    height, width = depth.shape
    fine, coarse = np.empty(3), np.empty(3)
    for i in range(len(on)):
        a, b, c = faces[on[i]]
        u, v, w = corners[i]
        weight = u * slow[a] + v * slow[b] + w * slow[c]
        if weight <= 0:
            continue
        detail = u * fast[a] + v * fast[b] + w * fast[c]
        X = u * verts[a, 0] + v * verts[b, 0] + w * verts[c, 0]
        Y = u * verts[a, 1] + v * verts[b, 1] + w * verts[c, 1]
        Z = u * verts[a, 2] + v * verts[b, 2] + w * verts[c, 2]
        z = P[2, 0] * X + P[2, 1] * Y + P[2, 2] * Z + P[2, 3]
        x = (P[0, 0] * X + P[0, 1] * Y + P[0, 2] * Z + P[0, 3]) / z
        y = (P[1, 0] * X + P[1, 1] * Y + P[1, 2] * Z + P[1, 3]) / z
        row, column = int(np.floor(y * scale)), int(np.floor(x * scale))
        if not (0 <= row < height and 0 <= column < width) or z > depth[row, column] + slack:
            continue
        rise = min(1.0, (margin[row, column] / scale - near) / (far - near))
        if rise <= 0:
            continue
        sample(low, x / step, y / step, coarse)
        weight *= rise
        slow_out[i, 3] += weight
        for k in range(3):
            slow_out[i, k] += weight * gain[k] * coarse[k]
        if detail > 0:
            detail *= rise
            sample(photograph, x, y, fine)
            fast_out[i, 3] += detail
            for k in range(3):
                fast_out[i, k] += detail * gain[k] * (fine[k] - coarse[k])
