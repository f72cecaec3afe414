"""The fitted surface, moved to where the photographs agree: hollows that no outline shows."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import trimesh
from scipy.ndimage import binary_dilation

from silmesh.geometry.camera import Cameras
from silmesh.geometry.originals import Originals
from silmesh.geometry.small_images import LARGEST, shrink
from silmesh.progress import Share, untold, within
from silmesh.relief.covering import PUT_BACK, count_seers, cover, strike
from silmesh.relief.depths import (
    Depths,
    cast_rays,
    confirm,
    find_neighbours,
    find_texture,
    sweep,
)
from silmesh.relief.free_space import ENOUGH, Grid, doubt, fuse, measure, settle
from silmesh.relief.sights import Sights, look
from silmesh.relief.surface import (
    STANDINGS,
    extract,
    judge_standing,
    simplify,
)
from silmesh.relief.unseen_space import find_unseen_air

LONGEST = 400  # pixels of the object in the finer of the two sizes that depths are found at
COARSE, FINE = 4, 1  # passes over the rows at each size
# Voxels along the side of a cube that is as large as the box about the mesh, so that what is slim
# or flat has finer ones; at most FINEST along the longest side of the box.
RESOLUTION, FINEST = 144, 224
FIRST = 0.5  # of these for the first surface, of depths at half the size
DOUBTS = 2  # rounds in which depths that others see through are left out
FADES = 2  # most rounds in which views lose their say about what is missing still
AROUND = np.ones((3, 3, 3), bool)  # voxels about a missing one
SEERS = 0.15  # of the views, two at least: what they see is there, though without a depth
VERTICES = 16_000  # of the refined surface, if the mesh has no more
FEW = 0.03  # share of the pixels that see the mesh: fewer depths say too little
DENIED = 0.3  # share of those with texture, of which fewer with a depth are gloss,
MANY = 0.1  # unless this share of all has one: photographs that are kept out judge those

# Why a surface, the second, is not worth going on with, "" if it is: the first is the given mesh as
# the same grid has it.
Doubt = Callable[[trimesh.Trimesh, trimesh.Trimesh], str]


@dataclass(frozen=True)
class Found:
    """What a refinement found in its views, from which another by more views goes on.

    Attributes:
        views: their positions
        scale: of the images it was found in, pixels a pixel of the photographs
        planes: of these images
        bound: signed distance to the mesh, as ``measure`` gives it
    """

    views: Sequence[int]
    scale: float
    planes: Depths
    bound: np.ndarray


@dataclass(frozen=True)
class Relief:
    """A refined surface.

    Attributes:
        verts: [verts, 3] in the cameras' world
        faces: [faces, 3], closed, the outside counterclockwise
        standing: [verts] uint8, what each vertex stands on, a position in ``STANDINGS``
        changed: whether the surface is another than the one that was given
        notes: for JSON: the share of each standing, the depths that were found, seconds, and why
            the surface stays as it is if it does
        found: what it was made of, if it was
    """

    verts: np.ndarray
    faces: np.ndarray
    standing: np.ndarray
    changed: bool
    notes: dict[str, Any]
    found: Found | None = None


def refine(
    mesh: trimesh.Trimesh,
    originals: Originals,
    silhouettes: np.ndarray,
    cameras: Cameras,
    kept: Sequence[int] | None = None,
    seed: int = 0,
    progress: Share = untold,
    known: Found | None = None,
    doubt: Doubt = lambda mesh, surface: "",
) -> Relief:
    """Move a surface to where the photographs agree; where they do not it stays as it is.

    Args:
        mesh: closed, about the origin of the cameras' world and about 1 in size; it bounds the
            object from outside, nearly
        originals: the photographs, with cameras in the same world and order as ``cameras``
        silhouettes: [views, height, width] bool, of the working images, without lenses
        cameras: in pixels of the working images
        kept: positions of the views that are believed; all if not given
        seed: of the random guesses; the same seed gives the same surface
        progress: is told which share is done
        known: planes that were found about the same mesh in some of the views; of these, the ones
            beside other views are improved
        doubt: is shown a first, coarse surface, unless there are such planes
    """
    started = time.monotonic()
    views = list(range(len(cameras)) if kept is None else kept)
    masks, believed = shrink(silhouettes[views], cameras.select(views), LARGEST)
    sights = look(originals, silhouettes, cameras, views, LONGEST, known.scale if known else None)
    search = _Search(mesh, sights, masks, believed, seed, within(progress, 0, 0.9))
    solved = search.go_on(views, known) if known else search.run(doubt)
    surface = mesh
    if not solved.reason:
        surface = simplify(solved.surface, max(VERTICES, len(mesh.vertices)))
    verts, faces = np.asarray(surface.vertices), np.asarray(surface.faces)
    standing = judge_standing(verts, solved.close, search.grid, masks, believed)
    parts = np.bincount(standing, minlength=len(STANDINGS)) / len(standing)
    shares = {name: round(float(part), 4) for name, part in zip(STANDINGS, parts, strict=True)}
    notes = {"changed": not solved.reason, "views": len(views), **solved.notes, **shares}
    notes["seconds"] = round(time.monotonic() - started, 2)
    progress(1.0)
    return Relief(verts, faces, standing, not solved.reason, notes, search.keep(views))


def _choose_resolution(mesh: trimesh.Trimesh) -> int:
    """Voxels along the longest side of the box about a mesh."""
    longest, side = float(mesh.extents.max()), float(np.cbrt(mesh.extents.prod()))
    return round(min(FINEST, RESOLUTION * longest / max(side, 1e-9)))


def _refuse(share: float, of_textured: float) -> str:
    """Why depths on these shares of all pixels, and of those with texture, are too few, if so."""
    if share < FEW:
        return f"photographs agree on {share:.1%} of the object, less than {FEW:.0%}"
    if of_textured < DENIED and share < MANY:
        return (
            f"photographs agree on {of_textured:.0%} of what has texture, less than {DENIED:.0%}:"
            " gloss moves over it"
        )
    return ""


@dataclass(frozen=True)
class Solved:
    """A surface that depths and silhouettes agree on.

    Attributes:
        surface: None if it is thinner than the grid
        close: [grid], weight of the views that found a surface close by
        notes: for JSON
        reason: why there is no surface, "" if there is
    """

    surface: trimesh.Trimesh | None
    close: np.ndarray
    notes: dict[str, Any] = field(default_factory=dict)
    reason: str = ""


class _Search:
    """The way from a mesh, and what views show of it, to a surface; it ends as early as it can.

    Attributes:
        grid: of the surface
    """

    def __init__(
        self,
        mesh: trimesh.Trimesh,
        sights: Sights,
        masks: np.ndarray,
        cameras: Cameras,
        seed: int,
        progress: Share,
    ):
        self._mesh, self._sights, self._outlines = mesh, sights, (masks, cameras)
        self._seed, self._progress = seed, progress
        self.grid = Grid.over(mesh, _choose_resolution(mesh))
        self._planes = self._bound = None
        self._neighbours = find_neighbours(sights)
        self._rays = cast_rays(mesh, sights)
        self._covered = self._rays.front > 0
        self._textured = find_texture(sights) & self._covered

    def run(self, doubt: Doubt) -> Solved:
        """Look for planes in all views."""
        if reason := _refuse(*self._share(self._textured)):
            return self._stop(reason, self._textured)
        half = self._sights.halved()
        coarse = self._look_coarsely(half)
        self._progress(0.4)
        votes = confirm(half, coarse, find_texture(half), self._neighbours)
        grid = Grid.over(self._mesh, round(FIRST * _choose_resolution(self._mesh)))
        bound = measure(self._mesh, grid)
        first = solve(half, coarse, votes, bound, grid, *self._outlines).surface
        if first is not None and (reason := doubt(self._resample(bound, grid), first)):
            return self._stop(reason)
        self._progress(0.5)
        return self._finish(self._look_finely(coarse), measure(self._mesh, self.grid))

    def go_on(self, views: Sequence[int], known: Found) -> Solved:
        """Look for planes in the views in which none are known, and improve those beside them."""
        new = [i for i, view in enumerate(views) if view not in known.views]
        coarse = self._look_coarsely(self._sights.halved(), new)
        self._progress(0.5)
        planes = self._look_finely(coarse, new)
        old = [views.index(view) for view in known.views]
        for at, view in enumerate(old):
            planes.take(view, known.planes, at)
        beside = [view for view in old if np.isin(self._neighbours[view], new).any()]
        again = self._look_finely(planes, beside)
        for view in beside:
            planes.take(view, again, view)
        return self._finish(planes, known.bound)

    def keep(self, views: Sequence[int]) -> Found | None:
        """What was found in these views; None if it came to no planes."""
        if self._planes is None:
            return None
        return Found(views, self._sights.scale, self._planes, self._bound)

    def _look_coarsely(self, half: Sights, only: Sequence[int] | None = None) -> Depths:
        rays = cast_rays(self._mesh, half)
        return sweep(half, rays, self._neighbours, COARSE, self._seed, None, only)

    def _look_finely(self, start: Depths, only: Sequence[int] | None = None) -> Depths:
        near = self._neighbours
        return sweep(self._sights, self._rays, near, FINE, self._seed, start, only)

    def _finish(self, planes: Depths, bound: np.ndarray) -> Solved:
        self._planes, self._bound = planes, bound
        votes = confirm(self._sights, planes, self._textured, self._neighbours)
        self._progress(0.8)
        solved = solve(self._sights, planes, votes, bound, self.grid, *self._outlines)
        if reason := _refuse(*self._share(votes)):
            return self._stop(reason, votes)
        if solved.surface is None:
            return self._stop("the object is thinner than the grid", votes)
        return replace(solved, notes={**self._describe(votes), **solved.notes})

    def _resample(self, bound: np.ndarray, grid: Grid) -> trimesh.Trimesh:
        """The mesh as a grid has it: what ``solve`` makes of it where no depths are found."""
        field = _settle_alone(bound, grid)
        return extract(field, grid) if (field > 0).any() else self._mesh

    def _stop(self, reason: str, counted: np.ndarray | None = None) -> Solved:
        nowhere = np.zeros(self.grid.shape, np.float32)
        found = {} if counted is None else self._describe(counted)
        return Solved(None, nowhere, {**found, "reason": reason}, reason)

    def _describe(self, counted: np.ndarray) -> dict[str, float]:
        share, of_textured = self._share(counted)
        return {"depths": round(share, 4), "of_textured": round(of_textured, 4)}

    def _share(self, counted: np.ndarray) -> tuple[float, float]:
        """What is counted, of the pixels that see the mesh and of those that show texture."""
        count = int((counted > 0).sum())
        return tuple(
            count / max(1, int(pixels.sum())) for pixels in (self._covered, self._textured)
        )


def solve(
    sights: Sights,
    found: Depths,
    votes: np.ndarray,
    bound: np.ndarray,
    grid: Grid,
    masks: np.ndarray,
    cameras: Cameras,
) -> Solved:
    """Fuse the depths that do not contradict the silhouettes.

    Depths that see through pixels are struck which the mesh, as the grid has it, fills. About what
    is missing then the mesh alone has a say; what is missing still is put back. Deep in a hollow,
    where no view looks in, the surface is as small as it can be.
    """
    _, filled = cover(_settle_alone(bound, grid), bound, grid, masks, cameras)
    doubted = 0
    for _ in range(DOUBTS):
        weight, _, close = fuse(sights, found, votes, bound, grid)
        doubted += doubt(votes, found, sights, weight, close, grid)
    outlines = bound, grid, filled, cameras
    weight, mean, close = fuse(sights, found, votes, bound, grid)
    solid, missing = _fill(weight, mean, *outlines)
    struck = strike(votes, found, sights, missing, grid) if missing.any() else 0
    if struck:
        weight, mean, close = fuse(sights, found, votes, bound, grid)
        solid, missing = _fill(weight, mean, *outlines)
    kept = np.zeros(grid.shape, bool)
    for _ in range(FADES):
        if not missing.any():
            break
        around = binary_dilation(missing, AROUND)
        weight[around] = close[around] = 0
        kept |= around
        solid, missing = _fill(weight, mean, *outlines)
    kept |= count_seers(solid, grid, filled, cameras) >= max(2, SEERS * len(cameras))
    air = find_unseen_air(solid, weight, bound, kept)
    if air.any():
        weight[air], mean[air] = ENOUGH, -1
        solid, missing = _fill(weight, mean, *outlines)
    solid[missing] = np.maximum(solid[missing], PUT_BACK)
    notes = {"doubted": doubted, "struck": struck, "put_back": int(missing.sum())}
    notes["unseen_air"] = int(air.sum())
    return Solved(extract(solid, grid) if (solid > 0).any() else None, close, notes)


def _settle_alone(bound: np.ndarray, grid: Grid) -> np.ndarray:
    """The field where no view says anything: the mesh as the grid has it."""
    nothing = np.zeros_like(bound)
    return settle(bound, nothing, nothing, grid.spacing)


def _fill(
    weight: np.ndarray,
    mean: np.ndarray,
    bound: np.ndarray,
    grid: Grid,
    masks: np.ndarray,
    cameras: Cameras,
) -> tuple[np.ndarray, np.ndarray]:
    """The field by what views say, and which of its samples silhouettes miss: [grid] each."""
    solid = settle(bound, weight, mean, grid.spacing)
    return solid, cover(solid, bound, grid, masks, cameras)[0]
