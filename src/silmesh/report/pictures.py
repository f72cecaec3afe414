"""A fitted mesh beside its photographs: outlines over the photograph, coloured, shaded, from above.

Two views are shown, the first and the one nearest to a quarter turn from it. What each pixel sees
is found by a ray through it, so the mesh is drawn exactly as the camera says. All is drawn twice
as large as it is shown and shrunk, which smooths the edges.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import trimesh
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import map_coordinates

from silmesh.geometry.camera import Cameras
from silmesh.geometry.textured_mesh import has_texture, picture_of
from silmesh.report.outlines import find_outlines

CELL = 264  # side of one picture, in pixels
CELLS = 5  # pictures of a view, side by side
FINE = 2  # drawn so many times larger than shown
GAP, HEADER, SIDE = 8, 30, 26
MARGIN = 0.14  # margin around the silhouette, over its longer side
RAISE, TURN = 35.0, 25.0  # degrees, of the view from above
GROUND, INK = (244, 243, 240), (36, 41, 47)
SILHOUETTE, MESH = (86, 180, 233), (230, 110, 0)  # told apart under colour blindness
OUTSIDE, INSIDE = np.array([0.84, 0.82, 0.78]), np.array([0.72, 0.36, 0.33])
# Directions towards the lights, in the camera's x right, y down, z forward, and their strengths.
LIGHTS = (((-0.45, -0.9, -0.6), 0.95), ((0.8, 0.1, -0.6), 0.35))
AMBIENT = 0.12
RELIGHT = 0.6  # share of the light that dims colours


@dataclass(frozen=True)
class Camera:
    """One pinhole camera: as ``Cameras``, of one view.

    Attributes:
        K: [3, 3] in pixels of an image of ``size`` x ``size``
        R: [3, 3], t: [3], world to camera
    """

    K: np.ndarray
    R: np.ndarray
    t: np.ndarray
    size: int

    def cropped(self, left: float, top: float, side: float, size: int) -> "Camera":
        """The same camera for a square of its image, scaled to ``size``."""
        scale = size / side
        crop = np.array([[scale, 0, -scale * left], [0, scale, -scale * top], [0, 0, 1]])
        return replace(self, K=crop @ self.K, size=size)

    def project(self, verts: np.ndarray) -> np.ndarray:
        """World points [verts, 3], all before the camera, in its image: [verts, 2] pixels."""
        seen = (verts @ self.R.T + self.t) @ self.K.T
        return seen[:, :2] / seen[:, 2:]

    def rays(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the camera stands [3], and the way to each pixel's centre [size, size, 3]."""
        along = np.arange(self.size) + 0.5
        pixels = np.stack([*np.meshgrid(along, along), np.ones((self.size, self.size))], axis=-1)
        return -self.R.T @ self.t, pixels @ np.linalg.inv(self.K).T @ self.R


@dataclass(frozen=True)
class Hits:
    """What the pixels see of a mesh.

    Attributes:
        mask: [size, size] bool, whether a pixel sees it
        faces: [hits] the face that each of these pixels sees
        weights: [hits, 3] where on the face: the shares of its corners
    """

    mask: np.ndarray
    faces: np.ndarray
    weights: np.ndarray


def camera_of(cameras: Cameras, i: int) -> Camera:
    """The camera of one view."""
    K, R, t = (part[i].double().numpy() for part in (cameras.K, cameras.R, cameras.t))
    return Camera(K, R, t, int(cameras.sizes[i].max()))


def quarter_turn(cameras: Cameras) -> int:
    """The view whose axis is nearest to a right angle with the first view's."""
    axes = cameras.R[:, 2]
    return int((axes @ axes[0]).abs().argmin())


