r"""How well cameras are found by `colmap` and `auto`, where they are known: JSON.

python benchmarks/cameras.py --scans ../shared/data/scans/blue_cup.glb --up 2
python benchmarks/cameras.py --scans ../shared/data/scans/shampoo.glb --up 1
python benchmarks/cameras.py --bunny ../shared/data/bunny
"""

import argparse
import json
import time
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from PIL import Image
from scenery import (
    photograph_before_wall,
    photograph_on_table,
    read_scan,
    stand_upright,
    texture_paint,
)
from scipy.linalg import null_space

from silmesh.cameras.attempt import read_attempt
from silmesh.cameras.upright import azimuths
from silmesh.geometry.camera import Cameras, read_cameras
from silmesh.scene.scene import read_scene
from silmesh.settings.cameras import Colmap, Matches, Reconstruction
from silmesh.steps import (
    calibrate,
    colmap,
    colmap_attempt,
    colmap_features,
    colmap_map,
    colmap_matches,
    scene,
    silhouettes,
    views,
)
from silmesh.synthetic.orbit import photograph_cameras

SURROUNDINGS = {"table": photograph_on_table, "wall": photograph_before_wall}


def find(folder: Path, images: Path, masks: Path, given: argparse.Namespace) -> dict[str, float]:
    """Make all stages of `cameras: auto` in a folder, and say how long each took."""
    seconds = {}

    def step(module, name: str, output: str, flags: Iterable[str] = (), **options: object) -> None:
        start = time.perf_counter()
        values = {"output": folder / output} | options
        argv = [w for k, v in values.items() for w in (f"--{k.replace('_', '-')}", *listed(v))]
        module.main([*flags, *(str(word) for word in argv)])
        seconds[name] = time.perf_counter() - start

    def listed(value: object) -> Iterable:
        return value if isinstance(value, list) else [value]

    files, threads = sorted(images.iterdir()), given.threads
    pictures = {"views": folder / "views", "silhouettes": folder / "silhouettes"}
    told = {"matching": given.matching, "mapping": given.mapping, "seed": given.seed}
    step(views, "views", "views", images=files, settings=json.dumps({"size": given.size}))
    step(
        silhouettes,
        "silhouettes",
        "silhouettes",
        views=folder / "views",
        source="mask",
        masks=sorted(masks.iterdir()),
    )
    step(colmap_features, "features", "features", images=files, threads=threads)
    step(
        colmap_matches,
        "matches",
        "matches",
        features=folder / "features",
        threads=threads,
        settings=Colmap(**told).part(Matches).model_dump_json(),
    )
    step(
        colmap_map,
        "map",
        "model",
        matches=folder / "matches",
        settings=Colmap(**told).part(Reconstruction).model_dump_json(),
    )
    step(colmap, "judge", "colmap", model=folder / "model", threads=threads, **pictures)
    step(
        colmap_attempt,
        "masked",
        "masked",
        flags=["--masked"],
        features=folder / "features",
        threads=threads,
        settings=json.dumps(told),
        **pictures,
    )
    step(calibrate, "calibrate", "calibrate", threads=threads, **pictures)
    attempts = [folder / name for name in ("colmap", "masked", "calibrate")]
    step(scene, "scene", "scene", cameras=attempts, threads=threads, **pictures)
    return seconds


def angles_off(found: Cameras, truth: Cameras) -> dict[str, float]:
    """Degrees by which rotations differ after the best common one, and by which azimuths do.

    The former hold the elevation too; the latter are of the turns from the first view.
    """
    index = [truth.views.index(view) for view in found.views]
    there = truth.select(index)
    u, _, vh = torch.linalg.svd((found.R.mT @ there.R).sum(0))
    common = u @ torch.diag(torch.tensor([1, 1, (u @ vh).det()]).double()) @ vh
    apart = found.R @ common @ there.R.mT
    cosine = (apart.diagonal(dim1=1, dim2=2).sum(1) - 1) / 2
    off = torch.rad2deg(cosine.clamp(-1, 1).acos())
    turns = azimuths(found.R) - azimuths(there.R)
    turns = torch.remainder(turns - turns[0] + 180, 360) - 180
    return {
        "rotation_worst": float(off.max()),
        "rotation_median": float(off.median()),
        "azimuth_worst": float((turns - turns.median()).abs().max()),
    }


