"""How many vertices an initial mesh gets, and the report's scale and shift to the object."""

import math

import numpy as np
import trimesh
from scipy.ndimage import gaussian_filter
from skimage.measure import perimeter_crofton
from skimage.morphology import convex_hull_image

from silmesh.geometry.frame import find_box
from silmesh.geometry.small_images import shrink_silhouettes

COUNTS = (642, 1352, 1922)  # what the report calls 600, 1,300 and 1,900 polygons
COUNTED = 256  # pixels
MOST = 10_000  # most vertices that `auto` chooses
EDGE = 5.0  # pixels: edge length in the images that `auto` aims at for smooth outlines
DETAILED = 8  # most views whose outlines are measured for `auto`
BLUR = 1.0  # pixels: standard deviation of the blur that smooths an outline
JAGGED = 0.1  # share of its length that a jagged outline loses at least by that blur
REPORT_SIZE = 256  # pixels a side of the images to which the report's alignment refers
REPORT_RADIUS = 90  # pixels: radius of the halved unit sphere in such an image


def choose_count(silhouettes: np.ndarray, nearer: float = 1.0) -> int:
    """The fewest vertices whose edges are a few pixels long, the shorter the richer the outlines.

    A convex body's surface is four times its mean silhouette (Cauchy), and a closed mesh of n
    vertices shares that among 2 n - 4 triangles; an even triangle with edges e has the area
    sqrt(3) / 4 e^2. Where outlines are longer than their convex hulls', the surface is larger by
    that factor, and the edges should be shorter by it.

    Of larger images than ``COUNTED`` pixels those of that size are counted in: a fit makes the mesh
    finer as it looks more closely.

    Args:
        silhouettes: [views, height, width] bool
        nearer: by which factor areas are larger in pixels of all views than of these
    """
    if max(silhouettes.shape[1:]) > COUNTED:
        silhouettes = shrink_silhouettes(silhouettes, COUNTED)
    detail = _detail(silhouettes)
    surface = 4 * silhouettes.sum(axis=(1, 2)).mean() * detail * nearer
    faces = surface / (math.sqrt(3) / 4 * (EDGE / detail) ** 2)
    return int(np.clip(math.ceil(faces / 2 + 2), COUNTS[0], MOST))


def choose_report_count(silhouettes: np.ndarray) -> int:
    """The fewest of 642, 1,352 and 1,922 that are enough, or else the last."""
    enough = choose_count(silhouettes)
    return next((count for count in COUNTS if count >= enough), COUNTS[-1])


def _detail(silhouettes: np.ndarray) -> float:
    """How much longer the outlines are than those of their convex hulls, in a few views."""
    count = min(DETAILED, len(silhouettes))
    few = silhouettes[np.arange(count) * len(silhouettes) // count]
    few = [s for s in few if s.sum() > 3]
    around = [_measure_outline(s) / perimeter_crofton(convex_hull_image(s), 4) for s in few]
    return max(1.0, float(np.mean(around))) if few else 1.0


def _measure_outline(silhouette: np.ndarray) -> float:
    """The length of an outline in pixels, as smooth as the image resolves it.

    One that loses much of its length when it is blurred by a pixel is jagged by noise there; no
    triangles are spent on that.
    """
    length = perimeter_crofton(silhouette, 4)
    blurred = gaussian_filter(silhouette.astype(np.float32), BLUR) > 0.5
    smooth = perimeter_crofton(blurred, 4)
    return smooth if 0 < smooth < (1 - JAGGED) * length else length


def to_unit(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The same mesh about the origin, as large as the unit sphere: ``align: none``."""
    mesh = mesh.copy()
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    mesh.apply_scale(1 / np.linalg.norm(mesh.vertices, axis=1).max())
    return mesh


def align_to_box(verts: np.ndarray, silhouette: np.ndarray) -> np.ndarray:
    """The report's alignment: scale and shift x and y by the silhouette's bounding box.

    The box's sides are last index minus first, its unit is a pixel of a 256 x 256 image, in which
    the unit sphere, halved and seen by the report's cameras, has a radius of about 90.

    Args:
        verts: [verts, 3] of a unit mesh, not yet halved
        silhouette: [size, size] bool, of the first view
    Returns:
        [verts, 3]
    """
    left, top, width, height = _bounding_box(silhouette) * REPORT_SIZE / len(silhouette)
    half, r = REPORT_SIZE / 2, REPORT_RADIUS
    scale = np.array([width / 2 / r, height / 2 / r, 1])
    shift = np.array([-((half - width / 2) - left) / r, ((half - height / 2) - top) / r, 0])
    return verts * scale + shift


def _bounding_box(silhouette: np.ndarray) -> np.ndarray:
    """Left, top, width and height, the latter two as last index minus first."""
    left, top, right, bottom = find_box(silhouette)
    return np.array([left, top, right - 1 - left, bottom - 1 - top], dtype=np.float64)
