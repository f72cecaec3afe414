"""Small results from which the page is written: boxes on a turntable, drawn as the steps draw."""

import io
import json
import struct
from pathlib import Path

import numpy as np
import pandas as pd
import torch
import trimesh
from PIL import Image

from silmesh.cameras.turntable import turntable_cameras
from silmesh.geometry.camera import Cameras, Similarity
from silmesh.geometry.textured_mesh import texture_mesh
from silmesh.report.exhibit import describe_exhibit
from silmesh.report.gallery import Shot, describe_gallery
from silmesh.report.page import Result, Scene
from silmesh.report.pictures import camera_of, trace

SIZE, VIEWS = 64, 8
GALLERY = "64-pad-mask-turntable-keep-3"
CENTRE, SCALE = [0.1, 0.2, 0.3], 2.0
TOLD = {
    "cameras": "turntable", "dropped": {}, "warnings": [], "figures": {},
    "hull_iou": {"r0": 0.9}, "hull_iou_mean": 0.9, "centre": CENTRE, "scale": SCALE,
}  # fmt: skip


def cameras() -> Cameras:
    """Of the input's world, in which the object is half as large as in the normalised one."""
    views = [f"r{45 * i}" for i in range(VIEWS)]
    unit = turntable_cameras(views, SIZE, 2.732, 15.0, 45.0)
    return unit.in_world_of(similarity().inverse)


def similarity() -> Similarity:
    """From that world to the normalised one."""
    return Similarity(torch.tensor(CENTRE, dtype=torch.float64), SCALE)


def box(sides: tuple[float, float, float]) -> trimesh.Trimesh:
    """A box about the middle of the normalised world, in the input's."""
    mesh = trimesh.creation.box(sides)
    mesh.vertices = mesh.vertices / SCALE + CENTRE
    return mesh.subdivide()


def gallery(folder: Path) -> dict:
    """Photographs of a box: the second a kept outlier, the third repaired, one of each loss."""
    photographs, shots = folder / "views", []
    photographs.mkdir(exist_ok=True)
    for i, view in enumerate(cameras().views):
        mask = trace(box((0.5, 0.8, 0.4)), camera_of(cameras(), i)).mask
        path = photographs / f"{view}.png"
        Image.fromarray(np.where(mask[..., None], (200, 120, 40), 20).astype(np.uint8)).save(path)
        fate = {2: "repaired", 3: "dropped"}.get(i, "kept")
        doubt = f"its area jumps <{i}>" if i in (1, 2, 3) else ""
        before = np.roll(mask, 4, axis=1) if i == 2 else None
        shots.append(Shot(view, path, mask, before, fate, doubt))
    shots.append(Shot("r999", photographs / "r0.png", None, None, "lost", "it is blurred"))
    return describe_gallery(shots)


def paper(mesh: trimesh.Trimesh, colour: tuple[int, int, int]) -> trimesh.Trimesh:
    """A mesh in a texture of one colour, each of its triangles a chart of its own."""
    faces = np.arange(3 * len(mesh.faces)).reshape(-1, 3)
    uv = np.tile([[0.0, 0], [1, 0], [0, 1]], (len(mesh.faces), 1))
    return texture_mesh(
        mesh.vertices[mesh.faces.ravel()], faces, uv, np.full((64, 64, 3), colour, np.uint8)
    )


def result(folder: Path, metrics: dict, sides=(0.5, 0.8, 0.4), gallery: str = GALLERY, **more):
    """What the page shows of a run whose mesh is a box, its initial mesh a sphere.

    ``texture`` is the colour of its texture, if it has one.
    """
    mesh = box(sides)
    colours = np.tile([0.5, 0.2, 0.05], (len(mesh.vertices), 1))
    first = trimesh.creation.icosphere(2, 0.4)
    steps = np.arange(300)
    losses = pd.DataFrame({"iteration": steps, "loss": 0.1 + 0.6 * np.exp(-steps / 40)})
    picture, rings = folder / "picture.png", folder / "rings.png"
    Image.effect_noise((1394, 574), 60).convert("RGB").save(picture)
    Image.effect_noise((1126, 615), 60).convert("RGB").save(rings)
    kept = cameras().select([0, 1, 2, *range(4, VIEWS)])
    colour = more.pop("texture", None)
    textured = paper(mesh, colour) if colour else None
    exhibit = describe_exhibit(mesh, colours, first, kept, similarity(), 1e-4, textured)
    return Result(
        metrics,
        losses,
        picture,
        json.loads(json.dumps(exhibit)),
        Scene(more.pop("scene", "64-pad-mask-turntable"), TOLD, rings),
        gallery,
        **more,
    )


def split_glb(glb):
    """The tree and the buffer of a GLB."""
    magic, version, whole = struct.unpack("<4sII", glb[:12])
    assert (magic, version, whole) == (b"glTF", 2, len(glb))
    head = struct.unpack("<I", glb[12:16])[0]
    return json.loads(glb[20 : 20 + head]), glb[28 + head :]


def read_glb(glb):
    """The mesh of a GLB by trimesh, which leaves normalised whole numbers as they are."""
    tree, _ = split_glb(glb)
    mesh = trimesh.load(io.BytesIO(glb), file_type="glb", process=False).geometry.popitem()[1]
    node = tree["nodes"][0]
    most = 65535 if mesh.vertices.max() > 1 else 1
    mesh.vertices = mesh.vertices / most * node["scale"] + node["translation"]
    return mesh
