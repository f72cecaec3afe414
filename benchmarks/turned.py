r"""How well two sets of views, between which the object was turned over, are joined: JSON.

python benchmarks/turned.py --cases 20 --scans cup.glb bottle.glb --json FILE
python benchmarks/turned.py --cases 6 --calibrate       # cameras found from each set's silhouettes
python benchmarks/turned.py --fit --size 64 --json FILE  # and meshes fitted to both and to each;
                                                        # what FILE has is not run again
python benchmarks/turned.py --cases 3 --calibrate --below  # the second set's camera looks up
python benchmarks/turned.py --cases 6 --mismatched      # two different objects, to be refused

Each case is an object, made-up or a scan, in 24 views from one height, then turned by a random
rotation, moved and photographed in 24 views from another. Each set's cameras are given in a world
of its own.
"""

import argparse
import json
import time
from dataclasses import dataclass, replace
from pathlib import Path

import igl
import numpy as np
import torch
import trimesh
from photographed import measure_fit, reconstruct_silhouettes
from PIL import Image
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from silmesh.cameras.attempt import Attempt
from silmesh.cameras.turntable import orbit_cameras
from silmesh.errors import InputError
from silmesh.evaluation.ground_truth import compare_to_truth
from silmesh.geometry.camera import Cameras
from silmesh.geometry.visual_hull import Hull, carve
from silmesh.scene.agreement import normalise
from silmesh.scene.calibrated_sets import calibrate_sets
from silmesh.scene.joined import join_attempts
from silmesh.softras import soft_silhouettes
from silmesh.synthetic.dataset import make_object
from silmesh.synthetic.layout import OBJECTS
from silmesh.views import View, place_view

VIEWS = 24  # of each set
DISTANCE = 2.732
FARTHER = 8  # times, of cameras that look up


