"""What planning costs, as JSON lines: a dry run of many objects, and a run with nothing to do.

python benchmarks/planning.py --objects 100 1000 --views 72

Beside each stands the same of a bare Snakefile: the same jobs with the same files, written down
plainly, with no settings, no digests and no package of ours. So the difference is what we add to
Snakemake itself. Nothing is computed: the results are empty files, which Snakemake is told are
made. Times are of the processor, memory is the largest that the process held.
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
CONFIG = """\
datasets: config/datasets.tsv
views: {size: 64, resize: pad}
variants:
  uninitialised:
    init: {shape: sphere, vertices: 642, align: none}
    fit: {preset: softras, iterations: 100}
  initialised:
    init: {shape: sphere, vertices: 642, align: bbox}
    fit: {preset: softras, iterations: 100}
  auto:
    init: {shape: auto}
    fit: {preset: fast}
"""
HEADER = "object\timages\tmasks\tsilhouettes\tcameras\tturntable\n"
BARE = """\
OBJECTS = {objects}
STAGES = "results/{{object}}/stages"
RUN = "results/{{object}}/{{variant}}"
FIRST = {first}
JUDGED, SCENE, CAMERAS, SILHOUETTES, VIEWS = {stages}
RESULTS = ("mesh.ply", "mesh.obj", "mesh.glb", "cameras.json", "loss.csv", "metrics.json")


def each(path, **values):
    return expand(path, object=OBJECTS, **values)


wildcard_constraints:
    object="[A-Za-z0-9_-]+", variant="|".join(FIRST), first="|".join(FIRST.values()),

rule all:
    input: "results/report/report.html", each(RUN + "/{{name}}", variant=FIRST, name=RESULTS)
rule views:
    output: directory(STAGES + "/views/" + VIEWS)
    benchmark: "logs/views/{{object}}.tsv"
    shell: "true"
rule silhouettes:
    input: STAGES + "/views/" + VIEWS
    output: directory(STAGES + "/silhouettes/" + SILHOUETTES)
    benchmark: "logs/silhouettes/{{object}}.tsv"
    shell: "true"
rule calibrate:
    input: STAGES + "/views/" + VIEWS, STAGES + "/silhouettes/" + SILHOUETTES
    output: directory(STAGES + "/cameras/" + CAMERAS)
    benchmark: "logs/cameras/{{object}}.tsv"
    shell: "true"
rule scene:
    input:
        STAGES + "/views/" + VIEWS, STAGES + "/silhouettes/" + SILHOUETTES,
        STAGES + "/cameras/" + CAMERAS,
    output: directory(STAGES + "/scenes/" + SCENE)
    benchmark: "logs/scene/{{object}}.tsv"
    shell: "true"
rule judge:
    input: STAGES + "/scenes/" + SCENE
    output: directory(STAGES + "/judged/" + JUDGED)
    benchmark: "logs/judge/{{object}}.tsv"
    shell: "true"
rule initial:
    input: STAGES + "/scenes/" + SCENE
    output: STAGES + "/first/{{first}}/first.ply", STAGES + "/first/{{first}}/init.json"
    benchmark: "logs/first/{{object}}-{{first}}.tsv"
    shell: "true"
rule fit:
    input:
        lambda w: f"results/{{w.object}}/stages/first/{{FIRST[w.variant]}}/first.ply",
        STAGES + "/scenes/" + SCENE,
    output: multiext(RUN + "/", "mesh.ply", "cameras.json", "loss.csv", "fit.json")
    benchmark: "logs/fit/{{object}}-{{variant}}.tsv"
    shell: "true"
rule colour:
    input: RUN + "/mesh.ply", RUN + "/cameras.json", STAGES + "/scenes/" + SCENE
    output: RUN + "/mesh.obj", RUN + "/mesh.glb"
    benchmark: "logs/colour/{{object}}-{{variant}}.tsv"
    shell: "true"
