"""Which of several ways in which an object may have been turned over its colours agree with.

Where the shape is symmetric the silhouettes leave several similarities between the worlds of two
sets of photographs. By each of them every point of the surface has a colour in the photographs of
either set; the correlation of these colours over the surface says how well they agree. Lamps stay
where they are while the object turns, so the colours need not be the same.
"""

from collections.abc import Sequence

import numpy as np

from silmesh.cameras.turned import Turning
from silmesh.geometry.camera import Cameras

SQUARE = 0.35  # least cosine between a normal and the direction to a camera that sees its point
FEWEST = 60  # points that both sets see, from which on they are compared


def correlate_colours(
    points: np.ndarray,
    normals: np.ndarray,
    first: tuple[Cameras, np.ndarray],
    second: tuple[Cameras, np.ndarray],
    turnings: Sequence[Turning],
) -> np.ndarray:
    """How well the colours agree by each similarity: [turnings], correlations; 0 if it is unknown.

    Args:
        points, normals: [n, 3] of the surface in the first world
        first, second: of each set its cameras, in its own world, and its photographs, [views,
            height, width, 3] uint8
        turnings: the similarities
    """
    here, seen = gather_colours(points, normals, *first)
    found = []
    for one in turnings:
        there, seen_there = gather_colours(points, normals, one.bring(second[0]), second[1])
        found.append(_correlate(here, there, seen & seen_there))
    return np.array(found)


def gather_colours(
    points: np.ndarray, normals: np.ndarray, cameras: Cameras, photographs: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The colour of each point [n, 3], by the views that see it squarely, and whether any does."""
    total, weight = np.zeros((len(points), 3)), np.zeros(len(points))
    height, width = photographs.shape[1:3]
    for P, centre, picture in zip(
        cameras.projections.numpy(), cameras.centres.numpy(), photographs, strict=True
    ):
        towards = centre - points
        square = (towards * normals).sum(axis=1) / np.linalg.norm(towards, axis=1)
        seen = points @ P[:, :3].T + P[:, 3]
        column, row = (seen[:, :2] / seen[:, 2:]).T
        inside = (seen[:, 2] > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
        share = np.where(inside & (square > SQUARE), square**2, 0)
        at = np.where(inside, row, 0).astype(int), np.where(inside, column, 0).astype(int)
        total += share[:, None] * picture[at]
        weight += share
    return total / np.maximum(weight, 1e-9)[:, None], weight > 0


def _correlate(here: np.ndarray, there: np.ndarray, both: np.ndarray) -> float:
    """The correlation of colours [n, 3] over the points that both know, channels together."""
    if both.sum() < FEWEST:
        return 0.0
    a, b = (colours[both] - colours[both].mean(axis=0) for colours in (here, there))
    return float((a * b).sum() / max(np.sqrt((a**2).sum() * (b**2).sum()), 1e-9))
