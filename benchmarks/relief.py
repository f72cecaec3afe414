r"""What photo-consistency adds to a fit, on objects whose truth is known: a table, or JSON.

    python benchmarks/relief.py --scans ../shared/data/scans --json relief.json

Of each case (``rendered.py`` says how one is written) 36 photographs are rendered with exact masks
and cameras, the stages hull and fast fit a mesh to them, and the photographs refine it, judged by
those of them that are kept out. Compared with the truth are the hull of the full silhouettes (256
samples a side), the fit, and what the photographs make of it. ``limit`` is the volume IoU of the
truth with everything filled that no view sees into, which only a guess can pass. ``to_hull`` and
``to_fit`` are ratios of chamfer distances; ``decided`` is the latter for what is taken: the refined
mesh, led back to its outlines and with its unseen ends spanned, or the fit, if the photographs that
are kept out do not confirm it.
"""

import argparse
import json
import resource
import time
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import igl
import numpy as np
import torch
import trimesh
from relief_sheet import draw_sheet
from rendered import Case, Fitted, parser, prepare

from silmesh.evaluation.ground_truth import compare_to_truth
from silmesh.fitting.mending import follow_outlines
from silmesh.geometry.camera import Cameras
from silmesh.geometry.unseen import span_unseen
from silmesh.geometry.visual_hull import carve
from silmesh.relief.judgement import Judged, refine_if_better
from silmesh.relief.refinement import Relief, refine
from silmesh.relief.surface import STANDINGS
from silmesh.settings.fit import FastFit

CASES = (
    "blue_cup@10+60",
    "blue_cup@10+40",
    "blue_cup:pattern@10+60",
    "blue_cup:pattern@10+40",
    "shampoo@10+60",
    "shampoo@10+40",
    "bear:pattern@10+40",
    "bear:plain@10+40",
    "bowl:plain@10+60",
    "pot:gloss@10+40",
    "bottle:gloss@10+40",
)
RESOLUTION = 256  # samples of the hull, a side
MARGIN = 0.25  # of the truth's size: how much wider the box is
SAMPLES = 100_000  # points of the box about the truth by which the limit is found
COLUMNS = (
    *("limit", "hull_volume", "fit_volume", "relief_volume", "taken_volume"),
    *("to_hull", "to_fit", "decided"),
    *("iou_fit", "iou_relief", *STANDINGS, "seconds", "cpu_seconds", "peak_mb"),
)


def find_limit(truth: trimesh.Trimesh, cameras: Cameras) -> float:
    """Volume IoU of the truth with the truth and all that no camera sees into."""
    rng = np.random.default_rng(0)
    around = MARGIN * truth.extents.max() * np.array([[-1], [1]])  # below it no view sees all
    points = rng.uniform(*(truth.bounds + around), (SAMPLES, 3))
    verts, faces = np.asarray(truth.vertices, float), np.asarray(truth.faces, np.int64)
    inside = np.abs(igl.fast_winding_number(verts, faces, points)) > 0.5
    hidden = np.flatnonzero(~inside)
    for eye in cameras.centres.numpy():
        hidden = hidden[truth.ray.intersects_any(points[hidden], eye - points[hidden])]
    return float(inside.sum() / (inside.sum() + len(hidden)))


