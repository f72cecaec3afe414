"""How an object was turned over between two sets of photographs, from the silhouettes of both.

Each set has cameras of its own, in a world of its own. Wanted is the similarity between the worlds,
a point X of the first and Y of the second being the same where X = s Q Y + c, by which the
silhouettes of both sets agree best: silhouette coherence (Hernandez, Schmitt and Cipolla 2007) over
both sets. The ray through a point of an outline touches the object, so at some depth it must be
inside the hull of its own set and inside that of the other. Its residual is

    r = min(0, max over the ray of  min(signed distance to its own hull, to the other hull))

in units of its own normalised world. Each set's signed distance is sampled on a grid once, so a
similarity is judged by one look a depth. Rotations are sought all over SO(3): an even grid, from
each of whose rotations a few steps of Levenberg and Marquardt find place and scale too; the best go
on, on finer grids.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from silmesh.cameras.silhouette_coherence import Outlines, trace
from silmesh.cameras.turned_kernels import HALF, Side, descend, gather, judge, sample_slab
from silmesh.geometry.camera import Cameras, concatenate

APART = 12.0  # degrees between the rotations that are tried first
CLEARLY = 3.0  # standard errors over the views by which one has to fit worse to be ruled out
SAME = 1e-8  # mean square residuals, in units of the world squared, whose difference says nothing
DISTINCT = 10.0  # degrees between rotations that count as two


class Level(NamedTuple):
    """How finely a stage of the search looks.

    Attributes:
        samples: along each side of the grids
        views, rays: of each set at most; of each of these views
        kept: the best similarities that begin the stage
        steps: of Levenberg and Marquardt from each
    """

    samples: int
    views: int
    rays: int
    kept: int
    steps: int


LEVELS = (
    Level(32, 12, 12, 100_000, 0),
    Level(32, 12, 12, 1000, 5),
    Level(48, 24, 24, 100, 10),
    Level(72, 48, 64, 12, 30),
)


@dataclass(frozen=True)
class Turning:
    """A similarity from the second world to the first, X = s Q Y + c.

    Attributes:
        Q: [3, 3], a rotation
        s: scale, of the first world's units to the second's
        c: [3], in units of the first world
        squares: [views], mean square residual of each view's rays, first those of the first set
    """

    Q: np.ndarray
    s: float
    c: np.ndarray
    squares: np.ndarray

    @property
    def cost(self) -> float:
        """Mean square residual over all views."""
        return float(self.squares.mean())

    def angle_to(self, other: "Turning") -> float:
        """Degrees between the two rotations."""
        return float(np.degrees(Rotation.from_matrix(self.Q.T @ other.Q).magnitude()))

    def explains_as_well(self, other: "Turning") -> bool:
        """Whether the other's views fit worse only by what their spread allows."""
        worse = other.squares - self.squares
        return float(worse.mean()) < CLEARLY * float(worse.std()) / len(worse) ** 0.5 + SAME

    def axis_to(self, other: "Turning") -> tuple[np.ndarray, np.ndarray]:
        """The axis in the first world about which the other is turned against this one.

        Returns:
            a unit vector [3], and the point [3] of the axis that is nearest to the origin, as well
            as both worlds allow
        """
        between = other.Q @ self.Q.T
        shift = other.c - other.s / self.s * between @ self.c
        turn = Rotation.from_matrix(between).as_rotvec()
        point = np.linalg.lstsq(np.eye(3) - between, shift, rcond=1e-3)[0]
        return turn / np.linalg.norm(turn), point

    def turned_about(self, axis: np.ndarray, point: np.ndarray, degrees: float) -> "Turning":
        """The same after a turn about an axis of the first world; its ``squares`` are not known."""
        turn = Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix()
        return Turning(
            turn @ self.Q,
            self.s,
            turn @ (self.c - point) + point,
            np.full_like(self.squares, np.nan),
        )

    def bring(self, cameras: Cameras) -> Cameras:
        """Cameras of the second world in the first, up to the scale, which no image shows.

        R Y + t = R Q^T (X - c) / s + t, so s times that is R Q^T X + s t - R Q^T c.
        """
        R = cameras.R @ torch.as_tensor(self.Q.T)
        t = self.s * cameras.t - R @ torch.as_tensor(self.c)
        return replace(cameras, R=R, t=t)

    def join(self, first: Cameras, second: Cameras) -> Cameras:
        """Cameras of both worlds in the first one."""
        return concatenate(first, self.bring(second))


