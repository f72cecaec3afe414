"""Downsampled scenes: few views in small images, for trials of initial meshes."""

import numpy as np
import torch
import trimesh

from silmesh.geometry.camera import Cameras
from silmesh.geometry.silhouette_iou import as_sharp
from silmesh.geometry.small_images import shrink, shrink_frames
from silmesh.softras.batches import render_views

SHARP = 1e-5  # sigma of renderings that are thresholded, as ``as_sharp`` takes it


def downsample(
    silhouettes: np.ndarray, cameras: Cameras, size: int, views: int
) -> tuple[np.ndarray, Cameras]:
    """At most so many views, spread evenly over all, in images of this size or the given one.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views
        size: of the longer side, in pixels
    """
    kept = _choose(len(silhouettes), views)
    return shrink(silhouettes[kept], cameras.select(kept.tolist()), size)


def downsample_frames(
    silhouettes: np.ndarray, size: int, views: int, frames: np.ndarray | None = None
) -> np.ndarray | None:
    """The frames of the photographs in what ``downsample`` gives; None if they cut no silhouette.

    Arguments but ``views`` and the result are those of ``shrink_frames``.
    """
    kept = _choose(len(silhouettes), views)
    return shrink_frames(silhouettes[kept], size, None if frames is None else frames[kept])


def _choose(count: int, most: int) -> np.ndarray:
    """Positions of at most so many of some views, spread evenly."""
    kept = min(most, count)
    return np.arange(kept) * count // kept


def crop(
    silhouettes: np.ndarray, cameras: Cameras, frames: np.ndarray
) -> tuple[np.ndarray, Cameras, np.ndarray]:
    """The part of the images that holds all photographs, without the padding around.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views
        frames: [views, 4] left, top, right and bottom of the photographs in these images, in pixels
    Returns:
        silhouettes, cameras and frames
    """
    left, top = frames[:, :2].min(axis=0).tolist()
    right, bottom = frames[:, 2:].max(axis=0).tolist()
    shift = torch.eye(3, dtype=torch.float64)
    shift[:2, 2] = -torch.tensor([left, top], dtype=torch.float64)
    sizes = torch.tensor([[right - left, bottom - top]]).expand(len(cameras), 2)
    shown = cameras.in_pixels_of(shift.expand(len(cameras), 3, 3), sizes)
    return silhouettes[:, top:bottom, left:right], shown, frames - [left, top, left, top]


def render(mesh: trimesh.Trimesh, cameras: Cameras, size: tuple[int, int]) -> np.ndarray:
    """A mesh's silhouettes: [views, height, width] bool."""
    verts = torch.tensor(np.asarray(mesh.vertices), dtype=torch.float32)
    faces = torch.tensor(np.asarray(mesh.faces), dtype=torch.int64)
    alphas = render_views(cameras.project(verts), faces, size, as_sharp(SHARP, size))
    return np.stack([(alpha > 0.5).numpy() for alpha in alphas])
