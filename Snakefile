"""Photographs to meshes: silhouettes, cameras, a first mesh, the fit, and what it came to."""

import sys

from snakemake.exceptions import WorkflowError
from snakemake.utils import min_version

from silmesh.config import NAME
from silmesh.errors import InputError
from silmesh.plan import Plan
from silmesh.provenance import code_digest, file_digest
from silmesh.synthetic.layout import turntable_angles

min_version("9.10")


# A run's own configuration replaces the default one: their experiments do not mix.
if not workflow.configfiles:

    configfile: "config/config.yaml"


container: "docker://python:3.11-slim"


report: "workflow/report/workflow.rst"


PYTHON = sys.executable

try:
    plan = Plan(config, ", ".join(map(str, workflow.configfiles)))
except InputError as error:
    raise WorkflowError(str(error)) from None


wildcard_constraints:
    object=NAME,
    variant=NAME,
    views=r"\d+-(pad|stretch)",
    scene=r"\d+-[a-z]+-\w+-\w+",


rule all:
    input:
        "results/report/report.html",


include: "workflow/rules/synthetic.smk"
include: "workflow/rules/views.smk"
include: "workflow/rules/silhouettes.smk"
include: "workflow/rules/cameras.smk"
include: "workflow/rules/scene.smk"
include: "workflow/rules/first.smk"
include: "workflow/rules/fit.smk"
include: "workflow/rules/evaluate.smk"
include: "workflow/rules/report.smk"
