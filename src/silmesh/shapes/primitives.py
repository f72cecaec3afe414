"""Ellipsoid, cylinder and cube, placed by the silhouettes of all views.

All are superquadrics of half-length 1 (Barr 1981), whose edges are rounded so that they deform
well: x^p + y^p + z^p = 1 is a cube for a large p, (x^2 + z^2)^(p/2) + y^p = 1 a cylinder about y.
The smaller p is, the rounder they are, down to the ellipsoid's 2; the silhouettes choose it.
"""

from collections.abc import Callable, Iterable
from operator import attrgetter
from typing import NamedTuple

import numpy as np
import trimesh

from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import find_whole, known_pixels
from silmesh.geometry.overlap import mean_iou
from silmesh.shapes.downsample import downsample, downsample_frames, render
from silmesh.shapes.ellipsoid import Ellipsoid, find_ellipsoid
from silmesh.shapes.even import even_mesh
from silmesh.shapes.sphere import unit_sphere

POWERS = (8.0, 4.0, 2.5)  # values of p that are tried; the first is taken without silhouettes
ROUNDS = 3  # iterations that match the moments of a shape's silhouettes to the given ones
FINER = 4  # times the wanted vertices, of the fine surface that is remeshed to even triangles
SIZE, VIEWS, VERTICES = 96, 18, 400  # pixels a side, views and vertices of trial placements
TURNS = 6  # rotations of a cube about the upright axis that are tried


def _cylinder(verts: np.ndarray, power: float) -> np.ndarray:
    around = np.linalg.norm(verts[:, [0, 2]], axis=1)
    return (around**power + np.abs(verts[:, 1]) ** power) ** (1 / power)


def _cube(verts: np.ndarray, power: float) -> np.ndarray:
    return (np.abs(verts) ** power).sum(axis=1) ** (1 / power)


class _Candidate(NamedTuple):
    """A primitive where the silhouettes are.

    Attributes:
        iou: with them
        power: of the superquadric
        axes: [3, 3], the directions of its x, y and z
        to_world: [4, 4], from half-length 1 about the origin
    """

    iou: float
    power: float
    axes: np.ndarray
    to_world: np.ndarray


class _Family(NamedTuple):
    """Superquadrics of one kind.

    Attributes:
        level: by what a point is divided to lie on the surface of this power
        powers: to try
    """

    level: Callable[[np.ndarray, float], np.ndarray]
    powers: tuple[float, ...]


PRIMITIVES = {
    "ellipsoid": _Family(_cube, (2.0,)),
    "cylinder": _Family(_cylinder, POWERS),
    "cube": _Family(_cube, POWERS),
}


def unit_primitive(shape: str, vertices: int, power: float | None = None) -> trimesh.Trimesh:
    """A primitive of half-length 1 about the origin, closed and oriented outwards.

    Args:
        shape: a key of ``PRIMITIVES``
        vertices: how many
        power: how sharp its edges are; None for the sharpest that is tried
    """
    mesh, family = unit_sphere(vertices), PRIMITIVES[shape]
    verts = mesh.vertices / family.level(mesh.vertices, power or family.powers[0])[:, None]
    return trimesh.Trimesh(verts, mesh.faces, process=False)


def plain_primitive(shape: str, vertices: int) -> trimesh.Trimesh:
    """The same with even triangles."""
    return even_mesh(unit_primitive(shape, FINER * vertices), vertices)


def placed_primitive(
    shape: str,
    vertices: int,
    silhouettes: np.ndarray,
    cameras: Cameras,
    frames: np.ndarray | None = None,
) -> trimesh.Trimesh:
    """A primitive where the silhouettes are: closed, oriented outwards, with even triangles.

    Of several directions of its axes the one is taken whose silhouettes overlap the given ones
    most, and in that direction the roundness; centre and lengths are such that they have the same
    moments.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        frames: [views, 4] of the photographs within the images; the whole images if not given
    """
    shown = _Shown.of(silhouettes, cameras, frames)
    sharpest, *rounder = PRIMITIVES[shape].powers

    def match(axes: np.ndarray, power: float) -> _Candidate:
        return _match_moments(unit_primitive(shape, VERTICES, power), power, axes, shown)

    best = max(
        (match(axes, sharpest) for axes in _directions(shape, shown.ellipsoid, cameras)),
        key=attrgetter("iou"),
    )
    best = max([best, *(match(best.axes, power) for power in rounder)], key=attrgetter("iou"))
    fine = unit_primitive(shape, FINER * vertices, best.power)
    fine.apply_transform(best.to_world)
    return even_mesh(fine, vertices)