def centres_off(found: Cameras, truth: np.ndarray) -> dict[str, float]:
    """Distances of camera centres after a similarity, over the mean distance from their middle."""
    a, b = found.centres.numpy(), truth
    a, b = a - a.mean(0), b - b.mean(0)
    u, s, vh = np.linalg.svd(a.T @ b)
    signs = np.array([1, 1, np.linalg.det(u @ vh)])
    moved = (s * signs).sum() / (a**2).sum() * a @ (u * signs) @ vh
    off = np.linalg.norm(moved - b, axis=1) / np.linalg.norm(b, axis=1).mean()
    return {"rms": float(np.sqrt((off**2).mean())), "worst": float(off.max())}


def told(folder: Path) -> dict:
    """What the attempts and the scene say."""
    says = read_scene(folder / "scene")[2]
    attempts = {}
    for name in ("colmap", "masked", "calibrate"):
        attempt = read_attempt(folder / name)
        figures = {k: v for k, v in attempt.figures.items() if isinstance(v, float | int | str)}
        attempts[name] = {"refusal": attempt.refusal, "warnings": attempt.warnings, **figures}
    keys = ("cameras", "cameras_because", "dropped", "hull_iou_mean")
    return {**{key: says[key] for key in keys}, "attempts": attempts}


def measure_scan(path: Path, surroundings: str, given: argparse.Namespace) -> dict:
    """A scan's photographs in some surroundings."""
    mesh = stand_upright(read_scan(path), given.up)
    truth = photograph_cameras(
        [f"v{i:02d}" for i in range(given.views)], (640, 480), elevation=given.elevation
    )
    with TemporaryDirectory() as scratch:
        folder = given.keep / f"{path.stem}-{surroundings}" if given.keep else Path(scratch)
        for name in ("images", "masks"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        start = time.perf_counter()
        pictures = SURROUNDINGS[surroundings](mesh, truth, texture_paint(mesh))
        for view, (image, mask) in zip(truth.views, pictures, strict=True):
            Image.fromarray(image).save(folder / "images" / f"{view}.png", compress_level=1)
            Image.fromarray(mask).save(folder / "masks" / f"{view}.png")
        seconds = {"rendering": time.perf_counter() - start}
        seconds |= find(folder, folder / "images", folder / "masks", given)
        found = read_cameras(folder / "scene" / "cameras.json")
        return {**told(folder), **angles_off(found, truth), "seconds": seconds}


def measure_bunny(data: Path, given: argparse.Namespace) -> dict:
    """The bunny's photographs, against the projection matrices that came with them."""
    with TemporaryDirectory() as scratch:
        folder = given.keep / "bunny" if given.keep else Path(scratch)
        seconds = find(folder, data / "images", data / "masks", given)
        result = {**told(folder), "seconds": seconds}
        for name in ("colmap", "masked"):
            found = read_attempt(folder / name).cameras
            if found is not None:
                matrices = [np.loadtxt(data / "projections" / f"{v}.txt") for v in found.views]
                eyes = np.array([null_space(P)[:, 0] for P in matrices])
                result[f"centres_{name}"] = centres_off(found, eyes[:, :3] / eyes[:, 3:])
        stages = ("features", "matches", "map", "judge")
        result["seconds_unmasked"] = sum(seconds[stage] for stage in stages)
        return result


def main() -> None:
    """Print what was measured."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("--scans", type=Path, nargs="*", default=[])
    args.add_argument("--up", type=int, default=1, help="the scans' upward axis")
    args.add_argument("--surroundings", nargs="*", choices=SURROUNDINGS, default=[*SURROUNDINGS])
    args.add_argument("--bunny", type=Path)
    args.add_argument("--views", type=int, default=36)
    args.add_argument("--elevation", type=float, default=20)
    args.add_argument("--size", type=int, default=256, help="of the working images")
    args.add_argument("--matching", default="exhaustive")
    args.add_argument("--mapping", default="incremental")
    args.add_argument("--seed", type=int, default=0)
    args.add_argument("--threads", type=int, default=2)
    args.add_argument("--keep", type=Path, help="folder to keep all stages in")
    given = args.parse_args()
    result = {
        f"{path.stem}, {name}": measure_scan(path, name, given)
        for path in given.scans
        for name in given.surroundings
    }
    if given.bunny:
        result["bunny"] = measure_bunny(given.bunny, given)
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
