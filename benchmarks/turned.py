r"""How well two sets of views, between which the object was turned over, are joined: JSON.

python benchmarks/turned.py --cases 20 --scans cup.glb bottle.glb --json FILE
python benchmarks/turned.py --cases 6 --calibrate       # cameras found from each set's silhouettes
python benchmarks/turned.py --fit --size 64 --json FILE  # meshes fitted to both and to each too;
                                                        # what FILE has is not run again
python benchmarks/turned.py --cases 3 --calibrate --below  # the second set's camera looks up
python benchmarks/turned.py --cases 6 --mismatched      # two different objects, to be refused

Each case is an object, made-up or a scan, in 24 views from one height, then turned by a random
rotation, moved and photographed in 24 views from another. Each set's cameras are given in a world
of its own, unless they are found.
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
from PIL import Image
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

import silmesh
from silmesh.cameras.attempt import Attempt
from silmesh.cameras.turntable import orbit_cameras
from silmesh.geometry.camera import Cameras
from silmesh.geometry.visual_hull import Hull, carve
from silmesh.scene.assemble import build_scene
from silmesh.scene.calibrated_sets import calibrate_sets
from silmesh.scene.joined import join_attempts
from silmesh.softras import soft_silhouettes
from silmesh.synthetic.dataset import make_object
from silmesh.synthetic.layout import OBJECTS
from silmesh.views import View, place_view

VIEWS = 24  # of each set
DISTANCE = 2.732
VERTICES = 642  # of the meshes that are fitted
SAID = (  # of a join
    "coherence", "alone", "runner_up", "by", "ambiguous", "rivals", "revolution", "colours",
    "together",
)  # fmt: skip
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


def fit_all(shot: Shot, views: list[View], found: Attempt) -> dict:
    """IoU and volume IoU of meshes fitted to both sets, as joined, and to each alone."""
    n, seen = len(shot.sets[0]), np.concatenate(shot.silhouettes)
    told = {}
    for end, kept, true, mesh in (
        ("", range(2 * n), shot.sets[0], shot.meshes[0]),
        ("_first", range(n), shot.sets[0], shot.meshes[0]),
        ("_second", range(n, 2 * n), shot.sets[1], shot.meshes[1]),
    ):
        some = [views[i] for i in kept]
        attempt = found if not end else Attempt("given", true)
        one = fit_some(some, seen[list(kept)], attempt, true, mesh)
        told |= {f"{key}{end}": value for key, value in one.items()}
    return {"fitted": told}


def fit_some(
    views: list[View], seen: np.ndarray, attempt: Attempt, true: Cameras, mesh: trimesh.Trimesh
) -> dict:
    """How well a mesh that is fitted to some views agrees with these, and with the true one.

    Args:
        true: cameras of the world of ``mesh``
    """
    scene = build_scene([attempt], views, seen).scene
    initial = silmesh.initial_mesh(scene, "hull", vertices=VERTICES)
    fitted = silmesh.fit(initial, scene)
    points = fitted.cameras.project(torch.as_tensor(np.asarray(fitted.mesh.vertices)))
    faces = torch.as_tensor(np.asarray(fitted.mesh.faces))
    alphas = soft_silhouettes(points.float(), faces, seen.shape[1:], sigma=1e-8)
    drawn, shown = (alphas > 0.5).numpy(), scene.silhouettes
    iou = (drawn & shown).sum(axis=(1, 2)) / (drawn | shown).sum(axis=(1, 2))
    truth = move_to_world_of(fitted.cameras, true, mesh)
    points = spread_points(truth)
    one, other = (find_inside(each, points) for each in (fitted.mesh, truth))
    volume = (one & other).sum() / (one | other).sum()
    return {"iou": float(iou.mean()), "volume_iou": float(volume)}


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


def run(name: str, other: str, seed: int, asked: argparse.Namespace) -> dict:
    """One case: what was found, and how far from the truth it is."""
    size, random = asked.size, np.random.default_rng(seed)
    shot = photograph_both(load(name), load(other), size, random, asked.below)
    silhouettes = np.concatenate(shot.silhouettes)
    halves = [list(cameras.views) for cameras in shot.sets]
    views = [place_view(view, view, size, size, size, "pad") for half in halves for view in half]
    start = time.process_time()
    if asked.calibrate:
        found = calibrate_sets(silhouettes, views, halves, shot.pictures)
    else:
        attempts = [Attempt("given", cameras) for cameras in shot.sets]
        found = join_attempts(attempts, views, silhouettes, shot.pictures)
    seconds = time.process_time() - start
    case = {"object": Path(name).stem, "seed": seed, "cpu_seconds": round(seconds, 1)}
    if found.cameras is None:
        return case | {"refused": found.refusal}
    join = found.figures["joins"][0]
    case |= {key: join[key] for key in SAID if key in join}
    if asked.calibrate:
        case["mirror"] = [one["mirror"] for one in found.figures["of_sets"]]
    if other != name:
        return case
    case["degrees_off"] = relative_error(shot.sets, shot.Q, found.cameras)
    case |= compare_hulls(shot, found)
    return case | (fit_all(shot, views, found) if asked.fit else {})


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


def compare_hulls(shot: Shot, found: Attempt) -> dict:
    """Volume IoU with the truth of the hull of both sets and of each alone, as joined."""
    n, silhouettes = len(shot.sets[0]), np.concatenate(shot.silhouettes)
    truth = move_to_world_of(found.cameras, shot.sets[0], shot.meshes[0])
    points = spread_points(truth)
    inside = find_inside(truth, points)
    hulls = {
        "volume_iou": carve(silhouettes, found.cameras),
        "volume_iou_first": carve(silhouettes[:n], found.cameras.select(range(n))),
        "volume_iou_second": carve(silhouettes[n:], found.cameras.select(range(n, 2 * n))),
    }
    return {k: measure_volume(hull, points, inside) for k, hull in hulls.items()}


def spread_points(mesh: trimesh.Trimesh) -> np.ndarray:
    """Points in the box about a mesh, and a little beyond: [40,000, 3]."""
    (low, high), random = mesh.bounds, np.random.default_rng(0)
    margin = 0.1 * (high - low)
    return random.uniform(low - margin, high + margin, (40_000, 3))


def find_inside(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Whether points lie within a mesh, by its winding number."""
    verts, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
    return np.abs(igl.fast_winding_number(verts, faces, points)) > 0.5


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
    args.add_argument("--fit", action="store_true", help="fit a mesh to both and to each")
    args.add_argument("--mismatched", action="store_true", help="the sets show different objects")
    args.add_argument("--json", type=Path)
    given = args.parse_args()
    objects = [*given.objects, *given.scans]
    done = given.json and given.json.is_file()
    cases = json.loads(given.json.read_text(encoding="utf-8")) if done else []
    for i in range(len(cases), given.cases):
        name, other = (objects[(i + k) % len(objects)] for k in (0, int(given.mismatched)))
        case = run(name, other, given.first + i, given)
        cases.append(case)
        print(json.dumps(case), flush=True)
        if given.json:
            given.json.write_text(json.dumps(cases, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
