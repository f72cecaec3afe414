"""A walk around an object in portrait photographs, most of them close-ups, beside whole ones: JSON.

    python benchmarks/closeups.py --scans ../shared/data/scans/*.glb

Of each object 60 photographs of 96x128 are made twice from the same directions: by a camera that
steps so near in two of three, towards any point of the object, that the frame cuts it; and by one
that keeps away. Masks are what rays meet, cameras are given. Both are reconstructed, and what comes
of them is compared with the truth: IoU with the silhouettes inside the frames, and volume IoU.
"""

import argparse
import json
import time
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
import trimesh
from PIL import Image
from scenery import read_scan, stand_upright

import silmesh
from silmesh.errors import InputError
from silmesh.geometry.camera import Cameras, write_cameras
from silmesh.geometry.frame import is_cut
from silmesh.synthetic.dataset import make_object
from silmesh.synthetic.layout import OBJECTS

PHOTOGRAPHS, SIZE = 60, (96, 128)  # of a walk, width and height in pixels
FOCAL = 128.0  # pixels: 53 degrees along the longer side, as of a telephone
FAR = 1.9  # distance from the middle from which the frame holds the object
NEAR = (0.2, 0.6)  # distances of close-ups from the object's foremost point
STEP = 0.1  # back from where the object covers the border all around
GREYS = 40, 200  # of the background and of the object
KEYS = ("iou_mean", "iou_min", "hull_iou_mean", "volume_iou")


def main() -> None:
    """Print what was measured."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("--objects", nargs="*", default=OBJECTS, help="made-up ones")
    args.add_argument("--scans", type=Path, nargs="*", default=[], help="glb files")
    args.add_argument("--seed", type=int, default=0)
    args.add_argument("--size", type=int, default=128, help="of the working images")
    args.add_argument("--threads", type=int, default=1)
    args.add_argument("--walks", nargs="*", default=["near", "far"])
    args.add_argument("--vertices", type=int, nargs="*", default=[0], help="0: as many as it likes")
    given = args.parse_args()
    torch.set_num_threads(given.threads)
    objects = {name: make_object(name) for name in given.objects}
    objects |= {scan.stem: stand_upright(read_scan(scan)) for scan in given.scans}
    for name, mesh in objects.items():
        for walk, vertices in product(given.walks, given.vertices):
            row = measure(mesh, walk == "near", given.seed, given.size, vertices or "auto")
            print(json.dumps({"object": name, "walk": walk, **row}), flush=True)


def measure(
    mesh: trimesh.Trimesh, near: bool, seed: int, size: int, vertices: int | str
) -> dict[str, float | str]:
    """What becomes of one walk's photographs; seconds are those of the CPU."""
    cameras = walk(mesh, near, seed)
    masks = see(mesh, cameras)
    told = {
        "cut": int(is_cut(masks).sum()),
        "in_sphere": int((cameras.centres.norm(dim=1) < 0.5).sum()),
    }
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write(folder, cameras, masks)
        start, fitting = time.process_time(), []

        def tell(stage: str, share: float) -> None:
            if stage == "fit":
                fitting.append(time.process_time())

        try:
            result = silmesh.reconstruct(
                folder / "photos",
                folder / "masks",
                folder / "cameras.json",
                size=size,
                settings={"init": {"vertices": vertices}},
                progress=tell,
                truth=trimesh.Trimesh(mesh.vertices, mesh.faces, process=True),
            )
        except InputError as error:
            return told | {"refused": str(error)}
    measured = {key: result.metrics[key] for key in KEYS}
    told |= {"views": len(result.cameras), "faces": len(result.mesh.faces)}
    told |= {"steps": len(fitting), "fit_seconds": fitting[-1] - fitting[0]}
    return told | measured | {"seconds": time.process_time() - start}


def walk(mesh: trimesh.Trimesh, near: bool, seed: int) -> Cameras:
    """Cameras around an object that lies in the sphere of radius 0.5 about the origin."""
    rng = np.random.default_rng(seed)
    azimuth = np.radians(360 / PHOTOGRAPHS * np.arange(PHOTOGRAPHS) + rng.normal(0, 2, PHOTOGRAPHS))
    elevation = np.radians(25 + 25 * np.sin(5 * azimuth) + rng.normal(0, 3, PHOTOGRAPHS))
    along = np.stack([np.sin(azimuth), np.tan(elevation), np.cos(azimuth)], axis=1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    foremost = (np.asarray(mesh.vertices) @ along.T).max(axis=0)
    aims = np.asarray(mesh.vertices)[rng.integers(len(mesh.vertices), size=PHOTOGRAPHS)]
    reach, closer = foremost + rng.uniform(*NEAR, PHOTOGRAPHS), np.arange(PHOTOGRAPHS) % 3 > 0
    stand = np.where((closer & near)[:, None], along * reach[:, None], FAR * along)
    aims = np.where((closer & near)[:, None], 0.7 * aims, 0.0)
    filled = np.flatnonzero(closer & near)
    while len(filled):  # step back until some background shows at the border
        masks = see(mesh, look(stand, aims).select(filled))
        filled = filled[_fill_border(masks)]
        stand[filled] += STEP * along[filled]
    return look(stand, aims)


def _fill_border(masks: np.ndarray) -> np.ndarray:
    """Whether each of [views, height, width] bool covers the border all around."""
    sides = masks[:, [0, -1]].all(axis=(1, 2)), masks[:, :, [0, -1]].all(axis=(1, 2))
    return sides[0] & sides[1]


def look(stand: np.ndarray, aims: np.ndarray) -> Cameras:
    """Cameras that stand at points [views, 3], upright, and look at others."""
    ahead = aims - stand
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    right = np.cross(ahead, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    R = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    width, height = SIZE
    K = np.array([[FOCAL, 0, width / 2], [0, FOCAL, height / 2], [0, 0, 1]])
    count = len(stand)
    return Cameras(
        tuple(f"{i:02d}" for i in range(count)),
        torch.tensor([SIZE] * count),
        torch.tensor(K).repeat(count, 1, 1),
        torch.tensor(R),
        -torch.tensor(np.einsum("vij,vj->vi", R, stand)),
    )


def see(mesh: trimesh.Trimesh, cameras: Cameras) -> np.ndarray:
    """Which pixels' rays meet the mesh: [views, height, width] bool."""
    width, height = SIZE
    v, u = np.mgrid[:height, :width] + 0.5
    pixels = np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3)
    masks = []
    for K, R, eye in zip(*map(np.asarray, (cameras.K, cameras.R, cameras.centres)), strict=True):
        rays = pixels @ np.linalg.inv(K).T @ R
        hit = mesh.ray.intersects_any(np.tile(eye, (len(rays), 1)), rays)
        masks.append(hit.reshape(height, width))
    return np.stack(masks)


def write(folder: Path, cameras: Cameras, masks: Sequence[np.ndarray]) -> None:
    """Write photographs, masks and cameras."""
    for kind in ("photos", "masks"):
        (folder / kind).mkdir()
    for view, mask in zip(cameras.views, masks, strict=True):
        Image.fromarray(255 * mask.astype(np.uint8)).save(folder / "masks" / f"{view}.png")
        grey = np.where(mask, GREYS[1], GREYS[0]).astype(np.uint8)
        Image.fromarray(grey).convert("RGB").save(folder / "photos" / f"{view}.png")
    write_cameras(folder / "cameras.json", cameras)


if __name__ == "__main__":
    main()
