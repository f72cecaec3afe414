"""Photographs of a mesh from any cameras, by casting rays: the made-up counterpart of a studio.

The object turns and the lamps stand still in the room, so the lamps are fixed to the camera.
Light is Lambert's from a key lamp that casts shadows and from a fill lamp, an ambient light from
above dimmed by occlusion, and Blinn-Phong highlights with Schlick's approximation of Fresnel's
law. Each pixel takes 2x2 rays; its mask is set where at least half of them meet the object.

This renderer shares nothing with ``silmesh.softras``, so that what is fitted with the latter is
checked against pictures that it did not make.
"""

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray
from torch import Tensor

from silmesh.cameras.camera import Cameras

Array = NDArray[np.floating]
Paint = Callable[[Array], Array]

RAYS = 2  # per pixel, along each of its sides
DISTANCE = 2.732  # of the turntable's camera from the origin
ELEVATION = 10.0  # degrees: it looks slightly down
HALF_VIEW = 15.0  # degrees of view over half of the longer side

# In the camera's axes, so y is down and z away from the camera; towards the lamp.
KEY_LAMP = np.array([-0.62, -0.68, -0.55])
FILL_LAMP = np.array([0.85, -0.1, -0.55])
KEY, FILL, SKY, FLOOR = 0.95, 0.22, 0.42, 0.12  # strengths
LAMP_SIZE = 0.12  # radius of the key lamp over its distance: softens the shadows
DARKEST = 0.2  # of 0..1 on the screen: the room's stray light on black parts
SENSOR_NOISE = (0.7, 1.6)  # grey levels, on the background and on the object


def turntable_cameras(
    views: Sequence[str],
    sizes: Tensor,
    distance: float = DISTANCE,
    elevation: float = ELEVATION,
    step: float = 5.0,
) -> Cameras:
    """Cameras on a circle about the y axis that look at the origin.

    Args:
        views: names
        sizes: [views, 2] width and height in pixels
        distance: from the origin, in world units
        elevation: above the plane y = 0, in degrees
        step: from each view to the next, in degrees; the first stands over the z axis
    """
    azimuths = torch.arange(len(views), dtype=torch.float64) * math.radians(step)
    sine, cosine = azimuths.sin(), azimuths.cos()
    e = math.radians(elevation)
    right = torch.stack([cosine, torch.zeros_like(sine), -sine], dim=1)
    forward = -torch.stack(
        [math.cos(e) * sine, torch.full_like(sine, math.sin(e)), math.cos(e) * cosine], dim=1
    )
    R = torch.stack([right, torch.linalg.cross(forward, right), forward], dim=1)
    t = torch.tensor([0, 0, distance], dtype=torch.float64).repeat(len(views), 1)
    K = torch.eye(3, dtype=torch.float64).repeat(len(views), 1, 1)
    half = sizes.to(torch.float64) / 2
    K[:, 0, 0] = K[:, 1, 1] = half.amax(dim=1) / math.tan(math.radians(HALF_VIEW))
    K[:, :2, 2] = half
    return Cameras(tuple(views), sizes, K, R, t)


def photograph(
    mesh: trimesh.Trimesh, cameras: Cameras, paint: Paint | None = None, seed: int = 0
) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.bool_]]]:
    """Photograph a mesh from each camera in turn, on a black background.

    Args:
        mesh: watertight, in the world of the cameras and before all of them
        cameras: any; their pixels may have any sizes
        paint: from points [n, 3] on the mesh to colour and shine [n, 4], see ``paints``; without
            one, the colours of the mesh's vertices
        seed: of the sensor's noise and of the soft shadows; the same seed gives the same bytes
    Yields:
        image [height, width, 3] and mask [height, width], true on the object
    """
    studio = _Studio(mesh, paint)
    for view in range(len(cameras)):
        yield studio.photograph(cameras.select([view]), np.random.default_rng([seed, view]))


