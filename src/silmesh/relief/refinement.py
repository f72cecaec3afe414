"""The fitted surface, moved to where the photographs agree: hollows that no outline shows."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import trimesh
from scipy.ndimage import binary_erosion

from silmesh.geometry.camera import Cameras
from silmesh.geometry.originals import Originals
from silmesh.progress import Share, untold, within
from silmesh.relief.covering import PUT_BACK, cover, strike
from silmesh.relief.depths import (
    Depths,
    Rays,
    cast_rays,
    confirm,
    find_neighbours,
    find_texture,
    sweep,
)
from silmesh.relief.free_space import Grid, doubt, fuse, measure, settle
from silmesh.relief.rims import match_rims
from silmesh.relief.sights import Sights, look
from silmesh.relief.surface import (
    STANDINGS,
    extract,
    judge_standing,
    simplify,
)

LONGEST = 400  # pixels of the object in the finer of the two sizes that depths are found at
COARSE, FINE = 4, 1  # passes over the rows at each size
RESOLUTION = 144  # voxels along the longest side
DOUBTS = 2  # rounds in which depths that others see through are left out
STRIKES = 4  # most rounds in which depths that contradict silhouettes are struck
VERTICES = 16_000  # of the refined surface, if the mesh has no more
FEW = 0.03  # share of the pixels that see the mesh: fewer depths say too little
DENIED = 0.3  # share of those with texture, of which fewer with a depth are gloss,
MANY = 0.1  # unless this share of all has one: photographs that are kept out judge those
INNER = 2  # pixels within a silhouette from which on nothing may be missing


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
    """

    verts: np.ndarray
    faces: np.ndarray
    standing: np.ndarray
    changed: bool
    notes: dict[str, Any]


def refine(
    mesh: trimesh.Trimesh,
    originals: Originals,
    silhouettes: np.ndarray,
    cameras: Cameras,
    kept: Sequence[int] | None = None,
    seed: int = 0,
    progress: Share = untold,
) -> Relief:
    """Move a surface to where the photographs agree; where they do not it stays as it is.

    Args:
        mesh: closed, in the world of the cameras; it bounds the object from outside
        originals: the photographs, with cameras in the same world and order as ``cameras``
        silhouettes: [views, height, width] bool, of the working images, without lenses
        cameras: in pixels of the working images
        kept: positions of the views that are believed; all if not given
        seed: of the random guesses; the same seed gives the same surface
        progress: is told which share is done
    """
    started = time.monotonic()
    views = list(range(len(cameras)) if kept is None else kept)
    masks, believed = silhouettes[views], cameras.select(views)
    sights = look(originals, silhouettes, cameras, views, LONGEST)
    found, votes, rays = find_depths(mesh, sights, seed, within(progress, 0, 0.8))
    grid = Grid.over(mesh, RESOLUTION)
    solved = solve(sights, found, votes, measure(mesh, grid), grid, masks, believed)
    progress(0.9)
    covered = rays.front > 0
    depths, textured = (votes > 0).sum(), (find_texture(sights) & covered).sum()
    shares = float(depths / max(1, covered.sum())), float(depths / max(1, textured))
    thin = "" if solved.surface is not None else "the object is thinner than the grid"
    reason = _refuse(*shares) or thin
    close = np.zeros_like(solved.close) if reason else solved.close
    surface = mesh if reason else _finish(solved.surface, mesh, believed, masks.shape[1:])
    verts, faces = np.asarray(surface.vertices), np.asarray(surface.faces)
    standing = judge_standing(verts, close, grid, masks, believed)
    notes = {"changed": not reason, **({"reason": reason} if reason else {}), "views": len(views)}
    notes |= {"depths": round(shares[0], 4), "of_textured": round(shares[1], 4), **solved.notes}
    parts = np.bincount(standing, minlength=len(STANDINGS)) / len(standing)
    notes |= {name: round(float(part), 4) for name, part in zip(STANDINGS, parts, strict=True)}
    notes["seconds"] = round(time.monotonic() - started, 2)
    progress(1.0)
    return Relief(verts, faces, standing, not reason, notes)


def _finish(
    surface: trimesh.Trimesh, mesh: trimesh.Trimesh, cameras: Cameras, size: tuple[int, int]
) -> trimesh.Trimesh:
    """Fewer vertices, and the rims where the given mesh has them."""
    simple = simplify(surface, max(VERTICES, len(mesh.vertices)))
    return match_rims(simple, mesh, cameras, size)


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


def find_depths(
    mesh: trimesh.Trimesh, sights: Sights, seed: int, progress: Share
) -> tuple[Depths, np.ndarray, Rays]:
    """Depths at half the size and then the whole, the views that confirm each, and the rays."""
    neighbours = find_neighbours(sights)
    half = sights.halved()
    found = sweep(half, cast_rays(mesh, half), neighbours, COARSE, seed)
    progress(0.5)
    rays = cast_rays(mesh, sights)
    found = sweep(sights, rays, neighbours, FINE, seed, found)
    votes = confirm(sights, found, neighbours)
    progress(1.0)
    return found, votes, rays


@dataclass(frozen=True)
class Solved:
    """A surface that depths and silhouettes agree on; None if it is thinner than the grid."""

    surface: trimesh.Trimesh | None
    close: np.ndarray
    notes: dict[str, Any] = field(default_factory=dict)


def solve(
    sights: Sights,
    found: Depths,
    votes: np.ndarray,
    bound: np.ndarray,
    grid: Grid,
    masks: np.ndarray,
    cameras: Cameras,
) -> Solved:
    """Fuse the depths that do not contradict the silhouettes."""
    inner = np.stack([binary_erosion(mask, iterations=INNER) for mask in masks])
    struck = doubted = 0
    for _ in range(DOUBTS):
        weight, _, close = fuse(sights, found, votes, bound, grid)
        doubted += doubt(votes, found, sights, weight, close, grid)
    for _ in range(STRIKES):
        weight, mean, close = fuse(sights, found, votes, bound, grid)
        solid = settle(bound, weight, mean)
        missing = cover(solid, bound, grid, inner, cameras)
        gone = strike(votes, found, sights, missing, grid) if missing.any() else 0
        struck += gone
        if not gone:
            break
    missing = cover(solid, bound, grid, masks, cameras)
    solid[missing] = np.maximum(solid[missing], PUT_BACK)
    notes = {"doubted": doubted, "struck": struck, "put_back": int(missing.sum())}
    return Solved(extract(solid, grid) if (solid > 0).any() else None, close, notes)
