"""Photographs of a mesh from any cameras, by casting rays: the made-up counterpart of a studio.

The object turns and the lamps stand still in the room, so the lamps are fixed to the camera.
Light is Lambert's from a key lamp that casts soft shadows and from a fill lamp, an ambient light
from above dimmed by occlusion, and Blinn-Phong highlights with Schlick's approximation of
Fresnel's law. Shadows and occlusion are found at the vertices. Each pixel's colour is the mean of
2x2 rays; its mask is what one ray through its centre meets.

This renderer shares nothing with ``silmesh.softras``, so that what is fitted with the latter is
checked against pictures that it did not make.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from silmesh.geometry.camera import Cameras

Array = NDArray[np.floating]
Paint = Callable[[Array], Array]

RAYS = 2  # per pixel, along each of its sides

# In the camera's axes, so y is down and z away from the camera; towards the lamp.
KEY_LAMP = np.float32([-0.62, -0.68, -0.55])
FILL_LAMP = np.float32([0.85, -0.1, -0.55])
KEY, FILL, SKY, GROUND = 1.0, 0.2, 0.42, 0.12  # strengths
LAMP_SIZE = 0.15  # radius of the key lamp over its distance: softens the shadows
LAMP_RAYS, SKY_RAYS = 8, 64  # from each vertex, for shadows and for occlusion
DARKEST = 0.17  # of 0..1 on the screen: the room's stray light on black parts
SENSOR_NOISE = (0.5, 1.6)  # grey levels, on the background and on the object


def photograph(
    mesh: trimesh.Trimesh, cameras: Cameras, paint: Paint, seed: int = 0
) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.bool_]]]:
    """Photograph a mesh from each camera in turn, on a black background.

    Args:
        mesh: watertight and finely meshed, in the world of the cameras and before all of them
        cameras: any; their images may have any sizes
        paint: from points [n, 3] on the mesh to colour and shine [n, 4], see ``paints``
        seed: of the sensor's noise; the same seed gives the same bytes
    Yields:
        image [height, width, 3] and mask [height, width], true on the object
    """
    studio = _Studio(mesh, paint)
    for view in range(len(cameras)):
        picture, mask = studio.look(cameras.select([view]))
        yield _expose(picture, np.random.default_rng([seed, view])), mask


class _Studio:
    """A mesh made ready for rays."""

    def __init__(self, mesh: trimesh.Trimesh, paint: Paint):
        self.paint = paint
        self.outline = np.asarray(mesh.convex_hull.vertices)  # [outline, 3]
        verts = np.asarray(mesh.vertices, dtype=np.float32)  # [verts, 3]
        self.faces = np.asarray(mesh.faces, dtype=np.int32)  # [faces, 3]
        self.normals = np.asarray(mesh.vertex_normals, dtype=np.float32)  # [verts, 3]
        self.starts = verts + 0.004 * self.normals  # off the surface, so as not to meet it again
        self.scene = EmbreeScene()
        TriangleMesh(self.scene, verts, self.faces)
        self.openness = self._free_part(_spread_directions(SKY_RAYS))  # [verts]

    def look(self, camera: Cameras) -> tuple[Array, NDArray[np.bool_]]:
        """What one camera sees.

        Returns:
            red, green, blue and coverage [height, width, 4] in 0..1, and the mask [height, width]
        """
        width, height = camera.sizes[0].tolist()
        box = self._box(camera)
        left, top, right, bottom = box
        rows, columns = bottom - top, right - left
        picture = np.zeros((height, width, 4), dtype=np.float32)
        samples = self._see(camera, _ray_directions(camera, box, RAYS))
        samples = samples.reshape(RAYS * rows, RAYS * columns, 4)
        picture[top:bottom, left:right] = _average_blocks(samples)
        mask = np.zeros((height, width), dtype=bool)
        centres = self._cast(camera, _ray_directions(camera, box, 1))
        mask[top:bottom, left:right] = (centres["primID"] >= 0).reshape(rows, columns)
        return picture, mask

    def _box(self, camera: Cameras) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of the pixels that may see the object."""
        K, R, t, size = (a[0].numpy() for a in (camera.K, camera.R, camera.t, camera.sizes))
        seen = (self.outline @ R.T + t) @ K.T
        points = seen[:, :2] / seen[:, 2:]
        left, top = np.clip(np.floor(points.min(axis=0)), 0, size).astype(int)
        right, bottom = np.clip(np.ceil(points.max(axis=0)), 0, size).astype(int)
        return left, top, right, bottom

    def _cast(self, camera: Cameras, directions: Array) -> dict[str, Array]:
        """What rays [rays, 3] from a camera meet first, by Embree's names."""
        centres = np.tile(camera.centres.numpy().astype(np.float32), (len(directions), 1))
        return self.scene.run(centres, directions, output=True)

    def _see(self, camera: Cameras, directions: Array) -> Array:
        """Colour, and a 1 where there is any, at the end of each ray: [rays, 4]."""
        rays = self._cast(camera, directions)
        hit = np.flatnonzero(rays["primID"] >= 0)
        u, v = rays["u"][hit], rays["v"][hit]
        weights = np.stack([1 - u - v, u, v], axis=1)
        corners = self.faces[rays["primID"][hit]]  # [hits, 3]
        R = camera.R[0].numpy().astype(np.float32)
        lit = self._free_part(_unit(KEY_LAMP) @ R + LAMP_SIZE * _spread_directions(LAMP_RAYS))
        at_verts = np.column_stack([self.normals, self.openness, lit])
        at_hits = _interpolate(at_verts, corners, weights)
        ways = directions[hit]
        skin = self.paint(camera.centres[0].numpy().astype("f4") + rays["tfar"][hit, None] * ways)
        normals, openness, lit = at_hits[:, :3], at_hits[:, 3], at_hits[:, 4]
        seen = np.zeros((len(directions), 4), dtype=np.float32)
        seen[hit, :3] = shade(skin, _unit(normals), -_unit(ways), R, openness, lit)
        seen[hit, 3] = 1
        return seen

    def _free_part(self, directions: Array) -> Array:
        """Part of the light from some directions that reaches each vertex: [verts] in 0..1."""
        free = np.zeros(len(self.starts), dtype=np.float32)
        total = np.full(len(self.starts), 1e-6, dtype=np.float32)
        for direction in directions.astype(np.float32):
            cosine = self.normals @ direction
            facing = np.flatnonzero(cosine > 0)
            to_light = np.tile(direction, (len(facing), 1))
            blocked = self.scene.run(self.starts[facing], to_light, query="OCCLUDED") >= 0
            free[facing] += cosine[facing] * ~blocked
            total[facing] += cosine[facing]
        return free / total


