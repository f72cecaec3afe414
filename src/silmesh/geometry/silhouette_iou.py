"""How well a mesh fits its silhouettes, and the silhouettes their cameras: IoU in the image."""

import numpy as np
import torch
from torch import Tensor

from silmesh.geometry.camera import Cameras
from silmesh.geometry.overlap import iou
from silmesh.geometry.visual_hull import Hull
from silmesh.softras.batches import render_views


def silhouette_iou(
    verts: Tensor, faces: Tensor, cameras: Cameras, silhouettes: np.ndarray, sigma: float
) -> np.ndarray:
    """IoU of the rendered alpha, thresholded at 0.5, with each silhouette.

    Args:
        verts: [verts, 3] in the cameras' world
        faces: [faces, 3]
        silhouettes: [views, height, width] bool
        sigma: softness of the rendering, as in the fit
    Returns:
        [views]
    """
    alphas = render_views(cameras.project(verts), faces, silhouettes.shape[1:], sigma)
    pairs = zip(alphas, silhouettes, strict=True)
    return np.array([iou((alpha > 0.5).numpy(), silhouette) for alpha, silhouette in pairs])


def coherence(hull: Hull, cameras: Cameras, silhouettes: np.ndarray) -> np.ndarray:
    """IoU of the visual hull, rendered almost sharply, with each silhouette: [views].

    It is no ceiling for a mesh, which may overstep a silhouette. But where it is low, the cameras
    and the silhouettes contradict each other, and no mesh will do well. An empty hull has 0.
    """
    if hull.empty:
        return np.zeros(len(cameras))
    verts, faces = hull.surface()
    return silhouette_iou(
        torch.as_tensor(verts.copy(), dtype=torch.float32),
        torch.as_tensor(faces.astype(np.int64)),
        cameras,
        silhouettes,
        sigma=1e-6,
    )