def place(
    mesh: trimesh.Trimesh,
    silhouettes: np.ndarray,
    cameras: Cameras,
    frames: np.ndarray | None = None,
) -> trimesh.Trimesh:
    """Any mesh where the silhouettes are, stretched along the world's axes but not turned.

    Centre and lengths are such that its silhouettes have the moments of the given ones. Arguments
    are those of ``placed_primitive``.
    """
    unit = mesh.copy().apply_translation(-mesh.bounds.mean(axis=0))
    unit.apply_scale(2 / mesh.extents)
    shown = _Shown.of(silhouettes, cameras, frames)
    placed = unit.copy().apply_transform(_match_moments(unit, 0.0, np.eye(3), shown).to_world)
    return trimesh.Trimesh(placed.vertices, mesh.faces, process=False)


class _Shown(NamedTuple):
    """What shapes are matched to: an ellipsoid of the same moments, and a few small silhouettes.

    Attributes:
        ellipsoid: whose silhouettes have the moments of all
        silhouettes: [n, height, width] bool
        cameras: of these
        frames: [n, 4] of the photographs within them, or None
    """

    ellipsoid: Ellipsoid
    silhouettes: np.ndarray
    cameras: Cameras
    frames: np.ndarray | None

    @staticmethod
    def of(silhouettes: np.ndarray, cameras: Cameras, frames: np.ndarray | None) -> "_Shown":
        ellipsoid = find_ellipsoid(silhouettes, cameras, frames)
        whole = find_whole(silhouettes, frames)
        shown, frames = silhouettes[whole], frames if frames is None else frames[whole]
        small, small_cameras = downsample(shown, cameras.select(whole), SIZE, VIEWS)
        return _Shown(
            ellipsoid, small, small_cameras, downsample_frames(shown, SIZE, VIEWS, frames)
        )


def _directions(shape: str, target: Ellipsoid, cameras: Cameras) -> Iterable[np.ndarray]:
    """Axes x, y, z to try: the ellipsoid's own, with each as y, and turned about the upright."""
    own, up = target.axes(), cameras.up.numpy()
    yield np.roll(own, 1, axis=1)  # the longest is y
    if shape == "ellipsoid":
        return
    side = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    side /= np.linalg.norm(side)
    ahead = np.cross(side, up)
    if shape == "cylinder":
        yield own
        yield np.roll(own, 2, axis=1)
        yield np.stack([side, up, ahead], axis=1)
        return
    for turn in np.arange(TURNS) * np.pi / 2 / TURNS:
        x = np.cos(turn) * side + np.sin(turn) * ahead
        yield np.stack([x, up, np.cross(x, up)], axis=1)


def _match_moments(
    unit: trimesh.Trimesh, power: float, axes: np.ndarray, shown: _Shown
) -> _Candidate:
    """Stretch, turn and move a mesh until its silhouettes have the target's moments.

    Args:
        unit: of half-length 1 about the origin
        power: that it was made with
        axes: [3, 3], the directions that its x, y and z take
    """
    target, size = shown.ellipsoid, shown.silhouettes.shape[1:]
    to_world = _matrix(axes, target.lengths(axes), target.centre)
    rendered = render(unit.copy().apply_transform(to_world), shown.cameras, size)
    for _ in range(ROUNDS):
        if not rendered.any():
            break
        found = find_ellipsoid(rendered, shown.cameras, shown.frames)
        lengths = np.linalg.norm(to_world[:3, :3], axis=0)
        lengths *= target.lengths(axes) / found.lengths(axes)
        to_world = _matrix(axes, lengths, to_world[:3, 3] + target.centre - found.centre)
        rendered = render(unit.copy().apply_transform(to_world), shown.cameras, size)
    iou = mean_iou(rendered, shown.silhouettes, known_pixels(shown.silhouettes, shown.frames))
    return _Candidate(iou, power, axes, to_world)


def _matrix(axes: np.ndarray, lengths: np.ndarray, centre: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes * lengths, centre
    return matrix
