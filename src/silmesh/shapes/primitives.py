"""Ellipsoid, cylinder and cube, placed by the silhouettes of all views.

All are superquadrics of half-length 1 (Barr 1981), whose edges are rounded so that they deform
well: x^p + y^p + z^p = 1 is a cube for a large p, (x^2 + z^2)^(p/2) + y^p = 1 a cylinder about y.
"""

from collections.abc import Callable, Iterable

import numpy as np
import torch
import trimesh
from scipy.optimize import minimize

from silmesh.cameras.camera import Cameras
from silmesh.shapes.ellipsoid import Ellipsoid, find_ellipsoid
from silmesh.shapes.even import even_mesh
from silmesh.shapes.looks import look_smaller, soft_iou, to_tensors
from silmesh.shapes.sphere import unit_sphere

ROUNDING = 8  # the power p
STEPS = 25  # of the search for the lengths and the centre that fill the silhouettes best
REACH = np.log(2)  # that a length or the centre may go away from the ellipsoid's, in that search
FINER = 2  # times as many vertices as are wanted, before these are spread evenly
SIZE, VIEWS, VERTICES = 48, 12, 250  # of the looks in which placements are tried, so small that
# torch shares none of their work among threads: that would cost more than it
SEARCHED = 3  # of the directions, those that fill the silhouettes best at the ellipsoid's lengths
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

    Its axes are those of the ellipsoid that has the silhouettes' moments, or upright; of several
    such directions, and of all lengths and centres, those are taken that fill the silhouettes best.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
    """
    target = find_ellipsoid(silhouettes, cameras)
    seen, eyes = look_smaller(silhouettes, cameras, SIZE, VIEWS)
    unit = unit_primitive(shape, VERTICES)
    tried = [
        _Placement(unit, axes, target, seen, eyes) for axes in _directions(shape, target, cameras)
    ]
    tried = sorted(tried, key=lambda placement: placement.missing(np.zeros(6))[0])[:SEARCHED]
    to_world = min((placement.search() for placement in tried), key=lambda found: found[0])[1]
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


class _Placement:
    """A unit shape along some axes, its lengths and centre to be found; at first an ellipsoid's.

    Args:
        unit: the shape
        axes: [3, 3], in columns
        target: the ellipsoid
        silhouettes, cameras: that it should fill
    """

    def __init__(
        self,
        unit: trimesh.Trimesh,
        axes: np.ndarray,
        target: Ellipsoid,
        silhouettes: np.ndarray,
        cameras: Cameras,
    ):
        self._axes, self._centre, self._lengths = axes, target.centre, target.lengths(axes)
        self._verts, self._faces = to_tensors(unit)
        self._cameras, self._silhouettes = cameras, torch.tensor(silhouettes).float()

    def missing(self, moves: np.ndarray) -> tuple[float, np.ndarray]:
        """What is missing of the soft IoU, and its gradient.

        Args:
            moves: [6], logarithms of how much longer, and how far aside in mean lengths
        """
        x = torch.tensor(moves, dtype=torch.float32, requires_grad=True)
        axes, lengths, centre = (
            torch.tensor(v).float() for v in (self._axes, self._lengths, self._centre)
        )
        verts = self._verts * (lengths * x[:3].exp()) @ axes.T + centre + x[3:] * lengths.mean()
        loss = 1 - soft_iou(verts, self._faces, self._cameras, self._silhouettes)
        loss.backward()
        return loss.item(), x.grad.double().numpy()

    def search(self) -> tuple[float, np.ndarray]:
        """The least that is missing, and the matrix [4, 4] that brings the shape there."""
        found = minimize(
            self.missing,
            np.zeros(6),
            jac=True,
            method="L-BFGS-B",
            bounds=[(-REACH, REACH)] * 6,
            options={"maxiter": STEPS},
        )
        matrix = np.eye(4)
        matrix[:3, :3] = self._axes * (self._lengths * np.exp(found.x[:3]))
        matrix[:3, 3] = self._centre + found.x[3:] * self._lengths.mean()
        return found.fun, matrix
