"""Downsampled scenes: few views in small images, for trials of initial meshes."""

from collections.abc import Sequence

import numpy as np
import torch
import trimesh

from silmesh.geometry.camera import Cameras
from silmesh.softras import soft_silhouettes

SHARP = 1e-5  # sigma of renderings that are thresholded to silhouettes


def downsample(
    silhouettes: np.ndarray, cameras: Cameras, size: int, views: int
) -> tuple[np.ndarray, Cameras]:
    """At most so many views, spread evenly over all, in images of this size or the given one.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views
        size: of the longer side, in pixels
    """
    count = min(views, len(cameras))
    kept = np.arange(count) * len(cameras) // count
    height, width = silhouettes.shape[1:]
    shrink = min(1.0, size / max(height, width))
    shape = (max(1, round(shrink * height)), max(1, round(shrink * width)))
    images = torch.tensor(silhouettes[kept], dtype=torch.float32).unsqueeze(1)
    small = torch.nn.functional.interpolate(images, shape, mode="area").squeeze(1)
    to_small = torch.diag(torch.tensor([shape[1] / width, shape[0] / height, 1.0])).double()
    sizes = torch.tensor([[shape[1], shape[0]]]).expand(count, 2)
    chosen = cameras.select(kept.tolist()).in_pixels_of(to_small.expand(count, 3, 3), sizes)
    return (small > 0.5).numpy(), chosen


def crop(
    silhouettes: np.ndarray, cameras: Cameras, frame: Sequence[int]
) -> tuple[np.ndarray, Cameras]:
    """What the photographs show: an object that their frame cuts may go on beyond it.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views
        frame: left, top, right and bottom of the photographs in these images, in pixels
    """
    left, top, right, bottom = frame
    shift = torch.eye(3, dtype=torch.float64)
    shift[:2, 2] = -torch.tensor([left, top], dtype=torch.float64)
    sizes = torch.tensor([[right - left, bottom - top]]).expand(len(cameras), 2)
    shown = cameras.in_pixels_of(shift.expand(len(cameras), 3, 3), sizes)
    return silhouettes[:, top:bottom, left:right], shown


def render(mesh: trimesh.Trimesh, cameras: Cameras, size: tuple[int, int]) -> np.ndarray:
    """A mesh's silhouettes: [views, height, width] bool."""
    verts = torch.tensor(np.asarray(mesh.vertices), dtype=torch.float32)
    faces = torch.tensor(np.asarray(mesh.faces), dtype=torch.int64)
    with torch.no_grad():
        return (soft_silhouettes(cameras.project(verts), faces, size, SHARP) > 0.5).numpy()
