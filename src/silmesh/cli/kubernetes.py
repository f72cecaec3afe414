"""Gives Snakemake's jobs to Kubernetes: ``silmesh-kubernetes``, which profiles/kubernetes calls.

Snakemake's own plugin for Kubernetes knows no folder that its pods share, and the steps read each
other's folders. So this serves its plugin for any cluster, which asks three things:

    silmesh-kubernetes submit SCRIPT   prints the name of a job
    silmesh-kubernetes status NAME     prints running, success or failed
    silmesh-kubernetes NAME...         ends jobs
"""

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from silmesh.errors import InputError

IMAGE, CLAIM, MOUNT = "SILMESH_IMAGE", "SILMESH_CLAIM", "SILMESH_MOUNT"
MEANING = {
    IMAGE: "the image that the run itself is in",
    CLAIM: "the persistent volume claim (ReadWriteMany) that holds the project",
    MOUNT: "the folder at which that is mounted, of the run too",
}
PROPERTIES = "# properties = "  # begins the line of a script that says what its job is
KEPT = 24 * 3600  # seconds that Kubernetes keeps what has ended
PATIENCE = 60.0  # seconds that kubectl has to answer


def main(argv: Sequence[str] | None = None) -> None:
    """Do what the words ask for."""
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        match words:
            case ["submit", script]:
                click.echo(submit(Path(script)))
            case ["status", name]:
                click.echo(find_status(name))
            case [_, *_]:
                _kubectl("delete", "--wait=false", *words)
            case _:
                raise InputError("submit SCRIPT, status NAME, or names of jobs to end")
    except InputError as error:
        sys.exit(f"silmesh: {error}")


def submit(script: Path) -> str:
    """Give a job to Kubernetes: its name.

    Raises:
        InputError: a variable is not set, or Kubernetes refuses the job
    """
    lacking = [name for name in MEANING if not os.environ.get(name)]
    if lacking:
        raise InputError(f"{lacking[0]} is not set; should name {MEANING[lacking[0]]}")
    lines = script.read_text(encoding="utf-8").splitlines()
    (line, *_) = [line for line in lines if line.startswith(PROPERTIES)]
    job = describe_job(script, json.loads(line.removeprefix(PROPERTIES)), os.environ)
    said = _kubectl("create", "-f", "-", "-o", "name", given=json.dumps(job))
    if said.returncode:
        raise InputError(f"Kubernetes takes no job: {said.stderr.strip()}")
    return said.stdout.strip()


def describe_job(
    script: Path, properties: Mapping[str, Any], names: Mapping[str, str]
) -> dict[str, Any]:
    """A job's manifest.

    Args:
        script: that it runs, in the folder that the pods share
        properties: Snakemake's of the job: its threads, and its resources by their names
        names: of the image, the claim and its folder, by the environment's names
    """
    asked = properties["resources"]
    memory = f"{asked['mem_mb']}M"
    limits = {"memory": memory} | ({"nvidia.com/gpu": asked["gpu"]} if asked.get("gpu") else {})
    container = {
        "name": "steps",
        "image": names[IMAGE],
        "command": ["/bin/sh", str(script.absolute())],
        "workingDir": str(Path.cwd()),
        "resources": {
            "requests": {"cpu": properties["threads"], "memory": memory},
            "limits": limits,
        },
        "volumeMounts": [{"name": "shared", "mountPath": names[MOUNT]}],
    }
    pod = {
        "restartPolicy": "Never",
        "containers": [container],
        "volumes": [{"name": "shared", "persistentVolumeClaim": {"claimName": names[CLAIM]}}],
    }
    return {
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": {"generateName": "silmesh-", "labels": {"app": "silmesh"}},
        "spec": {
            "backoffLimit": 0,  # Snakemake tries again, and asks for more then
            "activeDeadlineSeconds": 60 * asked["runtime"],
            "ttlSecondsAfterFinished": KEPT,
            "template": {"metadata": {"labels": {"app": "silmesh"}}, "spec": pod},
        },
    }


def find_status(name: str) -> str:
    """How a job is: ``running`` also while Kubernetes does not answer."""
    said = _kubectl("get", name, "-o", "json")
    if said.returncode:
        return "failed" if "NotFound" in said.stderr else "running"
    conditions = json.loads(said.stdout).get("status", {}).get("conditions") or []
    ended = {one["type"] for one in conditions if one["status"] == "True"}
    return "success" if "Complete" in ended else "failed" if "Failed" in ended else "running"


def _kubectl(*words: str, given: str | None = None) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(
            ["kubectl", *words],
            input=given,
            capture_output=True,
            encoding="utf-8",
            timeout=PATIENCE,
        )
    except OSError as error:
        raise InputError(f"kubectl: {error.strerror}") from error
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(words, 1, "", "no answer")