@dataclass(frozen=True)
class Half:
    """The silhouettes of a set with its own cameras, in its own normalised world.

    Attributes:
        cameras: of pinholes
        outlines: of the silhouettes
        pixels: [views], pixels per unit of the world at its origin
    """

    cameras: Cameras
    outlines: Outlines
    pixels: np.ndarray

    @staticmethod
    def prepare(
        silhouettes: np.ndarray, cameras: Cameras, frames: np.ndarray | None = None
    ) -> "Half":
        """Trace the silhouettes [views, height, width] bool, none of them empty or full."""
        outlines = trace(silhouettes, LEVELS[-1].rays, cameras.views, frames)
        pixels = (cameras.K[:, 0, 0] / cameras.centres.norm(dim=1)).numpy()
        return Half(cameras, outlines, pixels)

    def look(self, level: Level) -> Side:
        """The set as a stage of the search looks at it."""
        P = np.ascontiguousarray(self.cameras.projections.numpy())
        scaled = self.outlines.distances / self.pixels[:, None, None].astype(np.float32)
        far = float(self.outlines.far / np.median(self.pixels))
        some = np.linspace(0, len(P), min(len(P), level.views), endpoint=False).astype(int)
        every = max(1, self.outlines.points.shape[1] // level.rays)
        axis = np.linspace(-HALF, HALF, level.samples)
        field = np.empty((level.samples,) * 3, np.float32)

        def fill(i: int) -> None:
            sample_slab(field[i], scaled, self.outlines.cut, far, P, axis[i], axis)

        with ThreadPoolExecutor(torch.get_num_threads()) as pool:
            list(pool.map(fill, range(level.samples)))
        R, K = self.cameras.R.numpy(), self.cameras.K.numpy()
        points = self.outlines.points[some][:, ::every]
        rays = np.concatenate([points, np.ones_like(points[..., :1])], axis=2)
        along = np.einsum("vsk,vjk->vsj", rays, np.linalg.inv(K[some])) @ R[some]
        centres = self.cameras.centres.numpy()[some]
        along /= np.linalg.norm(along, axis=2, keepdims=True)
        known = self.outlines.known[some][:, ::every]
        return Side(
            field,
            *gather(scaled, self.outlines.cut, far, P, some, centres, along, known),
        )


def find_turnings(first: Half, second: Half, apart: float = APART) -> list[Turning]:
    """Distinct similarities between the worlds of two sets, the most coherent first."""
    starts = [(Q, 1.0, np.zeros(3)) for Q in spread_rotations(apart)]
    for level in LEVELS:
        sides = first.look(level), second.look(level)
        found = _descend_all(sides, starts[: level.kept], level.steps)
        starts = _keep_distinct([one[:3] for one in sorted(found, key=lambda one: one[3])])
    counts = len(first.cameras), len(second.cameras)
    turnings = [Turning(*start, judge(*sides, *start, *counts)) for start in starts]
    return sorted(turnings, key=lambda one: one.cost)


def _descend_all(sides: tuple[Side, Side], starts: Sequence[tuple], steps: int) -> list[tuple]:
    def descend_from(start: tuple) -> tuple:
        Q, s, c = start
        return descend(sides[0], sides[1], Q.copy(), s, c.copy(), steps)

    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        return list(pool.map(descend_from, starts))


def spread_rotations(apart: float) -> np.ndarray:
    """Rotations all over SO(3) about so many degrees apart: [n, 3, 3].

    Directions on a spiral of equal areas, each with even turns about it.
    """
    turns = max(4, round(360 / apart))
    count = max(8, round(4 * np.pi / np.radians(apart) ** 2))
    i = np.arange(count)
    z, azimuth = 1 - (2 * i + 1) / count, np.pi * (1 + 5**0.5) * i
    tilt = np.column_stack([-np.sin(azimuth), np.cos(azimuth), 0 * z]) * np.arccos(z)[:, None]
    about = Rotation.from_rotvec(
        2 * np.pi * np.arange(turns)[:, None] / turns * np.array([0.0, 0.0, 1.0])
    )
    tilts = Rotation.from_rotvec(tilt)
    return np.concatenate([(tilts * one).as_matrix() for one in about])


def _keep_distinct(starts: Sequence[tuple]) -> list[tuple]:
    """The first of all similarities whose rotations are less than ``DISTINCT`` apart."""
    least = 1 + 2 * np.cos(np.radians(DISTINCT))  # trace of the rotation between them
    kept = np.empty((len(starts), 9))
    chosen: list[tuple] = []
    for start in starts:
        row = start[0].ravel()
        if (kept[: len(chosen)] @ row < least).all():
            kept[len(chosen)] = row
            chosen.append(start)
    return chosen
