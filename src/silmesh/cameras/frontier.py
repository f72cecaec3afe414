"""Frontier points: where two views' epipolar planes touch the object, so that both must agree.

Of all planes through two cameras' centres, the two outermost that meet the object touch it at its
frontier points, and its outlines in both views (Cipolla, Astrom and Giblin, *Motion from the
frontier of curved surfaces*, 1995). A residual is the angle between the planes that touch the two
outlines, about the line through the centres, in pixels. It needs no hull, has two signs and is
smooth. Where a scale and a shift of each view are sought and the cameras known, it is nearly linear
in them.

Cameras on one level say nothing of shifts along it: all their planes are level.
"""

from dataclasses import dataclass, replace

import numpy as np
from skimage.measure import find_contours

from silmesh.cameras.silhouette_coherence import uncrop

DIRECTIONS = 96  # in which the outermost point of an outline is kept
LEAST_ANGLE, MOST_ANGLE = 2.0, 110.0  # degrees between the directions in which two views look
MOST_PAIRS = 2000  # of views, spread over all
NEAREST = 0.05  # least depth of a ray across the line of centres, against division by zero
# A crop's parameters: the shift of its pixels, x and y, and the logarithm of its scale.
SHIFT_X, SHIFT_Y, SCALE = range(3)
NUDGE = np.array([0.05, 0.05, 0.0005])  # of these, for central differences


def to_maps(crops: np.ndarray, ratios: np.ndarray) -> np.ndarray:
    """Scale (x, y) and shift (x, y) of each view: [views, 2, 2].

    Args:
        crops: [views, 3] shifts in pixels and logarithm of the scale
        ratios: [views, 2] known scales along x and y, which come on top
    """
    return np.stack([ratios * np.exp(crops[:, SCALE:]), crops[:, :SCALE]], axis=1)


def trace_hulls(distances: np.ndarray) -> np.ndarray:
    """The outermost points of outlines: [views, DIRECTIONS, 2] pixels x, y.

    Args:
        distances: [views, height, width] to the outlines, positive inside; NaN counts as outside
    """
    angles = np.linspace(0, 2 * np.pi, DIRECTIONS, endpoint=False)
    ways = np.stack([np.cos(angles), np.sin(angles)])
    hulls = []
    for distance in distances:
        closed = np.pad(np.nan_to_num(distance, nan=-0.5), 1, constant_values=-0.5)
        outline = max(find_contours(closed, 0.0), key=len)[:, ::-1] - 0.5
        hulls.append(outline[(outline @ ways).argmax(axis=0)])
    return np.stack(hulls)


@dataclass(frozen=True)
class Frontier:
    """The frontier points of cameras that are known but for their crops.

    Attributes:
        K: [views, 3, 3] before the crop
        R: [views, 3, 3]
        hulls: [views, n, 2] outermost points of the outlines, in pixels after the crop
        ratios: [views, 2] known scales of the pixels after the crop
        first, second: [pairs] views
        lines: [pairs, 2, 3] unit vectors across the line of centres: towards the object, and
            normal to it
    """

    K: np.ndarray
    R: np.ndarray
    hulls: np.ndarray
    ratios: np.ndarray
    first: np.ndarray
    second: np.ndarray
    lines: np.ndarray

    @staticmethod
    def of(
        camera: tuple[np.ndarray, np.ndarray, np.ndarray],
        middle: np.ndarray,
        hulls: np.ndarray,
        ratios: np.ndarray,
        whole: np.ndarray,
    ) -> "Frontier":
        """Of cameras K [3, 3] or one each, R and t, about an object whose middle [3] is known.

        Args:
            whole: [views] bool, of which views the outermost points are the object's
        """
        K, R, t = camera
        sight = middle - _find_centres(R, t)
        sight = sight / np.linalg.norm(sight, axis=1, keepdims=True)
        first, second = np.triu_indices(len(R), 1)
        apart = np.degrees(np.arccos(np.clip((sight[first] * sight[second]).sum(1), -1, 1)))
        seen = (apart > LEAST_ANGLE) & (apart < MOST_ANGLE) & whole[first] & whole[second]
        seen = np.flatnonzero(seen)
        seen = seen[:: max(1, -(-len(seen) // MOST_PAIRS))]
        plain = Frontier(K, R, hulls, ratios, first[seen], second[seen], np.zeros((0, 2, 3)))
        return plain.of_cameras(camera, middle)

    def of_cameras(
        self, camera: tuple[np.ndarray, np.ndarray, np.ndarray], middle: np.ndarray
    ) -> "Frontier":
        """The same pairs of views with other cameras."""
        K, R, t = camera
        centres = _find_centres(R, t)
        along = centres[self.second] - centres[self.first]
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        towards = middle - centres[self.first]
        towards = towards - along * (along * towards).sum(axis=1, keepdims=True)
        towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
        lines = np.stack([towards, np.cross(along, towards)], axis=1)
        return replace(self, K=np.broadcast_to(K, R.shape), R=R, lines=lines)

    def touch(self, crops: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Both outermost planes' slopes by the first view of each pair and by the second.

        Args:
            crops: [views, 3]
        Returns:
            [pairs, 2] each
        """
        points = uncrop(self.hulls, to_maps(crops, self.ratios))
        whole = np.concatenate([points, np.ones_like(points[..., :1])], axis=2)
        rays = whole @ np.linalg.inv(self.K).swapaxes(1, 2) @ self.R  # in the world
        rays = rays.swapaxes(1, 2)
        return tuple(self._span(rays[v]) for v in (self.first, self.second))

    def _pixels(self, crops: np.ndarray) -> np.ndarray:
        """Pixels of a slope of 1, between those of both views: [pairs, 1]."""
        focal = self.K[:, 0, 0] * np.exp(crops[:, SCALE])
        return np.sqrt(focal[self.first] * focal[self.second])[:, None]

    def _span(self, rays: np.ndarray) -> np.ndarray:
        depth, height = np.moveaxis(self.lines @ rays, 1, 0)
        slopes = height / np.maximum(depth, NEAREST)
        return np.column_stack([slopes.min(axis=1), slopes.max(axis=1)])

    def residuals(self, crops: np.ndarray) -> np.ndarray:
        """By how much two views contradict each other: [pairs, 2] pixels."""
        first, second = self.touch(crops)
        return (first - second) * self._pixels(crops)

    def slopes(self, crops: np.ndarray) -> np.ndarray:
        """Derivatives of the residuals: [pairs, 2, views, 3]."""
        slopes = np.zeros((len(self.first), 2, len(crops), 3))
        pairs, pixels = np.arange(len(self.first)), self._pixels(crops)
        for i, nudge in enumerate(NUDGE):
            up, down = (self.touch(crops + d * np.eye(3)[i]) for d in (nudge, -nudge))
            change = [(u - d) / (2 * nudge) * pixels for u, d in zip(up, down, strict=True)]
            slopes[pairs, :, self.first, i] += change[0]
            slopes[pairs, :, self.second, i] -= change[1]
        half = self.residuals(crops) / 2  # since the pixels grow with the scales of both views
        slopes[pairs, :, self.first, SCALE] += half
        slopes[pairs, :, self.second, SCALE] += half
        return slopes


def _find_centres(R: np.ndarray, t: np.ndarray) -> np.ndarray:
    return -np.einsum("vji,vj->vi", R, t)
