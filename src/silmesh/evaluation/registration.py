"""Registration of a mesh with the ground truth by a similarity without reflection.

Estimated cameras leave the frame of a mesh arbitrary. Many rotations are compared by the mean
distance of the two surfaces. The best are refined by point-to-plane ICP (Chen and Medioni 1992)
with a scale: for a point x of the moved mesh, the nearest point q of the truth and its normal n, it
solves for a small rotation w, translation d and growth g

    n . (x - q) + n . (w x x + d + g x) = 0

by least squares. The points of both surfaces take part, so that neither can shrink into the other,
and large residuals are weighted down.
"""

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

ROTATIONS = 300  # random rotations that are tried beside those that match the principal axes
# Points of each surface by which rotations are compared, the best ones are refined, and at last the
# best of all.
TRIED, ROUGH, FINE = 200, 1000, 15_000
KEPT = 12  # number of rotations that are refined
ROUNDS = 30  # most iterations of ICP
SPREAD = 3.0  # width of the robust weight, in medians of the residuals


@dataclass(frozen=True)
class Registration:
    """X' = scale R X + t.

    Attributes:
        scale: positive
        R: [3, 3], det R = +1
        t: [3]
        distance: mean distance of points of each surface to the other, in units of the truth
    """

    scale: float
    R: np.ndarray
    t: np.ndarray
    distance: float = np.inf

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Points [n, 3] of the mesh, in the truth's frame."""
        return self.scale * points @ self.R.T + self.t

    def undo(self, points: np.ndarray) -> np.ndarray:
        """Points [n, 3] of the truth, in the mesh's frame."""
        return (points - self.t) @ self.R / self.scale


class Surface:
    """Points spread evenly over a mesh in any order, with normals, a tree and principal axes."""

    def __init__(self, mesh: trimesh.Trimesh, seed: int):
        self.points, faces = trimesh.sample.sample_surface(mesh, FINE, seed=seed)
        self.normals = mesh.face_normals[faces]
        self.tree = cKDTree(self.points)
        self.centre = self.points.mean(axis=0)
        self.radius = float(np.sqrt(((self.points - self.centre) ** 2).sum(axis=1).mean()))
        self.axes = np.linalg.svd(self.points - self.centre, full_matrices=False)[2]


def register(mesh: trimesh.Trimesh, truth: trimesh.Trimesh) -> Registration:
    """Find the similarity that registers a mesh with the truth."""
    ours, theirs = Surface(mesh, seed=0), Surface(truth, seed=1)
    tried = [_start(ours, theirs, R) for R in _rotations(ours, theirs)]
    tried.sort(key=lambda found: found.distance)
    rough = [_refine(ours, theirs, found, ROUGH) for found in tried[:KEPT]]
    best = min(rough, key=lambda found: found.distance)
    return _refine(ours, theirs, best, FINE)


def _rotations(ours: Surface, theirs: Surface) -> np.ndarray:
    """Rotations to begin with: [n, 3, 3]."""
    quaternions = np.random.default_rng(0).normal(size=(ROTATIONS, 4))
    spread = Rotation.from_quat(quaternions).as_matrix()
    signs = [np.diag(s) for s in product((-1.0, 1.0), repeat=3)]
    swaps = [np.eye(3)[list(p)] for p in permutations(range(3))]
    onto = [theirs.axes.T @ sign @ swap @ ours.axes for sign in signs for swap in swaps]
    return np.concatenate([spread, [R for R in onto if np.linalg.det(R) > 0]])


def _start(ours: Surface, theirs: Surface, R: np.ndarray) -> Registration:
    """The registration that rotates by R and matches centres and sizes."""
    scale = theirs.radius / ours.radius
    found = Registration(scale, R, theirs.centre - scale * R @ ours.centre)
    return _judge(ours, theirs, found, TRIED)


def _judge(ours: Surface, theirs: Surface, found: Registration, count: int) -> Registration:
    """The same with its distance, by so many points of each surface."""
    here, _ = theirs.tree.query(found.apply(ours.points[:count]))
    there, _ = ours.tree.query(found.undo(theirs.points[:count]))
    distance = (here.mean() + found.scale * there.mean()) / 2
    return Registration(found.scale, found.R, found.t, float(distance))


def _refine(ours: Surface, theirs: Surface, found: Registration, count: int) -> Registration:
    """Run point-to-plane ICP until it converges."""
    for _ in range(ROUNDS):
        x, q, n = _match(ours, theirs, found, count)
        residual = (n * (x - q)).sum(axis=1)
        width = SPREAD * np.median(np.abs(residual)) + 1e-12 * theirs.radius
        weight = 1 / (1 + (residual / width) ** 2)
        arms = x - theirs.centre  # turned and scaled about the truth's middle
        rows = np.column_stack([np.cross(arms, n), n, (n * arms).sum(axis=1) / theirs.radius])
        rows[:, :3] /= theirs.radius
        normal = rows.T @ (rows * weight[:, None])  # [7, 7]; singular for a body of revolution
        step = np.linalg.lstsq(normal, -rows.T @ (residual * weight), rcond=1e-9)[0]
        turn = Rotation.from_rotvec(step[:3] / theirs.radius).as_matrix()
        grow = float(np.exp(np.clip(step[6] / theirs.radius, -0.1, 0.1)))
        t = grow * turn @ (found.t - theirs.centre) + theirs.centre + step[3:6]
        found = Registration(grow * found.scale, turn @ found.R, t)
        if np.abs(step).max() < 1e-6 * theirs.radius:
            break
    return _judge(ours, theirs, found, count)


def _match(
    ours: Surface, theirs: Surface, found: Registration, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of the moved mesh, those of the truth beside them, normals: each [2 count, 3]."""
    moved = found.apply(ours.points[:count])
    _, near = theirs.tree.query(moved)
    _, back = ours.tree.query(found.undo(theirs.points[:count]))
    x = np.concatenate([moved, found.apply(ours.points[back])])
    q = np.concatenate([theirs.points[near], theirs.points[:count]])
    return x, q, np.concatenate([theirs.normals[near], ours.normals[back] @ found.R.T])