rule evaluate:
    input:
        multiext(RUN + "/", "mesh.ply", "cameras.json", "loss.csv", "fit.json"),
        STAGES + "/judged/" + JUDGED,
        lambda w: f"results/{{w.object}}/stages/first/{{FIRST[w.variant]}}/init.json",
    output: RUN + "/metrics.json"
    benchmark: "logs/evaluate/{{object}}-{{variant}}.tsv"
    shell: "true"
rule figure:
    input:
        lambda w: expand(f"results/{{w.object}}/{{{{v}}}}/{{{{n}}}}", v=FIRST,
            n=("mesh.ply", "cameras.json", "loss.csv")),
        STAGES + "/scenes/" + SCENE,
    output: multiext("results/report/figures/{{object}}", ".svg", ".png", ".pdf")
    shell: "true"
rule picture:
    input:
        RUN + "/mesh.obj", RUN + "/cameras.json", STAGES + "/scenes/" + SCENE,
        lambda w: f"results/{{w.object}}/stages/first/{{FIRST[w.variant]}}/first.ply",
    output:
        "results/report/pictures/{{object}}/{{variant}}.png",
        "results/report/turntables/{{object}}/{{variant}}.gif",
        "results/report/turntables/{{object}}/{{variant}}.mp4",
        "results/report/exhibits/{{object}}/{{variant}}.json",
    benchmark: "logs/picture/{{object}}-{{variant}}.tsv"
    shell: "true"
rule gallery:
    input:
        STAGES + "/views/" + VIEWS, STAGES + "/scenes/" + SCENE, STAGES + "/judged/" + JUDGED,
    output:
        "results/report/silhouettes/{{object}}/" + JUDGED + ".png",
        "results/report/galleries/{{object}}/" + JUDGED + ".json",
    shell: "true"
rule rings:
    input: STAGES + "/scenes/" + SCENE
    output: "results/report/cameras/{{object}}/" + SCENE + ".png"
    shell: "true"
rule conclude:
    input: each(RUN + "/{{name}}", variant=FIRST, name=("loss.csv", "metrics.json"))
    output: multiext("results/report/comparison", ".csv", ".tex", ".svg", ".pdf")
    shell: "true"
rule page:
    input:
        "results/report/comparison.csv",
        each(RUN + "/{{name}}", variant=FIRST, name=("loss.csv", "metrics.json")),
        each("results/report/pictures/{{object}}/{{variant}}.png", variant=FIRST),
        each("results/report/exhibits/{{object}}/{{variant}}.json", variant=FIRST),
        each("results/report/figures/{{object}}.svg"), each(STAGES + "/scenes/" + SCENE),
        each("results/report/cameras/{{object}}/" + SCENE + ".png"),
        each("results/report/silhouettes/{{object}}/" + JUDGED + ".png"),
        each("results/report/galleries/{{object}}/" + JUDGED + ".json"),
    output: multiext("results/report/", "losses.csv", "summary.csv", "report.html")
    shell: "true"
"""
# Makes each output as an empty file, and has Snakemake note it as made, without a wait.
PRETEND = """\
import sys
from pathlib import Path
from snakemake.executors import touch

def run_job(self, job):
    for path in map(Path, job.output):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.mkdir(exist_ok=True) if not path.suffix else path.touch()
    for path in job.output:
        path.touch()
    info = touch.SubmittedJobInfo(job=job)
    self.report_job_submission(info)
    self.report_job_success(info)

touch.Executor.run_job = run_job
from snakemake.cli import main
main(sys.argv[1:])
"""
MANY = ("--cores", "100000", "--scheduler", "greedy", "--quiet", "all")


def main(argv: Sequence[str] | None = None) -> None:
    """Make the objects, and measure."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("--objects", type=int, nargs="+", default=[100, 1000])
    args.add_argument("--views", type=int, default=72, help="photographs of each, with masks")
    args.add_argument("--bare", action=argparse.BooleanOptionalAction, default=True)
    args.add_argument("--again", action=argparse.BooleanOptionalAction, default=True)
    args.add_argument("--keep", type=Path, help="folder to make the objects in, and to leave them")
    given = args.parse_args(argv)
    for objects in given.objects:
        with TemporaryDirectory() as temporary:
            folder = given.keep or Path(temporary)
            for kind in ("ours", "bare") if given.bare else ("ours",):
                project = folder / f"{kind}-{objects}-{given.views}"
                make = make_ours if kind == "ours" else make_bare
                if not project.exists():
                    make(project, [f"o{i}" for i in range(objects)], given.views)
                told = {"kind": kind, "objects": objects, "views": given.views}
                for name, cost in measure_project(project, given.again):
                    print(json.dumps(told | {"run": name} | cost), flush=True)


