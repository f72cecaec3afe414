"""Photographs of objects whose truth is known, by rays, and their way through the stages to a fit.

An object is written NAME[:PAINT]: one of the made-up ones (``bear``), ``bowl``, ``gap``, or a
scan's file without its ending (``blue_cup``). Paints:

    own      its texture, or the made-up object's colours without their gloss
    pattern  random detail at several lengths, as of printed paper
    plain    one colour
    gloss    the made-up object's colours in a studio whose lamps stand by the camera: highlights

The texture of ``blue_cup`` is one colour: ``blue_cup`` shows how its shading alone does, and
``blue_cup:pattern`` what a hollow needs. All but ``gloss`` are Lambertian in a light that is mild
and still. Each pixel is the mean of RAYS x RAYS rays; its mask is what one ray through its centre
meets.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import trimesh
from PIL import Image
from scenery import pattern, read_scan, stand_upright
from scipy.ndimage import map_coordinates

import silmesh
from silmesh.cameras.turntable import orbit_cameras
from silmesh.geometry.camera import Cameras, read_cameras, write_cameras
from silmesh.geometry.mesh_files import to_tensors
from silmesh.geometry.originals import Originals
from silmesh.geometry.silhouette_iou import silhouette_iou
from silmesh.report.pictures import Camera, camera_of, trace
from silmesh.settings.fit import FastFit
from silmesh.synthetic.dataset import find_paint, make_object, mesh_solid
from silmesh.synthetic.layout import OBJECTS
from silmesh.synthetic.orbit import DISTANCE
from silmesh.synthetic.photograph import photograph
from silmesh.synthetic.solids import ellipsoid, limb, subtract, unite

RAYS = 2
LIGHT, AMBIENT = np.array([0.4, 0.8, 0.45]), 0.7  # towards a lamp in the world; the rest of it
PLAIN = (0.62, 0.6, 0.57)
BLACK = 0.02  # of the screen: the ground behind the object
VIEWS = 36
UP = {"blue_cup": 2}  # the axis that is up in a scan's file, where it is not y

Paint = Callable[[np.ndarray], np.ndarray]  # points [n, 3] to colour and shine [n, 4]


@dataclass(frozen=True)
class Case:
    """One object, how it is painted, and from which heights it is seen.

    Attributes:
        name, paint: as above
        rings: degrees of elevation; the views take turns on them
    """

    name: str
    paint: str
    rings: tuple[float, ...]

    @classmethod
    def parse(cls, text: str) -> "Case":
        """Of OBJECT[:PAINT][@RING+RING]."""
        body, _, rings = text.partition("@")
        name, _, paint = body.partition(":")
        return cls(name, paint or "own", tuple(map(float, (rings or "10+40").split("+"))))

    def __str__(self) -> str:
        return f"{self.name}:{self.paint}@{'+'.join(f'{ring:g}' for ring in self.rings)}"

    @property
    def file_name(self) -> str:
        """The same as a file's name."""
        return str(self).replace(":", "-")


@dataclass(frozen=True)
class Fitted:
    """A case after its photographs, its silhouettes and the fit.

    Attributes:
        truth: the true mesh, in the world of the cameras
        mesh: as the stages hull and fast leave it
        cameras: in pixels of the working images
        silhouettes: [views, height, width] bool, of the working images
        originals: the photographs at their own size
        full: silhouettes of the photographs at their own size, exact
        placed: cameras of the photographs at their own size, exact
    """

    truth: trimesh.Trimesh
    mesh: trimesh.Trimesh
    cameras: Cameras
    silhouettes: np.ndarray
    originals: Originals
    full: np.ndarray
    placed: Cameras

    def measure_iou(self, mesh: trimesh.Trimesh) -> float:
        """Mean IoU of a mesh with the silhouettes of the working images."""
        sigma = FastFit().sigma_at(self.silhouettes.shape[-1])
        seen = silhouette_iou(*to_tensors(mesh), self.cameras, self.silhouettes, sigma)
        return float(seen.mean())