def shade(
    skin: Array, normals: Array, to_eye: Array, R: Array, openness: Array, lit: Array
) -> Array:
    """Light that a surface sends to the eye, as a screen shows it: [n, 3] in 0..1.

    Args:
        skin: [n, 4] colour and shine, as a paint gives them
        normals, to_eye: [n, 3] unit vectors in the world
        R: [3, 3] from the world to the camera, to which the lamps are fixed
        openness: [n] part of the sky that the surface sees
        lit: [n] part of the key lamp that it sees
    """
    key, fill = _unit(KEY_LAMP) @ R, _unit(FILL_LAMP) @ R
    upwards = 0.5 - 0.5 * (normals @ R[1])
    falling = openness * (GROUND + (SKY - GROUND) * upwards)
    falling += KEY * lit * np.maximum(normals @ key, 0) + FILL * np.maximum(normals @ fill, 0)
    glance = 1 - np.clip(_dot(normals, to_eye), 0, 1)
    gloss = lit * _highlight(normals, to_eye, key) + 0.25 * _highlight(normals, to_eye, fill)
    reflected = skin[:, 3] * (0.7 * gloss + openness * (0.01 + 0.25 * glance**5))
    light = skin[:, :3] ** 2.2 * falling[:, None] + reflected[:, None]
    shown = (1 - np.exp(-1.6 * light)) ** (1 / 2.2)  # film's soft shoulder, the screen's gamma
    return np.sqrt(DARKEST**2 + (1 - DARKEST**2) * shown**2)


def _highlight(normals: Array, to_eye: Array, to_lamp: Array) -> Array:
    """Blinn-Phong: how close the normal [n, 3] is to halfway between the eye and the lamp."""
    return np.maximum(_dot(normals, _unit(to_eye + to_lamp)), 0) ** 64


def _ray_directions(camera: Cameras, box: tuple[int, int, int, int], along: int) -> Array:
    """Directions in the world through a box of pixels, row by row: [rays, 3] float32.

    Args:
        camera: one
        box: left, top, right, bottom in pixels
        along: rays along each side of a pixel, evenly about its centre
    """
    left, top, right, bottom = box
    to_world = camera.R[0].numpy().T @ np.linalg.inv(camera.K[0].numpy())
    part = (np.arange(along) + 0.5) / along
    u = (np.arange(left, right)[:, None] + part).reshape(-1, 1)
    v = (np.arange(top, bottom)[:, None] + part).reshape(-1, 1, 1)
    along_u, along_v, origin = to_world.T
    return (u * along_u + (v * along_v + origin)).reshape(-1, 3).astype(np.float32)


def _interpolate(values: Array, corners: Array, weights: Array) -> Array:
    """Values of vertices [verts, c] at points of faces, by barycentric weights: [n, c]."""
    return sum(weights[:, i, None] * values[corners[:, i]] for i in range(3))


def _average_blocks(samples: Array) -> Array:
    """Mean of each pixel's rays: [rows, columns, c] of rays to the same of pixels."""
    offsets = [(i, j) for i in range(RAYS) for j in range(RAYS)]
    return sum(samples[i::RAYS, j::RAYS] for i, j in offsets) / len(offsets)


def _spread_directions(count: int) -> Array:
    """Directions spread evenly over the sphere, on Fibonacci's spiral: [count, 3] float32."""
    y = 1 - (2 * np.arange(count) + 1) / count
    angle = np.arange(count) * (math.pi * (3 - math.sqrt(5)))
    out = np.sqrt(1 - y * y)
    return np.stack([out * np.cos(angle), y, out * np.sin(angle)], axis=1).astype(np.float32)


def _expose(picture: Array, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Add the sensor's noise to colour and coverage [height, width, 4], and round to bytes."""
    image, coverage = picture[..., :3], picture[..., 3:]
    behind, on = SENSOR_NOISE
    noise = rng.standard_normal(image.shape, dtype=np.float32)
    noise *= behind + (on - behind) * coverage
    return np.clip(np.rint(255 * image + noise), 0, 255).astype(np.uint8)


def _dot(a: Array, b: Array) -> Array:
    """Inner products of the rows of two arrays [n, 3]: [n]."""
    return np.einsum("ij,ij->i", a, b)


def _unit(vectors: Array) -> Array:
    """Vectors [3] or [n, 3] made one long."""
    return vectors / np.sqrt(np.einsum("...i,...i->...", vectors, vectors))[..., None]
