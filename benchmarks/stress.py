r"""What becomes of damaged silhouettes and cameras: JSON, kept cell by cell, and Markdown.

python benchmarks/stress.py --json stress.json --today ../today \
    --rival ../rival/bin/python --objects bear pot bunny --size 96 --views 36

A cell is an object, a damage at a strength, and a method. What is in the file already is not
measured again, so a run that was stopped goes on, and one of an hour may be a part of one of a
night. All is drawn from one seed.

Methods: ``hull``, the strict visual hull of the masks that are not empty; ``ellipsoid``, fitted by
the preset softras for ``--steps`` steps; ``today``, what another checkout does of the photographs,
masks and cameras as files; ``silmesh``, what this one does; ``drop`` and ``repair``, the same with
outliers left out, and with wrong masks repaired; ``rival``, reverse3d's visual hull.
"""

import argparse
import json
import os
import selectors
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import torch
import trimesh
from calibrate import axis_at
from scenery import silhouettes
from stress_cases import DAMAGES, REAL, SCANS, Case, damage_case, make_clean, name_cell, write_case
from stress_table import JUDGED, tabulate, tabulate_objects, tabulate_regained

from silmesh.errors import InputError
from silmesh.evaluation.ground_truth import compare_to_truth
from silmesh.evaluation.registration import register
from silmesh.files import replacing
from silmesh.fitting.loop import run
from silmesh.fitting.softras import SoftRas
from silmesh.geometry.camera import Cameras
from silmesh.geometry.mesh_files import to_tensors
from silmesh.geometry.overlap import iou
from silmesh.geometry.visual_hull import carve
from silmesh.settings.fit import SoftRasFit
from silmesh.settings.init import Init
from silmesh.shapes.downsample import crop
from silmesh.shapes.initial import make_initial_mesh
from silmesh.synthetic.layout import OBJECTS

HERE = Path(__file__).resolve().parent
METHODS = ("hull", "ellipsoid", "today", "silmesh", "drop", "repair", "rival")
STEP = 1e-3  # of the world, by which a derivative is taken
LONGEST = 600  # seconds of one case in such a process


def read_given(case: Case) -> tuple[np.ndarray, Cameras, np.ndarray]:
    """The masks that are not empty, without the padding around them, their cameras and frames."""
    shown = np.flatnonzero(case.given_masks.any(axis=(1, 2))).tolist()
    return crop(case.given_masks[shown], case.given_cameras.select(shown), case.frames[shown])


def carve_hull(case: Case, steps: int) -> trimesh.Trimesh | None:
    """The strict visual hull, every piece of it; None if it is empty."""
    masks, cameras, frames = read_given(case)
    hull = carve(masks, cameras, frames=frames)
    return None if hull.empty else trimesh.Trimesh(*hull.surface(), process=False)


def fit_ellipsoid(case: Case, steps: int) -> trimesh.Trimesh:
    """What the preset softras makes of an ellipsoid in so many steps."""
    masks, cameras, _ = read_given(case)
    first = make_initial_mesh(Init(shape="ellipsoid"), masks, cameras).mesh
    target = torch.tensor(masks, dtype=torch.float32)
    fit = SoftRas(*to_tensors(first), cameras, target, SoftRasFit(iterations=steps))
    run(fit)
    return trimesh.Trimesh(fit.verts.numpy(), fit.faces.numpy(), process=False)


INSIDE: dict[str, Callable[[Case, int], trimesh.Trimesh | None]] = {
    "hull": carve_hull,
    "ellipsoid": fit_ellipsoid,
}


class Worker:
    """A process that answers a line of JSON to each line, anew if it dies or takes too long.

    Args:
        command: of the process
        path: of Python's modules, beside what it has; none for one of another environment
    """

    def __init__(self, command: list[str], path: str | None):
        self._command = command
        self._environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        self._environment |= {"PYTHONPATH": path} if path else {}
        self._process: subprocess.Popen | None = None

    def ask(self, folder: Path, made: Path) -> dict:
        """What it says of a case."""
        if self._process is None:
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=self._environment,
            )
        line = json.dumps([str(folder), str(made)]) + "\n"
        self._process.stdin.write(line.encode())
        self._process.stdin.flush()
        with selectors.DefaultSelector() as waiting:
            waiting.register(self._process.stdout, selectors.EVENT_READ)
            answer = self._process.stdout.readline() if waiting.select(LONGEST) else b""
        if answer:
            return json.loads(answer)
        self.close()
        return {"verdict": "crashed", "said": f"no answer within {LONGEST} s, or the process died"}

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


def start_workers(given: argparse.Namespace) -> dict[str, Worker]:
    """A process for each method that is one."""
    script = [sys.executable, str(HERE / "stress_worker.py")]
    sources = {"silmesh": HERE.parent / "src"}
    sources |= {"today": given.today.resolve() / "src"} if given.today else {}
    workers = {name: Worker(script, str(source)) for name, source in sources.items()}
    for policy in ("drop", "repair"):
        workers[policy] = Worker([*script, policy], str(sources["silmesh"]))
    if given.rival:
        workers["rival"] = Worker([str(given.rival), str(HERE / "stress_rival.py")], None)
    return workers


