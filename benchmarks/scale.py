"""Many objects: where the time of a run goes, and how long many more would take on more cores.

    python benchmarks/scale.py run FOLDER --objects 100
    python benchmarks/scale.py simulate FOLDER --objects 1000 --cores 2 64 1000

``run`` draws so many random convex bodies from 12 sides, their silhouettes exact, and runs the
workflow on them. It says which share of the processor's time each step's own work took, as the
steps' logs say; the rest is Snakemake, and the start of processes.

``simulate`` takes the seconds of each step of an object from the logs of a finished run (the mean
of its objects, which should be as many as its cores or more, so that each step has one core) and
lays the steps of many objects onto cores: a step of an object starts when the one before has ended
and a core is free, those that have waited longest first. That no two steps of an object go side by
side makes it a little too long where there are more cores than objects. ``--overhead`` seconds are
added to each: what it takes to start a job.
"""

import argparse
import ctypes
import heapq
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw
from scipy.spatial import ConvexHull
from torch import from_numpy
from usage import collect

from silmesh.cameras.turntable import turntable_cameras

ROOT = Path(__file__).resolve().parents[1]
SIZE, VIEWS, STEP = 64, 12, 30  # pixels, views, degrees between them
WORK = ("fit", "silhouettes")
PR_SET_CHILD_SUBREAPER = 36  # of prctl(2): what a child leaves running is waited for here
HEADER = "object\timages\tmasks\tsilhouettes\tcameras\tturntable\n"
CONFIG = """\
datasets: config/datasets.tsv
views: {{size: {size}}}
variants:
  hull:
    init: {{shape: hull}}
    fit: {{preset: fast}}
"""


def main() -> None:
    """Run, or simulate."""
    args = argparse.ArgumentParser(description=__doc__)
    parts = args.add_subparsers(dest="part", required=True)
    for name in ("run", "simulate"):
        part = parts.add_parser(name)
        part.add_argument("folder", type=Path, help="of the project")
        part.add_argument("--objects", type=int, default={"run": 100, "simulate": 1000}[name])
        part.add_argument("--cores", type=int, nargs="+", default=[2])
        part.add_argument("--overhead", type=float, default=0.15, help="seconds a job")
    given = args.parse_args()
    if given.part == "run":
        print(json.dumps(run(given.folder, given.objects, given.cores[0]), indent=1))
    else:
        stages = read_stages(given.folder)
        told = {"stages": {name: round(took, 2) for name, took in stages.items()}}
        for cores in given.cores:
            hours = simulate(stages, given.objects, cores, given.overhead) / 3600
            told[f"hours on {cores} cores"] = round(hours, 3)
        print(json.dumps(told, indent=1))


def run(folder: Path, objects: int, cores: int) -> dict[str, object]:
    """Make a project, run it, and say what took how long."""
    if not folder.exists():
        make_project(folder, objects)
    command = [sys.executable, "-m", "snakemake", "--cores", str(cores), "--quiet", "all"]
    seconds, spent = spend(command, cwd=folder, env=os.environ | {"PYTHONPATH": "src"})
    used = {
        step: round(sum(one.processor for one in steps), 1)
        for step, steps in collect([folder]).items()
    }
    return {
        "objects": objects,
        "seconds": round(seconds, 1),
        "processor_seconds": round(spent, 1),
        "of_an_object": round(spent / objects, 2),
        "steps": dict(sorted(used.items(), key=lambda item: -item[1])),
        "share_of_fits_and_silhouettes": round(sum(used.get(s, 0) for s in WORK) / spent, 3),
        "share_of_all_steps": round(sum(used.values()) / spent, 3),
    }


def spend(command: Sequence[str], **settings: Any) -> tuple[float, float]:
    """Run a command: its seconds, and those of the processor, its forks' that outlive it too."""
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)
    before = os.times()
    subprocess.run(command, check=True, **settings)
    ended = os.times()
    with suppress(ChildProcessError):
        while True:
            os.wait()
    return ended.elapsed - before.elapsed, sum(os.times()[2:4]) - sum(before[2:4])


def make_project(folder: Path, objects: int) -> None:
    """The workflow, and photographs of random convex bodies on a turntable, with masks."""
    (folder / "config").mkdir(parents=True)
    for name in ("Snakefile", "workflow", "profiles", "src"):
        (folder / name).symlink_to(ROOT / name)
    (folder / "config/config.yaml").write_text(CONFIG.format(size=SIZE), encoding="utf-8")
    cameras = turntable_cameras([f"r{i * STEP}" for i in range(VIEWS)], SIZE, 2.732, 20, STEP)
    rows = []
    for i in range(objects):
        name = f"body{i}"
        corners = np.random.default_rng(i).uniform(-0.4, 0.4, (12, 3)).astype(np.float32)
        for view, seen in zip(cameras.views, cameras.project(from_numpy(corners)), strict=True):
            draw(folder / "photos" / name / f"{view}.png", seen.numpy(), (200, 120, 40))
            draw(folder / "masks" / name / f"{view}.png", seen.numpy(), (255, 255, 255))
        places = f"../photos/{name}\t../masks/{name}"
        rows.append(f"{name}\t{places}\tmask\tturntable\t2.732,20,{STEP}\n")
    (folder / "config/datasets.tsv").write_text(HEADER + "".join(rows), encoding="utf-8")


def draw(path: Path, points: np.ndarray, colour: tuple[int, int, int]) -> None:
    """The silhouette of the convex hull of points, drawn at four times the size."""
    path.parent.mkdir(parents=True, exist_ok=True)
    image = Image.new("RGB", (4 * SIZE, 4 * SIZE))
    outline = [(4 * x, 4 * y) for x, y in points[ConvexHull(points).vertices]]
    ImageDraw.Draw(image).polygon(outline, fill=colour)
    image.resize((SIZE, SIZE), Image.Resampling.BOX).save(path)


def read_stages(folder: Path) -> dict[str, float]:
    """Seconds of each step an object, those that are of all objects among them."""
    plan = json.loads((folder / "results/report/plan.json").read_text(encoding="utf-8"))
    objects = {planned["object"] for planned in plan["runs"]}
    return {
        step: sum(one.seconds for one in used) / len(objects)
        for step, used in collect([folder]).items()
    }


def simulate(stages: Mapping[str, float], objects: int, cores: int, overhead: float) -> float:
    """Seconds until the last job has ended, by list scheduling."""
    chain = [seconds + overhead for seconds in stages.values()]
    free = [0.0] * cores  # when each core is free
    ready = [(0.0, i, 0) for i in range(objects)]  # when, of which object, which stage
    end = 0.0
    while ready:
        since, object_, stage = heapq.heappop(ready)
        core = heapq.heappop(free)
        done = max(since, core) + chain[stage]
        heapq.heappush(free, done)
        end = max(end, done)
        if stage + 1 < len(chain):
            heapq.heappush(ready, (done, object_, stage + 1))
    return end


if __name__ == "__main__":
    main()