class _Studio:
    """A mesh made ready for rays."""

    def __init__(self, mesh: trimesh.Trimesh, paint: Paint | None):
        self.verts = np.asarray(mesh.vertices, dtype=np.float32)  # [verts, 3]
        self.faces = np.asarray(mesh.faces, dtype=np.int32)  # [faces, 3]
        self.scene = EmbreeScene()
        TriangleMesh(self.scene, self.verts, self.faces)
        self.normals = np.asarray(mesh.vertex_normals, dtype=np.float32)  # [verts, 3]
        self.reach = 1e-4 * float(mesh.scale)  # by which rays start off the surface
        self.open = self._openness()  # [verts]
        self.colours = np.asarray(mesh.visual.vertex_colors[:, :3], dtype=np.float32) / 255
        self.paint = paint

    def photograph(self, camera: Cameras, rng: np.random.Generator) -> tuple[Array, Array]:
        """The image [height, width, 3] and the mask [height, width] of one camera."""
        width, height = camera.sizes[0].tolist()
        left, top, right, bottom = self._box(camera, width, height)
        directions = _ray_directions(camera, left, top, right, bottom)
        centre = camera.centres[0].numpy().astype(np.float32)
        hit, colours = self._look(centre, directions, camera.R[0].numpy(), rng)
        sampled = np.zeros((len(directions), 3), dtype=np.float32)
        sampled[hit] = colours
        blocks = (bottom - top, RAYS, right - left, RAYS)
        coverage = np.zeros((height, width), dtype=np.float32)
        coverage[top:bottom, left:right] = hit.reshape(blocks).mean(axis=(1, 3))
        image = np.zeros((height, width, 3), dtype=np.float32)
        image[top:bottom, left:right] = sampled.reshape(*blocks, 3).mean(axis=(1, 3))
        return _expose(image, coverage, rng), coverage >= 0.5

    def _box(self, camera: Cameras, width: int, height: int) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of the pixels that can see the object."""
        points = camera.project(torch.from_numpy(self.verts).double())[0].numpy()
        low = np.clip(np.floor(points.min(axis=0)), 0, (width, height)).astype(int)
        high = np.clip(np.ceil(points.max(axis=0)), 0, (width, height)).astype(int)
        return low[0], low[1], high[0], high[1]

    def _look(
        self, centre: Array, directions: Array, R: Array, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Which rays [n, 3] from a centre meet the object, and the colours that those see."""
        centres = np.broadcast_to(centre, directions.shape).copy()
        rays = self.scene.run(centres, directions, output=True)
        hit = rays["primID"] >= 0
        corners = self.faces[rays["primID"][hit]]  # [hits, 3]
        u, v = rays["u"][hit], rays["v"][hit]
        weights = np.stack([1 - u - v, u, v], axis=1)[:, None]  # [hits, 1, 3]
        points = (weights @ self.verts[corners])[:, 0]
        normals = _unit((weights @ self.normals[corners])[:, 0])
        openness = (weights[:, 0] * self.open[corners]).sum(axis=1)
        if self.paint is None:
            colours, shine = (weights @ self.colours[corners])[:, 0], np.float32(0.2)
        else:
            coat = self.paint(points)
            colours, shine = coat[:, :3], coat[:, 3]
        lit = self._lit(points, normals, R, rng)
        return hit, shade(colours, shine, normals, -directions[hit], R, openness, lit)

    def _lit(self, points: Array, normals: Array, R: Array, rng: np.random.Generator) -> Array:
        """1 where a ray to a random place of the key lamp is free, 0 in the shadow: [n]."""
        to_lamp = (_unit(KEY_LAMP) @ R).astype(np.float32)
        spread = rng.uniform(-LAMP_SIZE, LAMP_SIZE, points.shape).astype(np.float32)
        starts = points + self.reach * normals
        return self.scene.run(starts, to_lamp + spread, query="OCCLUDED") < 0

    def _openness(self, rays: int = 64) -> Array:
        """Part of the sky that each vertex sees, weighted by the cosine: [verts] in 0..1."""
        directions = _spread_directions(rays)
        starts = self.verts + self.reach * self.normals
        free, total = np.zeros(len(starts)), np.zeros(len(starts))
        for direction in directions:
            cosine = np.maximum(self.normals @ direction, 0)
            to = np.broadcast_to(direction, starts.shape).copy()
            free += cosine * (self.scene.run(starts, to, query="OCCLUDED") < 0)
            total += cosine
        return (free / np.maximum(total, 1e-6)).astype(np.float32)


