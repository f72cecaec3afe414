"""Bodies that are carved: the visual hull of all views, and the prism of two.

Their surfaces are drawn from a sampled field, in one piece, and given even triangles.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from silmesh.errors import InputError
from silmesh.geometry.camera import OBJECT_RADIUS, Cameras
from silmesh.geometry.frame import find_whole, known_pixels
from silmesh.geometry.overlap import mean_iou
from silmesh.geometry.robust_hull import RobustHull, robust_carve
from silmesh.geometry.thresholds import COHERENT
from silmesh.geometry.visual_hull import Hull, carve, find_outlier_views
from silmesh.shapes.downsample import downsample, downsample_frames, render
from silmesh.shapes.ellipsoid import find_ellipsoid
from silmesh.shapes.even import even_mesh

RESOLUTION = 128  # samples a side of the final hull
# To save time, remeshing starts from a surface sampled more coarsely than RESOLUTION, if that has
# at least FINER times the wanted vertices and FINE vertices, and a volume that is off by at most
# ALIKE.
FINER = 3
FINE = 3000
ALIKE = 0.01
TOLERATED = (0, 1, 2, 4, 8)  # numbers of disagreeing views that are tried, in this order
MOST_TOLERATED = 1 / 6  # greatest share of all views that may disagree
# Pixels a side, number of views, and samples of a side of the hull in these trials.
SIZE, VIEWS, SAMPLES = 96, 18, 48
# Radii of the morphological closings that are tried on tunnels, as shares of the body's extent.
CLOSINGS = np.array([1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2])
FRONTS = 8  # number of views whose prisms are tried
# The depth of a prism is measured in another view if the cosine of their optical axes is at most
# this.
ACROSS = 0.9


class EmptyHull(InputError):  # noqa: N818
    """The silhouettes and cameras leave nothing; says which views empty it."""


@dataclass(frozen=True)
class Carved:
    """A carved body, and how it was carved.

    Attributes:
        mesh: closed, in one piece, oriented outwards
        tolerated: how many views were allowed to disagree
        pieces: number of connected pieces, of which the largest is kept
        lost: share of the volume in the other pieces
        robust: how far each view was believed; None of a prism
        hull: what it is drawn from; None of a prism
    """

    mesh: trimesh.Trimesh
    tolerated: int
    pieces: int
    lost: float
    robust: RobustHull | None = None
    hull: Hull | None = None


def hull_mesh(
    silhouettes: np.ndarray,
    cameras: Cameras,
    vertices: int,
    genus: str,
    frames: np.ndarray | None = None,
) -> Carved:
    """The visual hull as an initial mesh, robust where silhouettes contradict each other.

    Args:
        silhouettes: [views, height, width] bool
        cameras: of these views, in the normalised world
        vertices: how many
        genus: ``keep`` its tunnels, or close them for a ``sphere``
        frames: [views, 4] of the photographs within the images; the whole images if not given

    Raises:
        EmptyHull: names the views that empty it
    """
    found = robust_carve(silhouettes, cameras, frames, RESOLUTION)
    hull, tolerated = found.hull, 0
    if not found.explained:  # nor need the robust one: cameras, too, can be a little wrong
        believed = found.believed(silhouettes, cameras, frames)
        tolerated = choose_tolerated(*believed)
        if tolerated:
            masks, kept, spoken = believed
            hull = carve(masks, kept, RESOLUTION, tolerated, spoken)
    if hull.empty:
        views = [cameras.views[i] for i in find_outlier_views(silhouettes, cameras, frames)]
        raise EmptyHull(
            "the visual hull is empty: the cameras and the silhouettes contradict each other, most "
            f"of all in {', '.join(views)}"
        )
    return replace(draw(hull, vertices, genus), tolerated=tolerated, robust=found, hull=hull)


def prism_mesh(
    silhouettes: np.ndarray,
    cameras: Cameras,
    vertices: int,
    genus: str,
    frames: np.ndarray | None = None,
) -> Carved:
    """The silhouette of one view, extruded through the depth that another shows.

    Of several views the one is taken whose prism fills the silhouettes best.

    Args:
        silhouettes, cameras, vertices, genus, frames: as for ``hull_mesh``
    """
    centre = find_ellipsoid(silhouettes, cameras, frames).centre
    whole = find_whole(silhouettes, frames)
    silhouettes, cameras = silhouettes[whole], cameras.select(whole)
    frames = frames if frames is None else frames[whole]
    tried = np.unique(np.arange(FRONTS) * len(cameras) // FRONTS)
    coarse = {front: _prism(silhouettes, cameras, centre, front, SAMPLES) for front in tried}
    filled = {front: hull for front, hull in coarse.items() if not hull.empty}
    if not filled:
        raise EmptyHull("no view's silhouette can be extruded: they miss each other")
    best = max(filled, key=lambda front: _hull_iou(filled[front], silhouettes, cameras, frames))
    return draw(_prism(silhouettes, cameras, centre, best, RESOLUTION), vertices, genus)


def _prism(
    silhouettes: np.ndarray, cameras: Cameras, centre: np.ndarray, front: int, resolution: int
) -> Hull:
    """The cone of one view between two planes that face it."""
    axis = cameras.R[front, 2].numpy()
    depth = float(axis @ centre + cameras.t[front, 2])
    low, high = _depth(silhouettes, cameras, centre, axis)
    cone = carve(silhouettes[[front]], cameras.select([front]), resolution)
    steps = [
        part * (first + np.arange(n) * step)
        for part, first, n, step in zip(
            axis, cone.origin, cone.field.shape, cone.spacing, strict=True
        )
    ]
    along = steps[0][:, None, None] + steps[1][:, None] + steps[2] - axis @ centre
    inside = np.minimum(along - low, high - along) * float(cameras.K[front, 0, 0]) / depth
    return Hull(np.minimum(cone.field, inside.astype(np.float32)), cone.origin, cone.spacing)


def _depth(
    silhouettes: np.ndarray, cameras: Cameras, centre: np.ndarray, axis: np.ndarray
) -> tuple[float, float]:
    """How far the object reaches from its centre along an axis, seen most from the side.

    Each pixel's ray is followed to the plane through the centre that faces its camera.
    """
    facing = cameras.R[:, 2].numpy()
    side = int(np.abs(facing @ axis).argmin())
    across = axis - (axis @ facing[side]) * facing[side]
    if np.abs(facing[side] @ axis) > ACROSS:
        return -OBJECT_RADIUS / 2, OBJECT_RADIUS / 2
    pixels = np.argwhere(silhouettes[side])[:, ::-1] + 0.5
    K, R, t = (part[side].numpy() for part in (cameras.K, cameras.R, cameras.t))
    rays = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1) @ np.linalg.inv(K).T
    depth = facing[side] @ centre + t[2]
    points = (rays * depth - t) @ R
    reach = (points - centre) @ across / np.linalg.norm(across)
    return float(reach.min()), float(reach.max())


def choose_tolerated(
    silhouettes: np.ndarray, cameras: Cameras, frames: np.ndarray | None = None
) -> int:
    """How many views may disagree: none if the hull fills the silhouettes, else what does it best.

    With n views from all around a hull that lets one disagree is only little thicker; that of few
    views would be much thicker, so that no more than a sixth of them may.
    """
    small, small_cameras = downsample(silhouettes, cameras, SIZE, len(cameras))
    spoken = downsample_frames(silhouettes, SIZE, len(cameras), frames)
    best, chosen = -1.0, 0
    for tolerated in TOLERATED:
        if tolerated > MOST_TOLERATED * len(cameras):
            break
        hull = carve(small, small_cameras, SAMPLES, tolerated, spoken)
        iou = 0.0 if hull.empty else _hull_iou(hull, small, small_cameras, spoken)
        if iou > best:
            best, chosen = iou, tolerated
        if iou >= COHERENT:
            break
    return chosen


def _hull_iou(
    hull: Hull, silhouettes: np.ndarray, cameras: Cameras, frames: np.ndarray | None
) -> float:
    small, small_cameras = downsample(silhouettes, cameras, SIZE, VIEWS)
    spoken = downsample_frames(silhouettes, SIZE, VIEWS, frames)
    mesh = trimesh.Trimesh(*hull.surface(), process=False)
    return mean_iou(
        render(mesh, small_cameras, small.shape[1:]), small, known_pixels(small, spoken)
    )


def draw(hull: Hull, vertices: int, genus: str) -> Carved:
    """A field's surface as a mesh of so many vertices, its largest piece only.

    Tunnels that are narrower than an edge are closed: no triangle would go through them.
    """
    surface, pieces, lost = _largest(hull)
    if surface.euler_number != 2:
        if genus == "sphere":
            hull = hull.coarser(2)  # what it closes is wide
            radii = CLOSINGS * float(surface.extents.max())
        else:
            radii = [float(np.sqrt(surface.area / (np.sqrt(3) / 2 * vertices))) / 2]
        hull = _close_tunnels(hull, radii)
        surface, _, _ = _largest(hull)
    for every in (3, 2):
        coarser, _, _ = _largest(hull.coarser(every))
        alike = abs(coarser.volume - surface.volume) < ALIKE * surface.volume
        same = coarser.euler_number == surface.euler_number
        if alike and same and len(coarser.vertices) > max(FINE, FINER * vertices):
            surface = coarser
            break
    return Carved(even_mesh(surface, vertices), 0, pieces, lost)


def _largest(hull: Hull) -> tuple[trimesh.Trimesh, int, float]:
    """The surface of a field's largest piece, how many pieces there are, and the others' share.

    Walls of hollows inside, whose volume is negative, are left out and not counted.
    """
    verts, faces = hull.surface()
    edges = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_array((np.ones(len(edges)), edges.T), shape=(len(verts), len(verts)))
    _, piece = connected_components(graph, directed=False)
    volume = np.bincount(piece[faces[:, 0]], _volumes(verts, faces), minlength=piece.max() + 1)
    largest = int(volume.argmax())
    kept = faces[piece[faces[:, 0]] == largest]
    used, numbered = np.unique(kept, return_inverse=True)
    mesh = trimesh.Trimesh(verts[used], numbered.reshape(-1, 3), process=False)
    solid = volume[volume > 0]
    return mesh, len(solid), float(1 - volume[largest] / solid.sum())


def _volumes(verts: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (verts[faces[:, i]] for i in range(3))
    return (a * np.cross(b, c)).sum(axis=1) / 6


def _close_tunnels(hull: Hull, radii: Sequence[float]) -> Hull:
    """Grow the body and shrink it again, by the first of these radii that leaves no tunnel.

    Where that fills nothing the field stays as it is, finer than its samples.

    Args:
        radii: in the world, rising; if none of them leaves no tunnel it is the last
    """
    for radius in radii:
        margin = np.ceil(radius / hull.spacing).astype(int) + 2
        around = [(n, n) for n in margin]
        solid = np.pad(hull.field > 0, around)
        grown = distance_transform_edt(~solid, sampling=hull.spacing) < radius
        shrunk = distance_transform_edt(grown, sampling=hull.spacing) - radius
        filled = np.where(solid, 0, np.maximum(shrunk, 0)).astype(np.float32)
        field = np.pad(hull.field, around, constant_values=hull.field.min())
        origin = hull.origin - margin * hull.spacing
        closed = Hull(np.where(filled > 0, filled, field), origin, hull.spacing)
        if _largest(closed)[0].euler_number == 2:
            break
    return closed


# By the names of their shapes; each takes silhouettes, cameras, a count of vertices, a genus and
# the photographs' frames.
CARVED: dict[str, Callable[[np.ndarray, Cameras, int, str, np.ndarray | None], Carved]] = {
    "prism": prism_mesh,
    "hull": hull_mesh,
}
