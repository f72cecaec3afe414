"""How long photographs take to become a mesh, from nothing, and how good it is: JSON.

python benchmarks/end_to_end.py --data ../shared/data/aloi_moisturiser

Runs snakemake on photographs and masks in ALOI's layout, in a new folder, up to ``mesh.glb`` and
``metrics.json``. A stage lasts from when snakemake starts its job until it reports the job's end;
stages run beside each other, so they do not add up. The first of ``--repeats`` also compiles the
kernels where there is no cache of them.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
MOISTURISER = ROOT.parent / "shared" / "data" / "aloi_moisturiser"
OBJECT, VARIANT = "moisturiser", "fast"
METRICS = ("iou_mean", "iou_min", "iou_holdout", "hull_iou_mean", "iterations", "fit_seconds")
CONFIG = """\
datasets: datasets.tsv
variants:
  fast:
    init: {shape: hull}
    fit: {preset: fast, holdout: 6}
"""
HEADER = "object\timages\tmasks\tsilhouettes\tcameras\tturntable\n"
JOB = re.compile(r"^Job (\d+):")
DONE = re.compile(r"^Finished jobid: (\d+) \(Rule: (\w+)\)")


def main() -> None:
    """Print what was measured."""
    args = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    args.add_argument("--data", type=Path, default=MOISTURISER, help="with png2/ and mask2/")
    args.add_argument("--cores", type=int, default=2)
    args.add_argument("--repeats", type=int, default=1)
    given = args.parse_args()
    runs = [measure(given.data.resolve(), given.cores) for _ in range(given.repeats)]
    print(json.dumps(runs, indent=1))


def measure(data: Path, cores: int) -> dict:
    """Run the workflow in a new folder."""
    with TemporaryDirectory() as made:
        folder = Path(made)
        _write_experiment(folder, data)
        start = time.perf_counter()
        stages = _run(folder, cores, start)
        wall = time.perf_counter() - start
        metrics = json.loads((folder / "results" / OBJECT / VARIANT / "metrics.json").read_text())
    return {
        "wall_seconds": round(wall, 2),
        "stages": stages,
        **{name: metrics[name] for name in METRICS},
    }


def _write_experiment(folder: Path, data: Path) -> None:
    """A configuration and a table of one object."""
    photographs, masks = (data / kind / OBJECT for kind in ("png2", "mask2"))
    row = (OBJECT, str(photographs), str(masks), "mask", "calibrate", ",,5")
    (folder / "datasets.tsv").write_text(HEADER + "\t".join(row) + "\n")
    (folder / "config.yaml").write_text(CONFIG)


def _run(folder: Path, cores: int, start: float) -> dict[str, dict[str, float]]:
    """When each stage's job starts, and how long it lasts, in seconds, by snakemake's own word."""
    results = [f"results/{OBJECT}/{VARIANT}/{name}" for name in ("mesh.glb", "metrics.json")]
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile")]
    command += ["--cores", str(cores), "--configfile", "config.yaml", "--", *results]
    paths = [str(ROOT / "src"), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    started, stages, said = {}, {}, []
    with subprocess.Popen(
        command,
        cwd=folder,
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    ) as process:
        for line in process.stdout:
            said.append(line)
            now = time.perf_counter() - start
            if job := JOB.match(line):
                started[job[1]] = now
            elif job := DONE.match(line):
                begun = started[job[1]]
                stages[job[2]] = {"at": round(begun, 2), "seconds": round(now - begun, 2)}
    if process.returncode:
        sys.exit("".join(said))
    return stages


if __name__ == "__main__":
    main()