def shade(
    colours: Array, shine: Array, normals: Array, to_eye: Array, R: Array, openness: Array, lit: Array
) -> Array:
    """Light that a surface sends to the eye, as the screen shows it: [n, 3] in 0..1.

    Args:
        colours: [n, 3] in 0..1, sRGB
        shine: [n] or one, 0..1
        normals, to_eye: [n, 3] unit vectors in the world
        R: [3, 3] from the world to the camera, to which the lamps are fixed
        openness: [n] part of the sky that the surface sees
        lit: [n] 0 where the key lamp is hidden
    """
    key, fill = (_unit(lamp) @ R for lamp in (KEY_LAMP, FILL_LAMP))
    up = -R[1]
    sky = openness * (FLOOR + (SKY - FLOOR) * (0.5 + 0.5 * normals @ up))
    falling = sky + lit * KEY * np.maximum(normals @ key, 0) + FILL * np.maximum(normals @ fill, 0)
    glance = 1 - np.clip((normals * to_eye).sum(axis=1), 0, 1)
    mirror = 0.04 + 0.96 * glance**5
    gloss = lit * _highlight(normals, to_eye, key) + 0.3 * _highlight(normals, to_eye, fill)
    reflected = shine * (0.45 * gloss + 0.35 * mirror * openness)
    light = colours**2.2 * falling[:, None] + reflected[:, None]
    shown = (1 - np.exp(-1.5 * light)) ** (1 / 2.2)  # film's soft shoulder, the screen's gamma
    return np.sqrt(DARKEST**2 + (1 - DARKEST**2) * shown**2)


def _highlight(normals: Array, to_eye: Array, to_lamp: Array, sharpness: float = 60) -> Array:
    """Blinn-Phong: how close the normal is to halfway between the eye and the lamp."""
    halfway = _unit(to_eye + to_lamp)
    return np.maximum((normals * halfway).sum(axis=1), 0) ** sharpness


def _ray_directions(camera: Cameras, left: int, top: int, right: int, bottom: int) -> Array:
    """Unit directions in the world through a box of pixels: [rows columns, 3], row by row."""
    part = (np.arange(RAYS) + 0.5) / RAYS
    u = (np.arange(left, right)[:, None] + part).ravel()
    v = (np.arange(top, bottom)[:, None] + part).ravel()
    places = np.stack([*np.meshgrid(u, v), np.ones((len(v), len(u)))], axis=-1).reshape(-1, 3)
    K, R = camera.K[0].numpy(), camera.R[0].numpy()
    return _unit(places @ np.linalg.inv(K).T @ R).astype(np.float32)


def _spread_directions(count: int) -> Array:
    """Directions spread evenly over the sphere, on Fibonacci's spiral: [count, 3] float32."""
    y = 1 - (2 * np.arange(count) + 1) / count
    angle = np.arange(count) * (math.pi * (3 - math.sqrt(5)))
    out = np.sqrt(1 - y * y)
    return np.stack([out * np.cos(angle), y, out * np.sin(angle)], axis=1).astype(np.float32)


def _expose(image: Array, coverage: Array, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Add the sensor's noise and round to bytes."""
    behind, on = SENSOR_NOISE
    noise = rng.standard_normal(image.shape, dtype=np.float32)
    noise *= (behind + (on - behind) * coverage)[..., None]
    return np.clip(np.rint(255 * image + noise), 0, 255).astype(np.uint8)


def _unit(vectors: Array) -> Array:
    """Vectors [..., 3] made one long."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
