"""Segment a doubtful view again, with what the other views say about it.

Their visual hull, seen from the view, can only be too large: what lies outside is background, what
lies deep inside and was found before is object, and GrabCut (Rother et al. 2004) cuts between them
by the photograph's colours.
"""

from collections.abc import Sequence

import numpy as np
from PIL import Image
from scipy import ndimage

from silmesh.geometry.camera import Cameras
from silmesh.progress import Share, untold
from silmesh.scene.votes import count_denials

OUTER = 4  # pixels outside the hull that colours are still judged in; further out is background
INNER = 1 / 40  # of the image's side: how deep inside the hull what was found before is sure
DEEP = 1 / 2  # of the hull's depth: where the object is sure though it was not found before
ITERATIONS = 5


def repair(
    photographs: Sequence[Image.Image],
    silhouettes: np.ndarray,
    cameras: Cameras,
    doubtful: Sequence[int],
    sound: Sequence[int],
    frames: np.ndarray | None = None,
    progress: Share = untold,
) -> np.ndarray:
    """New silhouettes of the doubtful views: [len(doubtful), height, width] bool.

    Args:
        photographs: of the doubtful views, their working images
        silhouettes: [views, height, width] bool, of all views
        cameras: of all views, in the normalised world
        doubtful, sound: positions of the views to segment again, and of those that say how
        frames: [views, 4] of the photographs within the images, as ``count_denials`` takes them
        progress: is told which share of the doubtful views is done
    """
    hulls = count_denials(silhouettes, cameras, doubtful, sound, 1, frames=frames) == 0
    found = []
    for photograph, hull, i in zip(photographs, hulls, doubtful, strict=True):
        found.append(segment(np.asarray(photograph.convert("RGB")), hull, silhouettes[i]))
        progress(len(found) / len(doubtful))
    return np.stack(found)


def segment(pixels: np.ndarray, hull: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Cut the object out of a photograph, within what the other views allow.

    Args:
        pixels: [height, width, 3] uint8
        hull: [height, width] bool, where the object can be
        before: [height, width] bool, the silhouette that is doubted
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
    """The pieces of a region that are not specks."""
    if not region.any():
        return region
    pieces, count = ndimage.label(region)
    areas = np.bincount(pieces.ravel(), minlength=count + 1)
    areas[0] = 0
    return (areas >= 0.05 * areas.max())[pieces]
