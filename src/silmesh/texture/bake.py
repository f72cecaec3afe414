"""A texture of a mesh from the photographs at their own size.

What a photograph says of the surface is weighed at the mesh's vertices (``weighing``), exposures
are evened out (``exposure``), views that differ from the others are trusted less
(``robust_colours``). Each texel then takes, by where it lies between the vertices, the mean of all
views' slow colours, and the detail of those that see it best (``bands``, ``choice``). What no view
sees is filled.
"""

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import trimesh
from numba import get_num_threads

from silmesh.ahead import MOST
from silmesh.geometry.originals import Originals
from silmesh.progress import Share, untold
from silmesh.texture.atlas import Atlas, Texels, find_texels, unwrap
from silmesh.texture.choice import share_detail
from silmesh.texture.detail_alignment import Alignment, take_details
from silmesh.texture.exposure import find_gains
from silmesh.texture.filling import fill_vertices
from silmesh.texture.padding import fill_gaps
from silmesh.texture.robust_colours import agree
from silmesh.texture.sampling import add_view
from silmesh.texture.weighing import Points, Seen, Shot, even_out, take_shot, weigh

SMALLEST, LARGEST, STEP = 256, 4096, 256  # sides of pictures whose size is chosen
SURE = 0.02  # of the best weight anywhere: texels with less lean on what is filled in
PARTS = 8  # that texels are cut into for the threads
POINTS = 15_000  # of the surface, by which cameras are refined
# Pixels of the photographs' longer side, at most, of which slow colours are taken and by which
# cameras are refined: both look at means of these pixels.
GLANCE = 1600


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
    chosen = list(range(len(originals)) if kept is None else kept)
    with ThreadPoolExecutor(min(MOST, get_num_threads())) as pool:
        flat = pool.submit(unwrap, np.asarray(mesh.vertices), np.asarray(mesh.faces))
        views, moves = _see(pool, mesh, originals, silhouettes, chosen, refine, progress)
        progress(0.6)
        blend = _Blend(mesh, views)
        atlas = flat.result()
        fine = _choose_size(mesh, atlas, views)
        side = size or fine
        finer = max(1, min(fine, LARGEST) // side)  # a smaller picture is the mean of a fine one
        layers = _Layers(mesh, find_texels(atlas, side * finer))
        ahead = _read_ahead(pool, originals, chosen)
        for done, (view, photograph) in enumerate(zip(views, ahead, strict=True)):
            layers.add(pool, view, photograph, *blend.of(done))
            progress(0.6 + 0.4 * (done + 1) / len(chosen))
    image, seen, shown = layers.paint(side, finer, blend.filled)
    notes = {
        "size": side,
        "charts": atlas.charts,
        "unseen": round(1 - shown, 4),
        "views": len(chosen),
        "gains": blend.describe([originals.cameras.views[i] for i in chosen]),
        "cameras": moves,
        "seconds": round(time.perf_counter() - start, 2),
    }
    verts = np.asarray(mesh.vertices, float)[atlas.origin]
    return Texture(verts, atlas.faces, atlas.uv, atlas.origin, image, seen, notes)


def _see(
    pool: ThreadPoolExecutor,
    mesh: trimesh.Trimesh,
    originals: Originals,
    silhouettes: np.ndarray,
    chosen: Sequence[int],
    refine: bool,
    progress: Share,
) -> tuple[list[Seen], dict[str, Any]]:
    """What each photograph shows of the mesh's vertices, and how the cameras were refined."""
    cameras, moves = originals.cameras.select(chosen), {}
    shots, details = _read_all(pool, mesh, originals, silhouettes, chosen, refine, progress)
    if refine:
        cameras, moves = Alignment(cameras, *details).run()
    corners = Points(mesh, np.asarray(mesh.vertices), np.asarray(mesh.vertex_normals))
    views = pool.map(lambda k: weigh(corners, cameras, k, shots[k]), range(len(chosen)))
    return list(views), moves


def _read_all(
    pool: ThreadPoolExecutor,
    mesh: trimesh.Trimesh,
    originals: Originals,
    silhouettes: np.ndarray,
    chosen: Sequence[int],
    refine: bool,
    progress: Share,
) -> tuple[list[Shot], tuple[np.ndarray, list]]:
    """What is kept of each photograph; points of the mesh, and the details that they compare."""
    cameras, small = originals.cameras.select(chosen), originals.at_most(GLANCE)
    scales = (cameras.sizes / small.cameras.sizes[chosen]).numpy()
    positions, on = trimesh.sample.sample_surface(mesh, POINTS, seed=0)
    points = Points(mesh, np.asarray(positions), mesh.face_normals[on])

    def take(k: int) -> tuple[Shot, Any]:
        scale = scales[k]
        shot, photograph, outline = take_shot(small, chosen[k], silhouettes[chosen[k]], scale)
        if not refine:
            return shot, None
        weights = weigh(points, cameras, k, shot).weights
        return shot, take_details(photograph, outline, weights, scale)

    found = []
    for pair in pool.map(take, range(len(chosen))):
        found.append(pair)
        progress(0.5 * len(found) / len(chosen))
    shots, details = zip(*found, strict=True)
    return list(shots), (points.positions, list(details))


def _read_ahead(
    pool: ThreadPoolExecutor, originals: Originals, chosen: Sequence[int]
) -> Iterator[np.ndarray]:
    """The photographs one after the other, the next one read meanwhile."""
    ahead = pool.submit(originals.read, chosen[0])
    for i in chosen[1:]:
        photograph, ahead = ahead.result(), pool.submit(originals.read, i)
        yield photograph
    yield ahead.result()


class _Blend:
    """How views share the mesh's vertices, and what colours they agree on there.

    Attributes:
        filled: [verts, 3] colours of the vertices, of what no view sees by its surroundings
    """

    def __init__(self, mesh: trimesh.Trimesh, views: Sequence[Seen]):
        weights = even_out([view.weights for view in views])
        colours = np.stack([view.colours for view in views])
        self._gains = find_gains(colours, weights)
        means, self._slow = agree(colours * self._gains[:, None], weights)
        faces = np.asarray(mesh.faces)
        self._detail = share_detail(self._slow, faces)
        self.filled = fill_vertices(means, (self._slow > 0).any(axis=0), faces)

    def of(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """A view's gains [3], and its shares of slow colours and of detail [2, verts]."""
        shares = np.stack([self._slow[k], self._detail[k]])
        return self._gains[k].astype(np.float32), shares.astype(np.float32)

    def describe(self, views: Sequence[str]) -> dict[str, list[float]]:
        """The gains of red, green and blue of each view."""
        return {
            v: [round(float(g), 3) for g in gain]
            for v, gain in zip(views, self._gains, strict=True)
        }


def _choose_size(mesh: trimesh.Trimesh, atlas: Atlas, views: Sequence[Seen]) -> int:
    """The side at which a texel is as large as a pixel of the photograph that shows it best.

    The median over the surface, as texels are of one size.
    """
    verts, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
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

    def __init__(self, mesh: trimesh.Trimesh, texels: Texels):
        self._verts = np.asarray(mesh.vertices, float)
        self._faces = np.asarray(mesh.faces, np.int64)
        self._texels = texels
        self._slow = np.zeros((len(texels.at), 4), np.float32)
        self._fast = np.zeros((len(texels.at), 4), np.float32)

    def add(
        self,
        pool: ThreadPoolExecutor,
        view: Seen,
        photograph: np.ndarray,
        gain: np.ndarray,
        shares: np.ndarray,
    ) -> None:
        """Add one view, as ``sampling.add_view`` says."""
        shot, sight, texels = view.shot, view.sight, self._texels
        numbers = (sight.scale, sight.slack, shot.near, shot.far, *shot.slow.step.tolist())
        maps = sight.depth, sight.margin, photograph, shot.slow.image, gain

        def run(part: slice) -> None:
            on, corners = texels.faces[part], texels.weights[part]
            surface = self._faces, self._verts, shares, sight.P
            sums = self._slow[part], self._fast[part]
            add_view(on, corners, *surface, numbers, *maps, *sums)

        edges = np.linspace(0, len(texels.at), PARTS + 1).astype(int)
        list(pool.map(run, [slice(a, b) for a, b in pairwise(edges)]))

    def paint(
        self, side: int, finer: int, filled: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """The picture, which texels some view shows, and their share of those on the mesh.

        Args:
            side: of the picture
            finer: how many times as many texels a side there are sums of
            filled: [verts, 3] colours that what is hardly seen leans on
        """
        texels, weight = self._texels, self._slow[:, 3:]
        corners = filled.astype(np.float32)[self._faces[texels.faces]]
        under = np.einsum("nk,nkc->nc", texels.weights, corners)
        colours = (self._slow[:, :3] + SURE * under) / (weight + SURE)
        colours += self._fast[:, :3] / np.maximum(self._fast[:, 3:], SURE)
        large = side * finer
        image = np.zeros((large * large, 3), np.float32)
        known, seen = np.zeros(large * large, bool), np.zeros(large * large, bool)
        image[texels.at], known[texels.at], seen[texels.at] = colours, True, weight[:, 0] > 0
        padded = fill_gaps(image.reshape(large, large, 3), known.reshape(large, large))
        blocks = padded.reshape(side, finer, side, finer, 3).mean(axis=(1, 3))
        picture = blocks.round().clip(0, 255).astype(np.uint8)
        shown = seen.reshape(side, finer, side, finer).any(axis=(1, 3))
        return picture, shown, float((weight > 0).mean())