def trace(mesh: trimesh.Trimesh, camera: Camera) -> Hits:
    """Find the face that each pixel's ray meets first, and where."""
    origin, rays = camera.rays()
    rays = rays.reshape(-1, 3)
    faces = mesh.ray.intersects_first(np.broadcast_to(origin, rays.shape), rays)
    hit = faces >= 0
    corners = mesh.triangles[faces[hit]] - origin  # [hits, 3, 3]
    # A ray d meets the face at a mean of its corners a, b, c weighted by d.(b x c), ...
    across = np.cross(np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1))
    weights = np.einsum("nij,nj->ni", across, rays[hit])
    weights /= weights.sum(axis=1, keepdims=True)
    return Hits(hit.reshape(camera.size, camera.size), faces[hit], weights)


def shade(mesh: trimesh.Trimesh, camera: Camera, hits: Hits, smooth: bool) -> np.ndarray:
    """Light a mesh from beside the camera: [size, size, 3] in [0, 1] on the ground's colour.

    Faces that turn their inside to the camera are red.
    """
    light, inside = _light(mesh, camera, hits, smooth)
    image = np.broadcast_to(np.array(GROUND) / 255, (*hits.mask.shape, 3)).copy()
    image[hits.mask] = np.where(inside[:, None], INSIDE, OUTSIDE) * light[:, None]
    return image.clip(0, 1)


def relight(image: np.ndarray, mesh: trimesh.Trimesh, camera: Camera, hits: Hits) -> np.ndarray:
    """A painted mesh lit from beside the camera, its colours less dimmed than a shaded one's."""
    light, _ = _light(mesh, camera, hits, smooth=True)
    image = image.copy()
    image[hits.mask] *= (1 - RELIGHT + RELIGHT * light)[:, None]
    return image.clip(0, 1)


def _light(
    mesh: trimesh.Trimesh, camera: Camera, hits: Hits, smooth: bool
) -> tuple[np.ndarray, np.ndarray]:
    """How bright the mesh is in each pixel that sees it, and whether that sees its inside."""
    normals = mesh.face_normals[hits.faces]
    _, rays = camera.rays()
    inside = (normals * rays[hits.mask]).sum(axis=1) > 0
    if smooth:
        at_corners = mesh.vertex_normals[mesh.faces[hits.faces]]  # [hits, 3, 3]
        normals = np.einsum("ni,nij->nj", hits.weights, at_corners)
    seen = normals @ camera.R.T * np.where(inside, -1, 1)[:, None]
    seen /= np.maximum(np.linalg.norm(seen, axis=1, keepdims=True), 1e-12)
    light = np.full(len(seen), AMBIENT)
    for towards, strength in LIGHTS:
        light += strength * np.maximum(seen @ (np.array(towards) / np.linalg.norm(towards)), 0)
    return np.sqrt(light), inside


def paint(mesh: trimesh.Trimesh, hits: Hits) -> np.ndarray:
    """A mesh in its texture, or in the colours of its vertices, unlit.

    Returns:
        [size, size, 3] in [0, 1] on the ground's colour
    """
    image = np.broadcast_to(np.array(GROUND) / 255, (*hits.mask.shape, 3)).copy()
    corners = mesh.faces[hits.faces]
    if has_texture(mesh):
        uv = np.einsum("ni,nij->nj", hits.weights, np.asarray(mesh.visual.uv)[corners])
        image[hits.mask] = _look_up(np.asarray(picture_of(mesh)), uv) / 255
    else:
        at_corners = mesh.visual.vertex_colors[corners, :3] / 255  # [hits, 3, 3]
        image[hits.mask] = np.einsum("ni,nij->nj", hits.weights, at_corners)
    return image.clip(0, 1)