def make_ours(project: Path, objects: Sequence[str], views: int) -> None:
    """The workflow, and photographs of a few pixels with masks: links to one file."""
    project.mkdir(parents=True)
    for name in ("Snakefile", "workflow", "profiles", "src"):
        (project / name).symlink_to(ROOT / name)
    (project / "config").mkdir()
    (project / "config/config.yaml").write_text(CONFIG)
    rows = [f"{o}\t../photos/{o}\t../masks/{o}\tmask\tcalibrate\t,,5\n" for o in objects]
    (project / "config/datasets.tsv").write_text(HEADER + "".join(rows))
    for name in objects:
        first = project / "photos" / name / f"{name}_r0.png"
        for folder in (first.parent, project / "masks" / name):
            folder.mkdir(parents=True)
            if folder == first.parent:
                Image.new("RGB", (8, 8)).save(first)
            for i in range(folder == first.parent, views):
                os.link(first, folder / f"{name}_r{i * 5}.png")


def make_bare(project: Path, objects: Sequence[str], views: int) -> None:
    """A Snakefile of the same jobs; it reads no photograph."""
    project.mkdir(parents=True)
    views_key = "64-pad"
    scene = f"{views_key}-mask-calibrate"
    judged = f"{scene}-keep-3"
    stages = (judged, scene, f"{views_key}-mask-calibrate", f"{views_key}-mask", views_key)
    first = {
        "uninitialised": f"{judged}-sphere-642-none",
        "initialised": f"{judged}-sphere-642-bbox",
        "auto": f"{judged}-auto",
    }
    text = BARE.format(objects=repr(list(objects)), first=repr(first), stages=repr(stages))
    (project / "Snakefile").write_text(text)


def measure_project(project: Path, again: bool) -> list[tuple[str, dict[str, float]]]:
    """A dry run of what is to be made, and a run where all is made."""
    snakemake = [sys.executable, "-m", "snakemake"]
    found = [("dry", measure([*snakemake, "--cores", "2", "--dry-run"], project))]
    if again:
        run([sys.executable, "-c", PRETEND, "--touch", *MANY], project)
        found.append(("again", measure([*snakemake, "--cores", "2"], project)))
        shutil.rmtree(project / ".snakemake/locks", ignore_errors=True)
    return found


def measure(command: Sequence[str], folder: Path) -> dict[str, float]:
    """Seconds of the processor and megabytes that a command takes, and the jobs that it counts."""
    process, said = start(command, folder)
    _, status, used = os.wait4(process.pid, 0)
    text = said.read_text()
    if status:
        raise SystemExit(text[-3000:])
    counted = [line.split()[1] for line in text.splitlines() if line.startswith("total ")]
    return {
        "seconds": round(used.ru_utime + used.ru_stime, 1),
        "megabytes": round(used.ru_maxrss / 1024),
        "jobs": int(counted[0]) if counted else 0,
    }


def run(command: Sequence[str], folder: Path) -> None:
    """Run a command that must succeed."""
    process, said = start(command, folder)
    if process.wait():
        raise SystemExit(said.read_text()[-3000:])


def start(command: Sequence[str], folder: Path) -> tuple[subprocess.Popen, Path]:
    """A command in a folder, and the file of what it says."""
    said = folder / "said.txt"
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    with open(said, "w") as file:
        process = subprocess.Popen(command, cwd=folder, stdout=file, stderr=file, env=environment)
    return process, said


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    main()