def load(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices within the sphere of radius 0.5, faces, and colours [verts, 3] of 0 to 255."""
    mesh = make_object(name) if name in OBJECTS else trimesh.load(name, force="mesh")
    verts = np.asarray(mesh.vertices, float)
    verts = verts - (verts.min(axis=0) + verts.max(axis=0)) / 2
    verts /= 2 * np.linalg.norm(verts, axis=1).max()
    visual = mesh.visual if mesh.visual.kind == "vertex" else mesh.visual.to_color()
    return verts, np.asarray(mesh.faces), np.asarray(visual.vertex_colors, float)[:, :3]


def stand(names: list[str], size: int, random: np.random.Generator) -> Cameras:
    """Cameras of a whole turn, all from one random height."""
    same = torch.ones(len(names), dtype=torch.float64)
    azimuth = 360 / len(names) * torch.arange(len(names), dtype=torch.float64)
    height, first = random.uniform(5, 40), random.uniform(0, 360)
    return orbit_cameras(names, size, DISTANCE * same, height * same, azimuth + first)


def look_up(cameras: Cameras) -> Cameras:
    """The cameras as far below the table as they stand above it, and so distant that it hardly
    shows: of such silhouettes ``calibrate`` finds the mirrored object, which turns the other way.
    """
    R, D = cameras.R, torch.tensor([1.0, 1, -1], dtype=torch.float64)
    K = cameras.K * torch.tensor([[FARTHER, 1, 1], [1, FARTHER, 1], [1, 1, 1]])
    return replace(cameras, K=K, R=D[:, None] * R * D, t=FARTHER * cameras.t)


def photograph(
    cameras: Cameras, verts: np.ndarray, faces: np.ndarray, colours: np.ndarray
) -> tuple[np.ndarray, dict[str, Image.Image]]:
    """Silhouettes, and pictures in which each pixel has the colour of the nearest vertex there."""
    size = int(cameras.sizes[0, 0])
    points = cameras.project(torch.as_tensor(verts))
    alphas = soft_silhouettes(points.float(), torch.as_tensor(faces), (size, size), sigma=1e-8)
    depths = cameras.depths(torch.as_tensor(verts)).numpy()
    pictures = {}
    for view, seen, depth in zip(cameras.views, points.numpy(), depths, strict=True):
        order = np.argsort(-depth)  # the nearest is painted last
        column, row = np.clip(seen[order].astype(int), 0, size - 1).T
        picture = np.zeros((size, size, 3), np.uint8)
        picture[row, column] = colours[order]
        pictures[view] = Image.fromarray(picture)
    return (alphas > 0.5).numpy(), pictures


def measure_volume(hull: Hull, points: np.ndarray, inside: np.ndarray) -> float:
    """Volume IoU of a hull and a truth, by points [n, 3] in the hull's world."""
    at = (points - hull.origin) / hull.spacing
    filled = map_coordinates(hull.field, at.T, order=1, mode="constant", cval=-1) > 0
    return float((filled & inside).sum() / (filled | inside).sum())


@dataclass(frozen=True)
class Shot:
    """An object in two sets of views, before and after it was turned over, or two objects.

    Attributes:
        sets: true cameras of each, in a world of its own
        meshes: the object there
        silhouettes: of each, [views, size, size] bool
        pictures: of all views
        Q: rotation of the second set's object against the first's
    """

    sets: list[Cameras]
    meshes: list[trimesh.Trimesh]
    silhouettes: list[np.ndarray]
    pictures: dict[str, Image.Image]
    Q: np.ndarray


def photograph_both(
    first: tuple, second: tuple, size: int, random: np.random.Generator, below: bool = False
) -> Shot:
    """Both sets of an object, or of two, as ``load`` has them; the second from below if asked."""
    verts, faces, colours = first
    turned, faces_b, colours_b = second
    Q = Rotation.random(random_state=random).as_matrix()
    moved = 0.9 * turned @ Q + random.uniform(-0.05, 0.05, 3)
    sets = [stand([f"{s}{i:02}" for i in range(VIEWS)], size, random) for s in "ab"]
    if below:
        sets = [sets[0], look_up(sets[1])]
    shot = [
        photograph(sets[0], verts, faces, colours),
        photograph(sets[1], moved, faces_b, colours_b),
    ]
    meshes = [
        trimesh.Trimesh(verts, faces, process=False),
        trimesh.Trimesh(moved, faces_b, process=False),
    ]
    return Shot(sets, meshes, [s for s, _ in shot], shot[0][1] | shot[1][1], Q)


def fit_sets(name: str, size: int, seed: int) -> dict:
    """Meshes fitted to both sets and to each alone, whose cameras ``calibrate`` finds."""
    shot = photograph_both(load(name), load(name), size, np.random.default_rng(seed))
    start = time.process_time()
    case = {"object": Path(name).stem, "seed": seed}
    for end, kept, sets in (("", (0, 1), "a*;b*"), ("_first", (0,), ""), ("_second", (1,), "")):
        try:
            told = fit_some(shot, kept, sets)
        except InputError as error:
            told = {"refused": str(error)}
        case |= {f"{key}{end}": value for key, value in told.items()}
    return case | {"cpu_seconds": round(time.process_time() - start, 1)}


def fit_some(shot: Shot, kept: tuple[int, ...], sets: str) -> dict:
    """What a mesh comes to that is fitted to some of the sets."""
    names = [view for i in kept for view in shot.sets[i].views]
    seen = np.concatenate([shot.silhouettes[i] for i in kept])
    made = reconstruct_silhouettes(names, seen, pictures=shot.pictures, sets=sets)
    truth = move_to_world_of(made.cameras, shot.sets[kept[0]], shot.meshes[kept[0]])
    told = measure_fit(made) | {"volume_iou": compare_to_truth(made.mesh, truth)["volume_iou"]}
    for join in made.scene.notes["figures"].get("joins", ()):
        told |= {key: join[key] for key in ("alone", "by", "ambiguous", "together")}
        if len(made.cameras) == len(names):
            told["degrees_off"] = relative_error(shot.sets, shot.Q, made.cameras)
    return told


def move_to_world_of(found: Cameras, true: Cameras, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh where cameras that were found see it as the true ones do.

    A tenth of its vertices at least are triangulated from where the true cameras project them.
    """
    views = [view for view in true.views if view in found.views]
    found = found.select([found.views.index(view) for view in views])
    points = np.asarray(mesh.vertices)[:: max(1, len(mesh.vertices) // 200)]
    pixels = true.select([true.views.index(v) for v in views]).project(torch.as_tensor(points))
    P = (found.K @ torch.cat([found.R, found.t[:, :, None]], dim=2)).numpy()
    rows = pixels.numpy()[..., None] * P[:, None, 2:] - P[:, None, :2]  # [views, points, 2, 4]
    rows = rows.transpose(1, 0, 2, 3).reshape(len(points), -1, 4)
    seen = np.linalg.svd(rows)[2][:, -1]
    there = seen[:, :3] / seen[:, 3:]
    return mesh.copy().apply_transform(
        trimesh.registration.procrustes(points, there, reflection=False)[0]
    )


def run(name: str, other: str, size: int, seed: int, calibrated: bool, below: bool = False) -> dict:
    """One case: what was found, and how far from the truth it is."""
    shot = photograph_both(load(name), load(other), size, np.random.default_rng(seed), below)
    sets, silhouettes, pictures = shot.sets, np.concatenate(shot.silhouettes), shot.pictures
    halves = [list(cameras.views) for cameras in sets]
    names = [view for half in halves for view in half]
    views = [place_view(view, view, size, size, size, "pad") for view in names]
    start = time.process_time()
    if calibrated:
        found = calibrate_sets(silhouettes, views, halves, pictures)
    else:
        attempts = [Attempt("given", cameras) for cameras in sets]
        found = join_attempts(attempts, views, silhouettes, pictures)
    seconds = time.process_time() - start
    case = {"object": Path(name).stem, "seed": seed, "cpu_seconds": round(seconds, 1)}
    if found.cameras is None:
        return case | {"refused": found.refusal}
    join = found.figures["joins"][0]
    case |= {key: join[key] for key in ("coherence", "alone", "runner_up", "by", "ambiguous")}
    case["mirrored"] = [one["mirror"] == "sets" for one in found.figures["of_sets"] if one]
    case |= {
        key: join[key] for key in ("rivals", "revolution", "colours", "together") if key in join
    }
    if other != name:
        return case
    case["degrees_off"] = relative_error(sets, shot.Q, found.cameras)
    return case | (
        {} if calibrated else compare_volumes(views, silhouettes, sets, found, *load(name)[:2])
    )


def relative_error(sets: list[Cameras], Q: np.ndarray, found: Cameras) -> float:
    """Degrees by which rotations from views of the first set to those of the second are off.

    The median over the pairs of views; X = Q Y up to scale and shift.
    """
    true = torch.cat([sets[0].R, sets[1].R @ torch.as_tensor(Q.T)]).numpy()
    here = found.R.numpy()
    n = len(sets[0])
    off = [
        Rotation.from_matrix((true[j] @ true[i].T).T @ (here[j] @ here[i].T)).magnitude()
        for i in range(n)
        for j in range(n, len(true))
    ]
    return float(np.degrees(np.median(off)))


def compare_volumes(
    views: list[View],
    silhouettes: np.ndarray,
    sets: list[Cameras],
    found: Attempt,
    verts: np.ndarray,
    faces: np.ndarray,
) -> dict:
    """Volume IoU with the truth of the hull of both sets and of the first alone."""
    n = len(sets[0])
    points = np.random.default_rng(0).uniform(verts.min(0) - 0.1, verts.max(0) + 0.1, (40_000, 3))
    winding = np.abs(igl.fast_winding_number(verts, faces.astype(np.int64), points))
    first = normalise(sets[0], silhouettes[:n]).similarity
    there = first.apply(torch.as_tensor(points)).numpy()  # the joined world is the first's
    hulls = {
        "volume_iou": carve(silhouettes, found.cameras),
        "volume_iou_first": carve(silhouettes[:n], found.cameras.select(range(n))),
        "volume_iou_second": carve(silhouettes[n:], found.cameras.select(range(n, 2 * n))),
    }
    return {k: measure_volume(hull, there, winding > 0.5) for k, hull in hulls.items()}


def main() -> None:
    """Run the cases that a file does not have yet; print each, and write all after each."""
    args = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    args.add_argument("--cases", type=int, default=20)
    args.add_argument("--first", type=int, default=0, help="seed of the first case")
    args.add_argument("--size", type=int, default=128, help="of the images, in pixels")
    args.add_argument("--objects", nargs="*", default=OBJECTS)
    args.add_argument("--scans", nargs="*", default=[], help="meshes, beside the made-up objects")
    args.add_argument("--calibrate", action="store_true", help="find each set's cameras")
    args.add_argument("--below", action="store_true", help="the second set's camera looks up")
    args.add_argument("--fit", action="store_true", help="runs, with the fit of a mesh")
    args.add_argument("--mismatched", action="store_true", help="the sets show different objects")
    args.add_argument("--json", type=Path)
    given = args.parse_args()
    objects = [*given.objects, *given.scans]
    done = given.json and given.json.is_file()
    cases = json.loads(given.json.read_text(encoding="utf-8")) if done else []
    for i in range(len(cases), given.cases):
        name, other = (objects[(i + k) % len(objects)] for k in (0, int(given.mismatched)))
        seed = given.first + i
        if given.fit:
            case = fit_sets(name, given.size, seed)
        else:
            case = run(name, other, given.size, seed, given.calibrate, given.below)
        cases.append(case)
        print(json.dumps(case), flush=True)
        if given.json:
            given.json.write_text(json.dumps(cases, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
