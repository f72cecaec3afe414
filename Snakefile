"""Photographs to meshes: silhouettes, cameras, an initial mesh, the fit, and what it came to."""

import gc
import logging
import os
import sys
from inspect import signature
from pathlib import Path
from shlex import quote

from snakemake.utils import min_version

from silmesh.errors import InputError
from silmesh.own_code import own_file
from silmesh.planning.lock import BusyError, begin_run, end_with_parent
from silmesh.planning.places import try_places
from silmesh.planning.plan import Plan
from silmesh.planning.provenance import code_digest as digest_code
from silmesh.planning.provenance import file_digest, read_digest, text_digest
from silmesh.settings.cameras import Features, Matches, Reconstruction
from silmesh.settings.fit import AUTO, SoftRasFit
from silmesh.settings.silhouettes import FOREGROUND_MODELS, WEIGHTS
from silmesh.settings.train import TRAINED
from silmesh.synthetic.layout import is_promised, photograph_names, promised_files
from silmesh.steps.fork_server import serve_job, start
from silmesh.planning.yamls import read_configuration

min_version("9.10")

# On a full disk Snakemake's log is cut, and not a traceback a line.
logging.raiseExceptions = False

# The graph of jobs is of millions of small objects that all stay. By Python's own thresholds looking
# through them again and again is a fifth of the time that planning takes.
gc.set_threshold(50_000, 20, 100)

# Where the command `silmesh` runs this, it ends with the command.
end_with_parent()

# What is left of a run; any of it that is lost is made again.
RESULTS = (
    "mesh.ply",
    "mesh.obj",
    "mesh.glb",
    "cameras.json",
    "loss.csv",
    "metrics.json",
)
# Beside the mesh of a run with a texture.
COMPANIONS = ("mesh.mtl", "mesh.png", "coloured.ply", "texture.json")


# Read strictly first: Snakemake would take the last of two equal keys in silence.
try:
    for file in workflow.configfiles or ["config/config.yaml"]:
        read_configuration(file)
except InputError as error:
    sys.exit(f"silmesh: {error}")


# A run's own configuration replaces the default one: their experiments do not mix.
if not workflow.configfiles:

    configfile: "config/config.yaml"


# What `--software-deployment-method apptainer` runs steps in. Otherwise they run in the environment
# that runs this, see below. docs/scale.md says how the image is built.
container: os.environ.get("SILMESH_IMAGE", "docker://silmesh:0.1.0")


report: "workflow/report/workflow.rst"


# Steps run by the Python that runs this.
shell.prefix(f"PATH={quote(str(Path(sys.executable).parent))}:$PATH; ")

# A job of a cluster runs this anew, without what stands in onstart. SLURM's runs it twice, the second
# time where the steps are.
if workflow.remote_exec and "slurm-jobstep" not in sys.argv:
    serve_job(several=workflow.group_settings.local_groupid != "local")

try:
    plan = Plan(config, ", ".join(map(str, workflow.configfiles)))
except InputError as error:
    sys.exit(f"silmesh: {error}")


# Before Snakemake looks for results, which it cannot where no folder of them can be.
try:
    try_places(plan, Path.cwd())
except InputError as error:
    print(f"silmesh: {error}", file=sys.stderr)
    sys.exit(2)


# Snakemake's own lock, which a kill leaves behind, is off in the profile.
onstart:
    let_jobs_start()
    try:
        if on_slurm():
            try_queue()
            remember_jobs()
        begin_run()
        write_report_plan()
    except (BusyError, InputError) as error:
        # Said at once: an executor's end may take a while.
        print(f"silmesh: {error}", file=sys.stderr, flush=True)
        sys.exit(1)
    except OSError as error:
        sys.exit(f"silmesh: {error.filename}: {error.strerror}")
    start()
    tell_unused()


# What a step said is the last to be read, not the long command of it.
onerror:
    shell("grep -h '^silmesh: ' {log:q} | sort -u >&2 || true")
    show_unfinished(log)


onsuccess:
    drop_unfinished()


wildcard_constraints:
    **plan.constraints(),


include: "workflow/rules/common.smk"


rule all:
    input:
        "results/report/report.html",
        [every_run(f"results/{{}}/{{}}/{name}") for name in RESULTS],
        [every_textured(f"results/{{}}/{{}}/{name}") for name in COMPANIONS],


include: "workflow/rules/synthetic.smk"
include: "workflow/rules/fetch.smk"
include: "workflow/rules/views.smk"
include: "workflow/rules/silhouettes.smk"
include: "workflow/rules/cameras.smk"
include: "workflow/rules/colmap.smk"
include: "workflow/rules/scene.smk"
include: "workflow/rules/judge.smk"
include: "workflow/rules/gallery.smk"
include: "workflow/rules/truth.smk"
include: "workflow/rules/train.smk"
include: "workflow/rules/initial.smk"
include: "workflow/rules/fit.smk"
include: "workflow/rules/relief.smk"
include: "workflow/rules/colour.smk"
include: "workflow/rules/texture.smk"
include: "workflow/rules/evaluate.smk"
include: "workflow/rules/report.smk"


# What reads a person's files goes first, of all objects, since it finds most mistakes. The other rules
# stand in the order in which they need each other, and of jobs that are ready the last goes first: one
# object is finished before the next is begun.
READERS = ("synthetic", "fetch", "views", "silhouettes")
for place, made_by in enumerate(workflow.rules):
    made_by.priority = place + 1000 * (made_by.name in READERS)


# Snakemake asks for a function's parameters again for every job, and Python finds them anew each
# time unless they stand at the function.
for made_by in workflow.rules:
    for told in filter(callable, made_by.params):
        told.__signature__ = signature(told)
