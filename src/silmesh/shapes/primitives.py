"""Ellipsoid, cylinder and cube, placed by the silhouettes of all views.

All are superquadrics of half-length 1 (Barr 1981), whose edges are rounded so that they deform
well: x^p + y^p + z^p = 1 is a cube for a large p, (x^2 + z^2)^(p/2) + y^p = 1 a cylinder about y.
"""

from collections.abc import Callable, Iterable

import numpy as np
import trimesh

from silmesh.cameras.camera import Cameras
from silmesh.shapes.ellipsoid import Ellipsoid, find_ellipsoid
from silmesh.shapes.even import even_mesh
from silmesh.shapes.looks import look_smaller, mean_iou, render
from silmesh.shapes.sphere import unit_sphere

ROUNDING = 8  # the power p
ROUNDS = 3  # of making the placed shape's silhouettes have the given ones' moments
FINER = 4  # times as many vertices as are wanted, before these are spread evenly
SIZE, VIEWS, VERTICES = 96, 18, 400  # of the looks in which placements are tried
TURNS = 6  # placements of a cube about the upright axis


def _ellipsoid(verts: np.ndarray) -> np.ndarray:
    return np.linalg.norm(verts, axis=1)


def _cylinder(verts: np.ndarray) -> np.ndarray:
    around = np.linalg.norm(verts[:, [0, 2]], axis=1)
    return (around**ROUNDING + np.abs(verts[:, 1]) ** ROUNDING) ** (1 / ROUNDING)


def _cube(verts: np.ndarray) -> np.ndarray:
    return (np.abs(verts) ** ROUNDING).sum(axis=1) ** (1 / ROUNDING)


# By what a point is divided to lie on the surface.
PRIMITIVES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "ellipsoid": _ellipsoid,
    "cylinder": _cylinder,
    "cube": _cube,
}


def unit_primitive(shape: str, vertices: int) -> trimesh.Trimesh:
    """A primitive of half-length 1 about the origin, closed and oriented outwards."""
    mesh = unit_sphere(vertices)
    verts = mesh.vertices / PRIMITIVES[shape](mesh.vertices)[:, None]
    return trimesh.Trimesh(verts, mesh.faces, process=False)


def plain_primitive(shape: str, vertices: int) -> trimesh.Trimesh:
    """The same with even triangles."""
    return even_mesh(unit_primitive(shape, FINER * vertices), vertices)


def placed_primitive(
    shape: str, vertices: int, silhouettes: np.ndarray, cameras: Cameras
) -> trimesh.Trimesh:
    """A primitive where the silhouettes are: closed, oriented outwards, with even triangles.

    Of several directions of its axes the one is taken whose silhouettes overlap the given ones
    most; centre and lengths are such that they have the same moments.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
    """
    target = find_ellipsoid(silhouettes, cameras)
    seen, eyes = look_smaller(silhouettes, cameras, SIZE, VIEWS)
    unit = unit_primitive(shape, VERTICES)
    tried = [_place(unit, axes, target, seen, eyes) for axes in _directions(shape, target, cameras)]
    to_world = max(tried, key=lambda placed: placed[0])[1]
    fine = unit_primitive(shape, FINER * vertices)
    fine.apply_transform(to_world)
    return even_mesh(fine, vertices)


def find_up(cameras: Cameras) -> np.ndarray:
    """The upright of cameras that stand upright: what is most square to the rows of all images."""
    across = cameras.R[:, 0].numpy()
    return np.linalg.eigh(across.T @ across)[1][:, 0]


def _directions(shape: str, target: Ellipsoid, cameras: Cameras) -> Iterable[np.ndarray]:
    """Axes x, y, z to try: the ellipsoid's own, with each as y, and turned about the upright."""
    own, up = target.axes(), find_up(cameras)
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


def _place(
    unit: trimesh.Trimesh,
    axes: np.ndarray,
    target: Ellipsoid,
    silhouettes: np.ndarray,
    cameras: Cameras,
) -> tuple[float, np.ndarray]:
    """IoU with the silhouettes, and the matrix [4, 4] that stretches, turns and moves it there."""
    size = silhouettes.shape[1:]
    to_world = _matrix(axes, target.lengths(axes), target.centre)
    rendered = render(unit.copy().apply_transform(to_world), cameras, size)
    for _ in range(ROUNDS):
        if not rendered.any():
            break
        found = find_ellipsoid(rendered, cameras)
        lengths = np.linalg.norm(to_world[:3, :3], axis=0)
        lengths *= target.lengths(axes) / found.lengths(axes)
        to_world = _matrix(axes, lengths, to_world[:3, 3] + target.centre - found.centre)
        rendered = render(unit.copy().apply_transform(to_world), cameras, size)
    return mean_iou(rendered, silhouettes), to_world


def _matrix(axes: np.ndarray, lengths: np.ndarray, centre: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes * lengths, centre
    return matrix