def parser(said: str | None, cases: Sequence[str], size: int) -> argparse.ArgumentParser:
    """What a command about cases is told.

    Args:
        said: about the command
        cases: if none are given
        size: of the photographs, likewise
    """
    args = argparse.ArgumentParser(
        description=said, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    args.add_argument("cases", nargs="*", default=cases, help="OBJECT[:PAINT][@RING+RING]")
    args.add_argument("--scans", type=Path, default=Path("../shared/data/scans"))
    args.add_argument("--size", type=int, default=size, help="of the photographs, in pixels")
    args.add_argument("--working", type=int, default=256, help="of the working images")
    args.add_argument("--keep", type=Path, help="folder of photographs and fits, kept for later")
    return args


def bowl(points: np.ndarray) -> np.ndarray:
    """Signed distance of a thick bowl: deep, and open above."""
    outer = ellipsoid(points, (0, 0.1, 0), (0.36, 0.42, 0.36))
    hollow = ellipsoid(points, (0, 0.1, 0), (0.29, 0.34, 0.29))
    return np.maximum(subtract(outer, hollow), points[:, 1] - 0.12)


def gap(points: np.ndarray) -> np.ndarray:
    """Signed distance of two rods that lean on each other: a hole that few outlines show."""
    rods = [limb(points, (x, -0.35, 0), (0.4 * x, 0.3, 0), (0.11, 0.1)) for x in (-0.2, 0.2)]
    return unite(*rods, ellipsoid(points, (0, 0.3, 0), (0.2, 0.12, 0.14)), blend=0.03)


SOLIDS = {"bowl": bowl, "gap": gap}
BOX = (-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)


def make_truth(name: str, scans: Path) -> trimesh.Trimesh:
    """The true mesh, within the sphere of radius 0.5."""
    if name in OBJECTS:
        return make_object(name)
    if name in SOLIDS:
        return stand_upright(mesh_solid(SOLIDS[name], *BOX, 0.008))
    return stand_upright(read_scan(scans / f"{name}.glb"), UP.get(name, 1))


def two_rings(rings: tuple[float, ...], size: int, views: int = VIEWS) -> Cameras:
    """Cameras in turn on several levels, all around."""
    turn = torch.arange(views, dtype=torch.float64)
    elevation = torch.tensor(rings, dtype=torch.float64)[torch.arange(views) % len(rings)]
    names = [f"v{i:02}" for i in range(views)]
    return orbit_cameras(
        names, size, torch.full_like(turn, DISTANCE), elevation, 360 / views * turn
    )


def take(case: Case, truth: trimesh.Trimesh, cameras: Cameras, folder: Path) -> np.ndarray:
    """Write photographs, masks and cameras into a folder, unless they are there.

    Returns:
        the masks [views, size, size] bool
    """
    size = int(cameras.sizes[0, 0])
    if not (folder / "cameras.json").exists():
        for kind in ("photos", "masks"):
            (folder / kind).mkdir(parents=True, exist_ok=True)
        pictures = _photograph(case, truth, cameras)
        for view, (image, mask) in zip(cameras.views, pictures, strict=True):
            Image.fromarray(image).save(folder / "photos" / f"{view}.png", compress_level=1)
            Image.fromarray(255 * mask.astype(np.uint8)).save(folder / "masks" / f"{view}.png")
        write_cameras(folder / "cameras.json", cameras)
    masks = [np.asarray(Image.open(folder / "masks" / f"{v}.png")) > 0 for v in cameras.views]
    return np.stack(masks).reshape(len(cameras), size, size)


def _photograph(case: Case, truth: trimesh.Trimesh, cameras: Cameras):
    if case.paint == "gloss":
        yield from photograph(truth, cameras, find_paint(case.name))
        return
    colour = _find_colour(case, truth)
    for i in range(len(cameras)):
        camera = camera_of(cameras, i)
        mask = trace(truth, camera).mask
        yield _shade(truth, camera, mask, colour), mask


def _shade(
    truth: trimesh.Trimesh, camera: Camera, mask: np.ndarray, colour: Callable
) -> np.ndarray:
    """The photograph of a Lambertian object: [size, size, 3] uint8."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    top, left = max(rows[0] - 2, 0), max(columns[0] - 2, 0)
    side = int(max(rows[-1] - top, columns[-1] - left)) + 3
    near = camera.cropped(left, top, side, RAYS * side)
    hits = trace(truth, near)
    image = np.full((RAYS * side, RAYS * side, 3), BLACK)
    image[hits.mask] = colour(hits.faces, hits.weights) * _light(truth, hits)[:, None]
    small = image.reshape(side, RAYS, side, RAYS, 3).mean(axis=(1, 3))
    whole = np.full((camera.size, camera.size, 3), BLACK)
    height, width = min(side, camera.size - top), min(side, camera.size - left)
    whole[top : top + height, left : left + width] = small[:height, :width]
    return (255 * whole).round().clip(0, 255).astype(np.uint8)


def _light(truth: trimesh.Trimesh, hits) -> np.ndarray:
    corners = truth.vertex_normals[truth.faces[hits.faces]]
    normals = np.einsum("nc,ncd->nd", hits.weights, corners)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    towards = LIGHT / np.linalg.norm(LIGHT)
    return AMBIENT + (1 - AMBIENT) * np.maximum(normals @ towards, 0)


def _find_colour(case: Case, truth: trimesh.Trimesh) -> Callable:
    """The colours of points on faces: of faces [n] and weights [n, 3], [n, 3] in 0..1."""
    if case.paint == "own" and truth.visual.kind == "texture":
        return _texture(truth)
    paints: dict[str, Paint] = {
        "pattern": lambda points: pattern(points, 3),
        "plain": lambda points: np.broadcast_to(PLAIN, (len(points), 3)),
    }
    paint = paints.get(case.paint) or find_paint(case.name)

    def colour(faces: np.ndarray, weights: np.ndarray) -> np.ndarray:
        points = np.einsum("nc,ncd->nd", weights, truth.triangles[faces])
        return paint(points.astype(np.float32))[:, :3]

    return colour


def _texture(truth: trimesh.Trimesh) -> Callable:
    picture = np.asarray(truth.visual.material.baseColorTexture.convert("RGB")) / 255
    height, width = picture.shape[:2]

    def colour(faces: np.ndarray, weights: np.ndarray) -> np.ndarray:
        u, v = np.einsum("nc,ncd->nd", weights, truth.visual.uv[truth.faces[faces]]).T
        at = [(1 - v) * height - 0.5, u * width - 0.5]
        return np.stack(
            [map_coordinates(picture[..., c], at, order=1, mode="nearest") for c in range(3)], 1
        )

    return colour


def prepare(
    case: Case,
    size: int,
    working: int,
    folder: Path,
    scans: Path,
    steps: int = 600,
    spanned: bool = True,
) -> Fitted:
    """Photographs of a case and what the stages make of them; what the folder has is not redone.

    Args:
        size: of the photographs, in pixels
        working: of the working images
        folder: of this case and these sizes
        steps: of the fit at most; few for a quick look
        spanned: whether the fit spans ends that no view sees
    """
    truth, placed = make_truth(case.name, scans), two_rings(case.rings, size)
    full = take(case, truth, placed, folder)
    shown = silmesh.read_photographs(folder / "photos", size=working)
    found = silmesh.find_silhouettes(shown, folder / "masks")
    scene = silmesh.find_cameras(shown, found, folder / "cameras.json")
    name = f"fit-{working}-{steps}{'' if spanned else '-open'}"
    kept, cameras = (folder / f"{name}.{kind}" for kind in ("npz", "json"))
    if not kept.exists():
        told = {"iterations": steps, "span_unseen": spanned}
        fitted = silmesh.fit(silmesh.initial_mesh(scene), scene, **told)
        np.savez(kept, verts=fitted.mesh.vertices, faces=fitted.mesh.faces)
        write_cameras(cameras, fitted.cameras)
    with np.load(kept) as saved:
        mesh = trimesh.Trimesh(saved["verts"], saved["faces"], process=False)
    refined = read_cameras(cameras)
    originals = Originals(refined, shown.views, scene.notes.get("lenses"))
    return Fitted(truth, mesh, refined, scene.silhouettes, originals, full, placed)