def compare_silhouettes(case: Case, mesh: trimesh.Trimesh) -> list[float]:
    """The IoU of a mesh with each true silhouette, within the frames."""
    values = []
    seen = silhouettes(mesh, case.cameras)
    for made, true, (left, top, right, bottom) in zip(seen, case.masks, case.frames, strict=True):
        inside = np.s_[top:bottom, left:right]
        values.append(iou(made[inside], true[inside]))
    return values


def shift_to_truth(case: Case, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh, shifted so that the middles of its outlines lie best in those of the true ones.

    Cameras that all look a little aside leave open where the object is. The middles move in
    proportion to so small a shift, which is therefore that of least squares.
    """
    seen = silhouettes(mesh, case.cameras)
    shown = np.flatnonzero(seen.any(axis=(1, 2)) & case.masks.any(axis=(1, 2)))
    apart = find_middles(case.masks[shown]) - find_middles(seen[shown])
    steps = torch.from_numpy(
        mesh.vertices.mean(axis=0) + np.vstack([np.zeros(3), STEP * np.eye(3)])
    )
    pixels = case.cameras.select(shown.tolist()).project(steps).numpy()  # [views, 4, 2]
    moved = (pixels[:, 1:] - pixels[:, :1]).transpose(0, 2, 1).reshape(-1, 3) / STEP
    shift = np.linalg.lstsq(moved, apart.ravel(), rcond=None)[0]
    return trimesh.Trimesh(mesh.vertices + shift, mesh.faces, process=False)


def find_middles(masks: np.ndarray) -> np.ndarray:
    """The mean column and row of each silhouette's pixels: [views, 2]."""
    return np.array([np.argwhere(mask)[:, ::-1].mean(axis=0) for mask in masks])


def measure_mesh(case: Case, mesh: trimesh.Trimesh | None, calibrated: bool) -> dict:
    """The mesh against the true silhouettes, within the frames, and the truth in 3D.

    Args:
        calibrated: its world is that of cameras that were found; it is laid on the truth first
    """
    if mesh is None or not len(mesh.faces):
        return {"iou": 0.0, "iou_min": 0.0, "volume_iou": 0.0, "chamfer": None, "pieces": 0}
    if calibrated:
        laid = register(mesh, case.truth).apply(mesh.vertices)
        mesh = trimesh.Trimesh(laid, mesh.faces, process=False)
    values = compare_silhouettes(case, mesh)
    told = {"iou": float(np.mean(values)), "iou_min": float(np.min(values))}
    if case.unseen:
        told["iou_unseen"] = float(np.mean(compare_silhouettes(case.unseen, mesh)))
    if not torch.equal(case.given_cameras.R, case.cameras.R):
        shifted = shift_to_truth(case, mesh)
        told["iou_shifted"] = float(np.mean(compare_silhouettes(case, shifted)))
    told["pieces"] = len(mesh.split(only_watertight=False))
    if case.truth is not None:
        compared = compare_to_truth(mesh, case.truth)
        told |= {name: compared[name] for name in ("volume_iou", "chamfer")}
    return told


def count_named(case: Case, named: list[str]) -> dict:
    """Which share of the wrong views is named, and of the others."""
    wrong = {case.cameras.views[i] for i in case.wrong}
    right = set(case.cameras.views) - wrong
    return {
        "recall": len(wrong & set(named)) / len(wrong) if wrong else None,
        "false_alarms": len(right & set(named)) / len(right) if right else None,
    }


def measure_turntable(case: Case, found: dict[str, float]) -> dict:
    """How far the axis that was found is off, in pixels, and the elevation, in degrees."""
    ahead = case.cameras.R[0, 2]
    elevation = float(torch.rad2deg(torch.asin(-ahead[1])))
    return {
        "axis_off": abs(found["axis"] - axis_at(case.cameras, found["row"])),
        "elevation_off": abs(found["elevation"] - elevation),
    }


def measure_inside(case: Case, method: str, steps: int) -> dict:
    """A cell of a method of this process."""
    start, said = time.perf_counter(), "it is empty"
    try:
        mesh = INSIDE[method](case, steps)
    except InputError as error:
        mesh, said = None, str(error)
    seconds = time.perf_counter() - start
    told = {"verdict": "refused", "said": said} if mesh is None else {"verdict": "made"}
    return {**told, "seconds": seconds, **measure_mesh(case, mesh, False)}


def measure_outside(case: Case, worker: Worker, made: Path, size: int, calibrated: bool) -> dict:
    """A cell of a method that reads files, from the folder in which it writes its mesh."""
    made.unlink(missing_ok=True)
    write_case(case, made.parent, size, calibrated)
    told = worker.ask(made.parent.resolve(), made.resolve())
    mesh = trimesh.load(made, process=False) if made.exists() else None
    named = count_named(case, told["named"]) if "named" in told else {}
    turned = measure_turntable(case, told["turntable"]) if told.get("turntable") else {}
    return {**told, **measure_mesh(case, mesh, calibrated), **named, **turned}


def measure(
    case: Case, method: str, workers: dict[str, Worker], folder: Path, given: argparse.Namespace
) -> dict:
    """A cell of any method."""
    if method in INSIDE:
        return measure_inside(case, method, given.steps)
    made, calibrated = folder / f"{method}.ply", given.cameras == "calibrate"
    return measure_outside(case, workers[method], made, given.size, calibrated)


def parse_damage(text: str) -> list[tuple[str, tuple]]:
    """A damage at all its strengths, as ``bite``, or at one of them or another, ``bite=0.1,0.2``.

    Raises:
        ArgumentTypeError: there is no such damage, or it takes another count of numbers
    """
    kind, _, numbers = text.partition("=")
    if kind not in DAMAGES:
        raise argparse.ArgumentTypeError(f"{kind!r} is none of {', '.join(DAMAGES)}")
    strengths = DAMAGES[kind][1]
    if not numbers:
        return [(kind, strength) for strength in strengths]
    given = tuple(json.loads(f"[{numbers}]"))
    if len(given) != len(strengths[0]):
        raise argparse.ArgumentTypeError(f"{text}: should be {kind} or as {kind}={strengths[0]}")
    return [(kind, given)]


def list_cells(given: argparse.Namespace) -> Iterator[tuple[str, str, tuple]]:
    """Objects, damages and their strengths: a run that is stopped has whole rows of its table."""
    damages = given.damages or [parse_damage(kind) for kind in DAMAGES]
    for kind, strength in (one for several in damages for one in several):
        if kind != "views" or strength[0] < given.views:
            yield from ((name, kind, strength) for name in given.objects)


def read_kept(path: Path) -> dict:
    """The cells of a file: by what they are of, damage, object and method; none if it is new."""
    return json.loads(path.read_text()) if path.exists() else {}


def measure_all(given: argparse.Namespace) -> dict:
    """Every cell that is not in the file; the file is written after each."""
    kept = read_kept(given.json)
    about = f"{given.views} views of {given.size}, {given.cameras}, seed {given.seed}"
    workers = start_workers(given)
    methods = [m for m in given.methods if m in (*INSIDE, *workers)]
    for name, kind, strength in list_cells(given):
        row = kept.setdefault(about, {}).setdefault(name_cell(kind, strength), {})
        row = row.setdefault(name, {})
        lacking = [method for method in methods if method not in row or method in given.again]
        if not lacking:
            continue
        clean = make_clean(name, given.views, given.size, given.cameras == "calibrate")
        case = damage_case(clean, kind, strength, given.seed)
        folder = given.work / about.replace(", ", "-") / name / name_cell(kind, strength)
        for method in lacking:
            row[method] = measure(case, method, workers, folder, given)
            told = {k: row[method].get(k) for k in ("iou", "volume_iou", "verdict", "seconds")}
            print(f"{name}, {folder.name}, {method}: {told}", file=sys.stderr, flush=True)
            with replacing(given.json) as part:
                part.write_text(json.dumps(kept, indent=1) + "\n")
    for worker in workers.values():
        worker.close()
    return kept


def main() -> None:
    """Measure what is lacking and print the tables."""
    args = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = [*OBJECTS, *SCANS, *REAL]
    args.add_argument("--json", type=Path, required=True, help="to keep the cells in")
    args.add_argument("--objects", nargs="+", choices=known, default=known)
    args.add_argument("--damages", nargs="+", type=parse_damage, help="all, or KIND[=STRENGTH] ...")
    args.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    args.add_argument("--cameras", choices=("given", "calibrate"), default="given")
    args.add_argument("--views", type=int, default=36)
    args.add_argument("--size", type=int, default=96, help="of the working images, in pixels")
    args.add_argument("--steps", type=int, default=150, help="of the ellipsoid's fit")
    args.add_argument("--seed", type=int, default=0)
    args.add_argument("--today", type=Path, help="another checkout, that of before")
    args.add_argument("--rival", type=Path, help="a Python in whose environment reverse3d is")
    args.add_argument("--work", type=Path, default=Path("results/stress"), help="folder of cases")
    args.add_argument("--again", nargs="+", choices=METHODS, default=[], help="measure them anew")
    args.add_argument("--only-kept", action="store_true", help="measure nothing")
    args.add_argument("--by-object", choices=JUDGED, help="show this method, object by object")
    args.add_argument("--regained", action="store_true", help="show what policies regain")
    given = args.parse_args()
    if given.cameras == "calibrate":
        given.methods = [m for m in given.methods if m in ("today", "silmesh", "drop", "repair")]
        if strange := [name for name in given.objects if name in REAL]:
            args.error(f"--cameras calibrate needs a truth; {', '.join(strange)} have none")
    torch.set_num_threads(1)
    kept = read_kept(given.json) if given.only_kept else measure_all(given)
    if given.regained:
        print(tabulate_regained(kept))
    else:
        print(tabulate_objects(kept, given.by_object) if given.by_object else tabulate(kept))


if __name__ == "__main__":
    main()