@dataclass
class Timed:
    """The refinement, which keeps what it made and what that took, whatever is decided then."""

    relief: Relief | None = None
    took: dict[str, float] = field(default_factory=dict)

    def __call__(self, *given: Any) -> Relief:
        """As ``refine``."""
        started, worked = time.perf_counter(), time.process_time()
        self.relief = refine(*given)
        self.took = {
            "seconds": self.took.get("seconds", 0) + time.perf_counter() - started,
            "cpu_seconds": self.took.get("cpu_seconds", 0) + time.process_time() - worked,
            "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        }
        return self.relief


def measure(case: Case, given: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """A row of the table, and what else was found."""
    fitted = prepare(case, given.size, given.working, folder, given.scans, given.steps)
    timed, overlap = Timed(), fitted.measure_iou
    judged = refine_if_better(
        fitted.mesh,
        fitted.originals,
        fitted.silhouettes,
        fitted.cameras,
        overlap,
        seed=given.seed,
        by=timed,
        mend=lambda refined: follow_outlines(
            refined, fitted.cameras, fitted.silhouettes, FastFit()
        ),
        span=lambda refined: span_unseen(refined, fitted.cameras, overlap),
    )
    if not timed.relief:  # nothing was tried
        timed.relief = Relief(judged.mesh.vertices, judged.mesh.faces, judged.standing, False, {})
    mesh = trimesh.Trimesh(timed.relief.verts, timed.relief.faces, process=False)
    if given.meshes:
        write(given.meshes, case, fitted, judged)
    compared = compare(fitted, mesh, judged.mesh)
    chamfer = {name: figures["chamfer"] for name, figures in compared.items()}
    standing = timed.relief.standing
    shares = np.bincount(standing, minlength=len(STANDINGS)) / len(standing)
    return {
        "limit": find_limit(fitted.truth, fitted.placed),
        **{f"{name}_volume": figures["volume_iou"] for name, figures in compared.items()},
        "to_hull": chamfer["relief"] / chamfer["hull"],
        "to_fit": chamfer["relief"] / chamfer["fit"],
        "decided": chamfer["taken"] / chamfer["fit"],
        "iou_fit": fitted.measure_iou(fitted.mesh),
        "iou_relief": fitted.measure_iou(mesh),
        **dict(zip(STANDINGS, shares.tolist(), strict=True)),
        **dict.fromkeys(("seconds", "cpu_seconds", "peak_mb"), 0.0),
        **timed.took,
        "vertices": len(mesh.vertices),
        "compared": compared,
        "notes": judged.notes,
    }


def compare(
    fitted: Fitted, refined: trimesh.Trimesh, taken: trimesh.Trimesh
) -> dict[str, dict[str, Any]]:
    """The hull, the fit, the refined mesh and what is taken against the truth."""
    hull = trimesh.Trimesh(*carve(fitted.full, fitted.placed, RESOLUTION).surface(), process=False)
    bodies = {"hull": hull, "fit": fitted.mesh, "relief": refined, "taken": taken}
    return {name: compare_to_truth(body, fitted.truth) for name, body in bodies.items()}


def write(folder: Path, case: Case, fitted: Fitted, judged: Judged) -> None:
    """Write truth, fit and what is taken, and a picture of them, to be looked at."""
    folder.mkdir(parents=True, exist_ok=True)
    bodies = {"truth": fitted.truth, "fit": fitted.mesh, "taken": judged.mesh}
    for kind, body in bodies.items():
        body.export(folder / f"{case.file_name}-{kind}.ply")
    sheet = draw_sheet(fitted, judged.mesh, judged.standing)
    sheet.save(folder / f"{case.file_name}.png", optimize=True)


def main() -> None:
    """Print a row a case."""
    args = parser(__doc__, CASES, 1024)
    args.add_argument("--steps", type=int, default=600, help="of the fit at most")
    args.add_argument("--threads", type=int, default=2)
    args.add_argument("--seed", type=int, default=0)
    args.add_argument("--meshes", type=Path, help="folder to write meshes and pictures of them to")
    args.add_argument("--json", type=Path, help="file to write")
    given = args.parse_args()
    torch.set_num_threads(given.threads)
    print(f"{'':24}" + "".join(f"{column:>14}" for column in COLUMNS))
    rows = {}
    with TemporaryDirectory() as scratch:
        for case in map(Case.parse, given.cases):
            folder = (given.keep or Path(scratch)) / f"{case.file_name}-{given.size}"
            rows[str(case)] = row = measure(case, given, folder)
            print(f"{case!s:24}" + "".join(f"{row[c]:14.3f}" for c in COLUMNS), flush=True)
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
