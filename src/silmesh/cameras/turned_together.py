"""What the cameras of two sets have in common, and how the object was turned over, solved together.

Each set's cameras were found from that set alone, which leaves some of what all of them share
nearly open: a turntable's elevation, any long lens's focal length. Views from other sides, after
the object was turned over, show it. So each set gets a correction that its cameras share,

    R' = E R,    t' = t + z d,    f' = g f,    z: the object's distance

in the world whose origin lies within the object: E is the side from which it is seen (about x of a
turntable's camera: its elevation), d where it stands in the image. These and the similarity between
both worlds minimise the silhouette coherence of all views of both sets
(``cameras.silhouette_coherence``), by Gauss and Newton with weak priors.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from silmesh.cameras.gauss_newton import Problem, minimise, remember_last, soft_l1
from silmesh.cameras.silhouette_coherence import (
    Misses,
    Outlines,
    Pose,
    find_misses,
    make_pose,
    measure_at,
)
from silmesh.cameras.turned import Half, Turning
from silmesh.cameras.turned_kernels import HALF
from silmesh.cameras.turntable_residuals import INDEPENDENT, NOISE
from silmesh.geometry.camera import Cameras

# Standard deviations of the priors: of a correction's turn about x, y and z of the camera in
# degrees, of its shift in parts of the object's distance, of the logarithm of its focal length, and
# of the similarity's turn in degrees, logarithm of its scale, and shift in units of the world.
TURN_SD, SHIFT_SD, FOCAL_SD = (5.0, 1.0, 1.0), (0.01, 0.01, 0.3), 0.3
JOIN_SD = (5.0, 5.0, 5.0, 0.1, 0.1, 0.1, 0.1)
COMMON = 7  # parameters of a correction, of which there are two before those of the similarity
PARAMETERS = 2 * COMMON + len(JOIN_SD)
NUDGE = 0.02  # of a standard deviation, for central differences
EVERY = 2  # of the points of an outline, one in so many is used
# Standard errors by which the loss has to fall. True cameras, of which nothing is to be corrected,
# let it fall by 1.1 to 5.6 (images of 64 and 128 pixels), since 21 parameters follow the pixels.
CLEAR = 8.0
STEPS = 30  # of Gauss and Newton at most


@dataclass(frozen=True)
class Correction:
    """What is corrected of all cameras of a set alike.

    Attributes:
        E: [3, 3], a rotation in the camera
        d: [3], in parts of the object's distance
        g: factor of the focal lengths
    """

    E: np.ndarray
    d: np.ndarray
    g: float

    @staticmethod
    def of(x: np.ndarray) -> "Correction":
        """By parameters [COMMON], in standard deviations of their priors."""
        E = Rotation.from_rotvec(np.radians(x[:3] * TURN_SD)).as_matrix()
        return Correction(E, x[3:6] * SHIFT_SD, float(np.exp(x[6] * FOCAL_SD)))

    @property
    def degrees(self) -> float:
        """By how much the side is turned from which the object is seen."""
        return float(np.degrees(Rotation.from_matrix(self.E).magnitude()))

    def correct(self, cameras: Cameras) -> Cameras:
        """Cameras of a world whose origin lies within the object."""
        K = cameras.K.clone()
        K[:, :2, :2] *= self.g
        t = cameras.t + torch.as_tensor(self.d) * cameras.t[:, 2:]
        return replace(cameras, K=K, R=torch.as_tensor(self.E) @ cameras.R, t=t)


@dataclass(frozen=True)
class Together:
    """Both sets, solved together.

    Attributes:
        turning: the similarity between the corrected sets' worlds; its ``squares`` are not known
        corrections: of the first set and of the second
    """

    turning: Turning
    corrections: tuple[Correction, Correction]

    @staticmethod
    def of(x: np.ndarray, turning: Turning) -> "Together":
        """By parameters [PARAMETERS], in standard deviations, from a similarity."""
        both = Correction.of(x[:COMMON]), Correction.of(x[COMMON : 2 * COMMON])
        step = x[2 * COMMON :] * JOIN_SD
        turn = Rotation.from_rotvec(np.radians(step[:3])).as_matrix()
        grown = float(np.exp(step[3]))
        Q, s, c = turn @ turning.Q, grown * turning.s, grown * (turn @ turning.c) + step[4:]
        return Together(Turning(Q, s, c, np.full_like(turning.squares, np.nan)), both)

    def join(self, first: Cameras, second: Cameras) -> Cameras:
        """Cameras of both sets, each in its own normalised world, in the first one's."""
        one, two = self.corrections
        return self.turning.join(one.correct(first), two.correct(second))


def solve_together(halves: Sequence[Half], turning: Turning) -> Together | None:
    """The similarity and the corrections of both sets; None if these explain little more.

    Args:
        halves: both sets, in their normalised worlds
        turning: the similarity between these, nearly right
    """
    both, start = _Both(halves, turning), np.zeros(PARAMETERS)
    x = minimise(both.problem, start, STEPS)
    return Together.of(x, turning) if both.excess(x, start) > CLEAR else None


class _Both:
    """The residuals of the outlines of both sets, as functions of what is solved."""

    def __init__(self, halves: Sequence[Half], turning: Turning):
        self.turning, self.cameras = turning, [half.cameras for half in halves]
        parts = [half.outlines.select(np.arange(len(half.cameras)), EVERY) for half in halves]
        names = ("distances", "cut", "points", "known")
        arrays = (np.concatenate([getattr(one, name) for one in parts]) for name in names)
        self.outlines = Outlines(*arrays, parts[0].far)
        self.misses = remember_last(self._find_misses)

    @property
    def problem(self) -> Problem:
        """A prior weighs as much as one of INDEPENDENT measurements of an outline."""
        known = self.outlines.known
        weights = known.ravel() * INDEPENDENT / known.shape[1] / NOISE**2
        none, edge = np.zeros(PARAMETERS), np.full(PARAMETERS, np.inf)
        return Problem(self.residuals, self.slopes, weights, none, none + 1, -edge, edge)

    def excess(self, better: np.ndarray, worse: np.ndarray) -> float:
        """By how many standard errors one loss exceeds another."""
        known = self.outlines.known
        low, high = (soft_l1(self.residuals(x))[known.ravel()].mean() for x in (better, worse))
        square = INDEPENDENT * len(known) * (high - low) / max(low, NOISE**2)
        return math.copysign(math.sqrt(abs(square)), square)

    def pose(self, x: np.ndarray) -> Pose:
        cameras = Together.of(x, self.turning).join(*self.cameras)
        arrays = (getattr(cameras, name).numpy() for name in ("K", "R", "t"))
        return make_pose(*arrays, self.outlines.points)

    def _find_misses(self, x: np.ndarray) -> Misses:
        return find_misses(self.outlines, self.pose(x), HALF)

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """[views * samples] pixels, 0 or negative."""
        return self.misses(x).pixels.ravel()

    def slopes(self, x: np.ndarray) -> np.ndarray:
        """Their derivatives, depth and view that are missed held fixed: [residuals, PARAMETERS]."""
        misses, slopes = self.misses(x), []
        for nudge in NUDGE * np.eye(PARAMETERS):
            poses = self.pose(x + nudge), self.pose(x - nudge)
            up, down = (measure_at(self.outlines, misses, pose, pose) for pose in poses)
            slopes.append((up - down).ravel() / (2 * NUDGE))
        return np.stack(slopes, axis=1)
