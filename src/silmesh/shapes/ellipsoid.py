"""The ellipsoid whose outlines have the silhouettes' moments, in all views and three axes.

An ellipsoid with centre c and shape matrix S (its eigenvectors the axes, its eigenvalues the
squared half-lengths) is seen by a camera [R | t] as an ellipse. With A = R S R^T and p = R c + t
its dual conic is A - p p^T, from which the ellipse's centre and shape matrix follow; these are
compared with the silhouette's centroid and four times its covariance, which are an ellipse's own
(Rubino, Crocco and Del Bue, *3D object localisation from multi-view image detections*, 2018).
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from silmesh.geometry.camera import OBJECT_RADIUS, Cameras
from silmesh.geometry.frame import WHOLE, is_cut
from silmesh.geometry.whereabouts import find_filled

PRIOR = 0.02  # weight of a prior that draws a length which no view shows to the others' mean
TOLERANCE = 0.1  # of a mean half-length: larger residuals are weighted down as outliers


@dataclass(frozen=True)
class Ellipsoid:
    """A centre [3] and a shape matrix [3, 3] in the world."""

    centre: np.ndarray
    shape: np.ndarray

    def axes(self) -> np.ndarray:
        """Unit vectors along the axes, the longest first, right-handed: the columns of [3, 3]."""
        vectors = np.linalg.eigh(self.shape)[1][:, ::-1]
        return vectors * [1, 1, np.sign(np.linalg.det(vectors))]

    def lengths(self, axes: np.ndarray) -> np.ndarray:
        """How far it reaches from its centre along each of these unit vectors [3, n]."""
        return np.sqrt(np.einsum("in,ij,jn->n", axes, self.shape, axes))


def find_ellipsoid(
    silhouettes: np.ndarray, cameras: Cameras, frames: np.ndarray | None = None
) -> Ellipsoid:
    """Find the ellipsoid; views that the frame cuts are left out if two others are there.

    Of cut ones alone it is the ellipsoid with the moments of what most of them see: a solid
    ellipsoid's covariance is a fifth of its shape matrix.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        frames: [views, 4] of the photographs within the images; the whole images if not given
    """
    shown = silhouettes.any(axis=(1, 2))
    cut = is_cut(silhouettes, frames)
    whole = shown & ~cut
    if cut.any() and whole.sum() < 2 and shown.sum() >= WHOLE:
        points = find_filled(
            cameras.select(np.flatnonzero(shown)),
            silhouettes[shown],
            frames if frames is None else frames[shown],
        )
        return Ellipsoid(points.mean(axis=0), 5 * np.cov(points.T))
    used = np.flatnonzero(whole if whole.sum() >= 2 else shown)
    centres, shapes = _moments(silhouettes[used], np.linalg.inv(cameras.K.numpy()[used]))
    R, t = cameras.R.numpy()[used], cameras.t.numpy()[used]
    start = _start(centres, shapes, R, t)
    unit = start[3]
    scale = float(np.median(np.linalg.det(shapes) ** 0.25))  # one for all: none counts for more

    def residuals(x: np.ndarray) -> np.ndarray:
        centre, half = x[:3], _lower(x[3:])
        m, E = _outlines(centre, half @ half.T, R, t)
        off, form = (m - centres) / scale, (E - shapes) / scale**2
        data = np.concatenate([off, form[:, [0, 0, 1], [0, 1, 1]]], axis=1).ravel()
        return np.concatenate([data, PRIOR * (x - start) / unit])

    found = least_squares(residuals, start, loss="cauchy", f_scale=TOLERANCE)
    half = _lower(found.x[3:])
    return Ellipsoid(found.x[:3], half @ half.T)


def _moments(silhouettes: np.ndarray, to_rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centroids [views, 2] and four times the covariances [views, 2, 2], at depth 1."""
    centres, shapes = [], []
    for silhouette, ray in zip(silhouettes, to_rays, strict=True):
        points = np.argwhere(silhouette)[:, ::-1] + 0.5
        # A pixel is a square: its own covariance is 1/12 of the unit matrix.
        spread = np.atleast_2d(np.cov(points.T, bias=True)) + np.eye(2) / 12
        centres.append(ray[:2, :2] @ points.mean(axis=0) + ray[:2, 2])
        shapes.append(4 * ray[:2, :2] @ spread @ ray[:2, :2].T)
    return np.stack(centres), np.stack(shapes)


def _outlines(
    centre: np.ndarray, shape: np.ndarray, R: np.ndarray, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Centres [views, 2] and shape matrices [views, 2, 2] of its outlines, at depth 1."""
    p = R @ centre + t
    dual = R @ shape @ R.swapaxes(1, 2) - p[:, :, None] * p[:, None]
    dual /= -np.maximum(-dual[:, 2, 2], 1e-9)[:, None, None]  # the camera stands outside
    m = dual[:, :2, 2]
    return m, m[:, :, None] * m[:, None] - dual[:, :2, :2]


def _start(centres: np.ndarray, shapes: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """A ball where the rays through the centroids meet: centre, and the lower triangle of S^1/2."""
    eyes = -np.einsum("vji,vj->vi", R, t)
    rays = np.einsum("vji,vj->vi", R, np.concatenate([centres, np.ones((len(R), 1))], axis=1))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    across = np.eye(3) - rays[:, :, None] * rays[:, None]
    left = across.sum(axis=0) + 1e-6 * np.eye(3)  # of parallel rays: the point nearest the origin
    centre = np.linalg.solve(left, np.einsum("vij,vj->i", across, eyes))
    depth = np.maximum((R @ centre + t)[:, 2], 1e-3)
    radius = float(np.median(np.linalg.det(shapes) ** 0.25 * depth))
    radius = float(np.clip(radius, 0.01 * OBJECT_RADIUS, 2 * OBJECT_RADIUS))
    return np.array([*centre, radius, 0, radius, 0, 0, radius])


def _lower(values: np.ndarray) -> np.ndarray:
    """A lower triangular matrix from its six numbers, row by row."""
    matrix = np.zeros((3, 3))
    matrix[np.tril_indices(3)] = values
    return matrix
