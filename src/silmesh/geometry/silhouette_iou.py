"""How well a mesh fits its silhouettes, and the silhouettes their cameras: IoU in the image."""

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import find_box, known_pixels
from silmesh.geometry.overlap import iou
from silmesh.geometry.small_images import LARGEST, shrink, shrink_frames
from silmesh.geometry.visual_hull import Hull
from silmesh.softras.batches import render_views

SHARP = 1e-6  # sigma of a rendering that is almost a mask
SOFT = 4.0  # half images times the root of sigma: alpha is far below a half so far from a mesh
SHARP_SIZE = 256  # pixels: in larger images it is as sharp in pixels as in these


def as_sharp(sigma: float, size: Sequence[int]) -> float:
    """A sigma for images of ``size`` that are as sharp in pixels as those of ``SHARP_SIZE``.

    In smaller images it is the same.
    """
    return sigma * min(1.0, SHARP_SIZE / max(size)) ** 2


def silhouette_iou(
    verts: Tensor,
    faces: Tensor,
    cameras: Cameras,
    silhouettes: np.ndarray,
    sigma: float,
    frames: Sequence[Sequence[int]] | None = None,
) -> np.ndarray:
    """IoU of the rendered alpha, thresholded at 0.5, with each silhouette.

    Of a silhouette that its photograph's frame cuts, only what lies within the frame counts.

    Args:
        verts: [verts, 3] in the cameras' world
        faces: [faces, 3]
        silhouettes: [views, height, width] bool
        sigma: softness of the rendering, as in the fit
        frames: [views, 4] of the photographs within the images; the whole images if not given
    Returns:
        [views]
    """
    known = known_pixels(silhouettes, frames)
    return known_iou(verts, faces, cameras, silhouettes, sigma, known)


def known_iou(
    verts: Tensor,
    faces: Tensor,
    cameras: Cameras,
    silhouettes: np.ndarray,
    sigma: float,
    known: np.ndarray | None,
) -> np.ndarray:
    """``silhouette_iou`` by the pixels ``known`` alone, [views, height, width] bool; None for all.

    The other arguments and the result are the same.
    """
    points, size = cameras.project(verts).detach(), silhouettes.shape[1:]
    left, top, right, bottom = _bound(points, silhouettes, SOFT * math.sqrt(sigma) * max(size) / 2)
    sigma *= (max(size) / max(bottom - top, right - left)) ** 2  # in half images, which are smaller
    corner = torch.tensor([left, top]).to(points)
    alphas = render_views(points - corner, faces, (bottom - top, right - left), sigma)
    within = np.s_[top:bottom, left:right]
    parts = [None] * len(silhouettes) if known is None else [part[within] for part in known]
    rows = zip(alphas, (silhouette[within] for silhouette in silhouettes), parts, strict=True)
    return np.array([iou((a > 0.5).numpy(), silhouette, part) for a, silhouette, part in rows])


def _bound(points: Tensor, silhouettes: np.ndarray, margin: float) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of what any view shows, or sees of points, within the images.

    The whole images if a point is not finite.

    Args:
        points: [views, verts, 2] pixels
        margin: pixels about the points
    """
    size = np.array(silhouettes.shape[:0:-1])
    if not points.isfinite().all():
        return 0, 0, int(size[0]), int(size[1])
    shown = np.array(find_box(silhouettes.any(axis=0))).reshape(2, 2)
    seen = (points.amin((0, 1)) - margin).numpy(), (points.amax((0, 1)) + margin).numpy()
    low = np.minimum(shown[0], np.floor(seen[0])).clip(0, size - 1)
    high = np.maximum(shown[1], np.ceil(seen[1])).clip(low + 1, size)
    return tuple(np.concatenate([low, high]).astype(int).tolist())


def coherence(
    hull: Hull,
    cameras: Cameras,
    silhouettes: np.ndarray,
    frames: Sequence[Sequence[int]] | None = None,
) -> np.ndarray:
    """IoU of the visual hull, rendered almost sharply, with each silhouette: [views].

    It is no ceiling for a mesh, which may overstep a silhouette. But where it is low, the cameras
    and the silhouettes contradict each other, and no mesh will do well. An empty hull has 0. What
    is larger than ``LARGEST`` pixels is compared in images of that size.
    """
    if hull.empty:
        return np.zeros(len(cameras))
    if max(silhouettes.shape[1:]) > LARGEST:
        frames = shrink_frames(silhouettes, LARGEST, frames)
        silhouettes, cameras = shrink(silhouettes, cameras, LARGEST)
    verts, faces = hull.surface()
    return silhouette_iou(
        torch.as_tensor(verts.copy(), dtype=torch.float32),
        torch.as_tensor(faces.astype(np.int64)),
        cameras,
        silhouettes,
        as_sharp(SHARP, silhouettes.shape[1:]),
        frames,
    )
