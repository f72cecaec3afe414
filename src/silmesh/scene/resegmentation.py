"""Re-segmentation of an outlier, guided by the visual hull of the inliers.

That hull, rendered in the outlier's view, contains the object. So pixels outside it are background.
Pixels deep inside it that the old silhouette shows are object. GrabCut (Rother et al. 2004) decides
the pixels between them by the photograph's colours.
"""

from collections.abc import Sequence

import numpy as np
from PIL import Image
from scipy import ndimage

from silmesh.geometry.camera import Cameras
from silmesh.progress import Share, untold
from silmesh.scene.votes import count_denials

OUTER = 4  # pixels around the hull that are probably background; those beyond certainly are
INNER = 1 / 40  # of the image's side: the old silhouette is trusted from this depth in the hull on
# If the old silhouette shows little of that, pixels from this share of the hull's greatest depth on
# are object instead.
DEEP = 1 / 2
ITERATIONS = 5  # of GrabCut


def repair(
    photographs: Sequence[Image.Image],
    silhouettes: np.ndarray,
    cameras: Cameras,
    outliers: Sequence[int],
    inliers: Sequence[int],
    frames: np.ndarray | None = None,
    progress: Share = untold,
) -> np.ndarray:
    """Segment the outliers again: [len(outliers), height, width] bool.

    Args:
        photographs: working images of the outliers
        silhouettes: [views, height, width] bool, of all views
        cameras: of all views, in the normalised world
        outliers, inliers: positions of the views to segment again, and of those that form the hull
        frames: [views, 4] of the photographs within the images, as ``count_denials`` takes them
        progress: is told which share of the outliers is done
    """
    hulls = count_denials(silhouettes, cameras, outliers, inliers, 1, frames=frames) == 0
    found = []
    for photograph, hull, i in zip(photographs, hulls, outliers, strict=True):
        found.append(segment(np.asarray(photograph.convert("RGB")), hull, silhouettes[i]))
        progress(len(found) / len(outliers))
    return np.stack(found)


def segment(pixels: np.ndarray, hull: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Cut the object out of a photograph, within what the other views allow.

    Args:
        pixels: [height, width, 3] uint8
        hull: [height, width] bool, where the object can be
        before: [height, width] bool, the old silhouette
    Returns:
        [height, width] bool; nothing if the hull is empty
    """
    import cv2  # takes a moment, and few scenes need it

    depth = ndimage.distance_transform_edt(hull)
    core = depth > INNER * max(hull.shape)
    if not core.any():
        return np.zeros_like(hull)
    found = (core & before).sum() > core.sum() / 2
    sure = core & before if found else core & (depth > DEEP * depth.max())
    labels = np.where(hull, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[~ndimage.binary_dilation(hull, iterations=OUTER)] = cv2.GC_BGD
    labels[sure] = cv2.GC_FGD
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(0)
    cv2.grabCut(
        np.ascontiguousarray(pixels), labels, None, *models, ITERATIONS, cv2.GC_INIT_WITH_MASK
    )
    return _drop_specks(np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD)) & hull)


def _drop_specks(region: np.ndarray) -> np.ndarray:
    """The region without pieces smaller than a twentieth of its largest piece."""
    if not region.any():
        return region
    pieces, count = ndimage.label(region)
    areas = np.bincount(pieces.ravel(), minlength=count + 1)
    areas[0] = 0
    return (areas >= 0.05 * areas.max())[pieces]