def _look_up(picture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """A texture's colours at texture coordinates [n, 2], bilinear: [n, 3]."""
    height, width = picture.shape[:2]
    places = [(1 - uv[:, 1]) * height - 0.5, uv[:, 0] * width - 0.5]
    layers = np.moveaxis(picture, 2, 0)
    found = [map_coordinates(layer, places, float, order=1, mode="nearest") for layer in layers]
    return np.stack(found, axis=1)


def draw_edges(
    image: np.ndarray, mesh: trimesh.Trimesh, camera: Camera, hits: Hits, width: float
) -> None:
    """Darken the pixels of ``image`` that lie within half of ``width`` of an edge they see."""
    corners = camera.project(mesh.vertices)[mesh.faces[hits.faces]]  # [hits, 3, 2]
    pixels = np.argwhere(hits.mask)[:, None, ::-1] + 0.5
    edges = np.roll(corners, -1, axis=1) - corners
    off = pixels - corners
    across = np.abs(edges[..., 0] * off[..., 1] - edges[..., 1] * off[..., 0])
    distance = (across / np.maximum(np.linalg.norm(edges, axis=2), 1e-9)).min(axis=1)
    cover = 0.32 * np.clip(width / 2 + 0.5 - distance, 0, 1)[:, None]
    image[hits.mask] = image[hits.mask] * (1 - cover) + np.array(INK) / 255 * cover


def raised(camera: Camera, mesh: trimesh.Trimesh) -> Camera:
    """The camera raised and turned about the mesh's middle, the mesh filling its image."""
    middle = mesh.bounds.mean(axis=0)
    turn = trimesh.transformations.rotation_matrix
    tilt = turn(np.radians(RAISE), [1, 0, 0]) @ turn(np.radians(TURN), [0, 1, 0])
    R = tilt[:3, :3] @ camera.R
    t = camera.R @ middle + camera.t - R @ middle
    above = replace(camera, R=R, t=t)
    points = above.project(mesh.vertices)
    low, high = points.min(axis=0), points.max(axis=0)
    side = (1 + MARGIN) * (high - low).max()
    left, top = (low + high - side) / 2
    return above.cropped(left, top, side, camera.size)


def frame(silhouette: np.ndarray) -> tuple[float, float, float]:
    """Left, top and side of the square about a silhouette, with a margin, within its image."""
    rows, columns = np.nonzero(silhouette)
    low = np.array([columns.min(), rows.min()])
    high = np.array([columns.max(), rows.max()]) + 1
    size = min(silhouette.shape)
    side = min((1 + 2 * MARGIN) * float((high - low).max()), size)
    left, top = np.clip((low + high - side) / 2, 0, size - side)
    return float(left), float(top), side


def draw_outlines(
    image: Image.Image,
    mask: np.ndarray,
    scale: float,
    shift: Sequence[float],
    colour: tuple[int, int, int],
    edges: Sequence[int] | None = None,
) -> None:
    """Draw the outline of a mask over an image, light enough to see on dark and on light.

    Args:
        mask: [height, width] bool
        scale, shift: a point (u, v) of the mask, pixel centres at integer + 0.5, is drawn at
            scale ((u, v) - shift)
        edges: the frame of the photograph, along which there is no outline
    """
    draw = ImageDraw.Draw(image)
    lines = [[tuple(p) for p in (c - shift) * scale] for c in find_outlines(mask, edges)]
    for width, ink in ((3 * FINE, INK), (2 * FINE, colour)):
        for line in lines:
            draw.line(line, fill=ink, width=width, joint="curve")


def draw_picture(
    mesh: trimesh.Trimesh,
    cameras: Cameras,
    photographs: Sequence[Path],
    silhouettes: np.ndarray,
    frames: Sequence[Sequence[int]] | None = None,
) -> Image.Image:
    """Draw a fitted mesh beside two of its photographs.

    Args:
        mesh: in the cameras' world
        cameras: of the views to show
        photographs: their working images
        silhouettes: [views, height, width] bool, theirs
        frames: [views, 4] of the photographs within these; their outlines are closed if not given
    """
    rows = len(cameras)
    spoken = [None] * rows if frames is None else frames
    width = SIDE + CELLS * CELL + (CELLS + 1) * GAP
    sheet = Image.new("RGB", (width, HEADER + rows * (CELL + GAP)), GROUND)
    _write_header(sheet)
    for i, photograph in enumerate(photographs):
        cells = draw_view(mesh, camera_of(cameras, i), photograph, silhouettes[i], spoken[i])
        y = HEADER + i * (CELL + GAP)
        _write_side(sheet, cameras.views[i], y)
        for j, cell in enumerate(cells):
            sheet.paste(cell, (SIDE + GAP + j * (CELL + GAP), y))
    return sheet


def draw_view(
    mesh: trimesh.Trimesh,
    camera: Camera,
    photograph: Path,
    silhouette: np.ndarray,
    edges: Sequence[int] | None = None,
) -> list[Image.Image]:
    """The pictures of one view: photograph, outlines, shaded, coloured, from above with edges."""
    left, top, side = frame(silhouette)
    near = camera.cropped(left, top, side, FINE * CELL)
    photo = read_on_ground(photograph).resize(
        (near.size, near.size), Image.Resampling.BICUBIC, box=(left, top, left + side, top + side)
    )
    hits = trace(mesh, near)
    outlined = photo.copy()
    draw_outlines(outlined, silhouette, near.size / side, (left, top), SILHOUETTE, edges)
    draw_outlines(outlined, hits.mask, 1, (0, 0), MESH)
    shaded = shade(mesh, near, hits, smooth=True)
    coloured = paint(mesh, hits)
    above = raised(near, mesh)
    hits = trace(mesh, above)
    edged = shade(mesh, above, hits, smooth=False)
    draw_edges(edged, mesh, above, hits, width=0.5 * FINE)
    drawn = (to_image(cell) for cell in (shaded, coloured, edged))
    return [_shrink(cell) for cell in (photo, outlined, *drawn)]


def read_on_ground(path: Path) -> Image.Image:
    """A picture in RGB, what is transparent in the ground's colour."""
    with Image.open(path) as image:
        image = image.convert("RGBA")
    return Image.alpha_composite(Image.new("RGBA", image.size, GROUND), image).convert("RGB")


def to_image(image: np.ndarray) -> Image.Image:
    """An array [height, width, 3] in [0, 1] as an image."""
    return Image.fromarray((255 * image).round().astype(np.uint8))


def _shrink(image: Image.Image) -> Image.Image:
    return image.resize((CELL, CELL), Image.Resampling.BOX)


def font(size: int) -> ImageFont.FreeTypeFont:
    """The face that matplotlib brings along: it has most of the world's letters."""
    return ImageFont.truetype(Path(mpl.get_data_path()) / "fonts/ttf/DejaVuSans.ttf", size)


def _write_header(sheet: Image.Image) -> None:
    draw = ImageDraw.Draw(sheet)
    titles = ("photograph", "outlines:", "fitted mesh", "in its colours", "from above, with edges")
    for j, title in enumerate(titles):
        x = SIDE + GAP + j * (CELL + GAP)
        draw.text((x, HEADER / 2), title, fill=INK, font=font(13), anchor="lm")
    x = SIDE + GAP + CELL + GAP + 74
    for name, colour in (("silhouette", SILHOUETTE), ("mesh", MESH)):
        draw.line(((x, HEADER / 2), (x + 18, HEADER / 2)), fill=INK, width=5)
        draw.line(((x + 1, HEADER / 2), (x + 17, HEADER / 2)), fill=colour, width=3)
        draw.text((x + 24, HEADER / 2), name, fill=INK, font=font(13), anchor="lm")
        x += 24 + draw.textlength(name, font(13)) + 14


def _write_side(sheet: Image.Image, name: str, y: int) -> None:
    """Write a view's name upwards at the left of its row, its middle left out if it is long."""
    face = font(12)
    strip = Image.new("RGB", (CELL, SIDE), GROUND)
    draw = ImageDraw.Draw(strip)
    kept = len(name)
    shown = name
    while draw.textlength(shown, face) > CELL:
        kept -= 1
        shown = name[: kept // 2] + "…" + name[len(name) - (kept + 1) // 2 :]
    draw.text((CELL / 2, SIDE / 2), shown, fill=INK, font=face, anchor="mm")
    sheet.paste(strip.rotate(90, expand=True), (GAP // 2, y))


def crop_thumbnail(picture: Image.Image) -> Image.Image:
    """The first view's shaded mesh out of a picture."""
    left = SIDE + GAP + 2 * (CELL + GAP)
    return picture.crop((left, HEADER, left + CELL, HEADER + CELL))
