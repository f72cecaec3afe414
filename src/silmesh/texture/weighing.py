"""How well each photograph sees points of a mesh, before it is asked whether views agree.

    w = cos^SQUARE (normal, ray) f(d) s^2

f rises with the distance d to the outline from FAINT, ERODE pixels of the working image within it,
to 1, FEATHER pixels further in, all as for colours of the vertices; s is pixels a length on a
surface that faces the camera.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from silmesh.geometry.camera import Cameras
from silmesh.geometry.originals import Originals
from silmesh.texture.bands import Slow, take_slow
from silmesh.texture.sampling import sample_all
from silmesh.texture.vertex_colours import ERODE, FAINT, FEATHER, SQUARE
from silmesh.texture.visibility import Sight, look, measure, shrink


@dataclass(frozen=True)
class Shot:
    """What is kept of a photograph while others are read.

    Attributes:
        index: of the photograph
        outline: [height, width] bool, its silhouette, small
        slow: its slow band
        near, far: distances to an outline in pixels of the photograph between which f rises
    """

    index: int
    outline: np.ndarray
    slow: Slow
    near: float
    far: float


@dataclass(frozen=True)
class Points:
    """Points of a mesh's surface with their normals, [points, 3]."""

    mesh: trimesh.Trimesh
    positions: np.ndarray
    normals: np.ndarray


@dataclass(frozen=True)
class Seen:
    """What a view sees of points: its sight, their slow colours [points, 3], weights [points]."""

    shot: Shot
    sight: Sight
    colours: np.ndarray
    weights: np.ndarray


def take_shot(
    originals: Originals, i: int, silhouette: np.ndarray, scale: np.ndarray
) -> tuple[Shot, np.ndarray, np.ndarray]:
    """Read a photograph: what is kept, itself [height, width, 3], its silhouette [height, width].

    Args:
        originals: no larger than needed, since only what is kept is used of them
        silhouette: [size, size] bool, of the working image
        scale: [2] pixels of the photograph at its own size, in which lengths are kept, a pixel of
            these, across and down
    """
    photograph, outline = originals.read(i), originals.enlarge(i, silhouette)
    pixel = scale.max() * max(outline.shape) / len(silhouette)
    slow = take_slow(photograph, outline, scale)
    shot = Shot(i, shrink(outline), slow, ERODE * pixel, (ERODE + FEATHER) * pixel)
    return shot, photograph, outline


def weigh(points: Points, cameras: Cameras, k: int, shot: Shot) -> Seen:
    """See points by the k-th camera, whose photograph that is."""
    P, eye, size = cameras.projections[k].numpy(), cameras.centres[k].numpy(), cameras.sizes[k]
    verts, faces = np.asarray(points.mesh.vertices), np.asarray(points.mesh.faces, np.int64)
    sight = look(verts, faces, P, tuple(size.tolist()), shot.outline)
    pixels, cosine, margin = measure(sight, eye, points.positions, points.normals)
    rise = ((margin - shot.near) / (shot.far - shot.near)).clip(FAINT, 1) * (margin > shot.near)
    depths = points.positions @ P[2, :3] + P[2, 3]
    density = float(np.linalg.det(cameras.K[k].numpy())) / depths**2
    colours = sample_all(shot.slow.image, pixels / shot.slow.step)
    return Seen(shot, sight, colours, cosine**SQUARE * rise * density)


def even_out(weights: Sequence[np.ndarray]) -> np.ndarray:
    """Weights of all views [views, points], about 1 where points are seen best."""
    stacked = np.stack(weights)
    return stacked / max(float(np.quantile(stacked, 0.99)), 1e-12)
