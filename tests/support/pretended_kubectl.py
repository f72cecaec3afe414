"""A kubectl that runs the command of a Job on this machine: what it is given is kept to be read.

It stands in for a cluster as far as ``silmesh.cli.kubernetes`` sees one.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

STATE = "PRETENDED_KUBECTL"  # the variable that names the folder of jobs
RUN = "sh -c '{command}' > {folder}/log 2>&1; echo $? > {folder}/status"


def install(folder: Path) -> dict[str, str]:
    """Put it into a folder: what the environment has to say for it to be found."""
    program = folder / "kubectl"
    program.write_text(f"#!/bin/sh\nexec '{sys.executable}' '{__file__}' \"$@\"\n")
    program.chmod(0o755)
    paths = (folder, Path(sys.executable).parent, os.environ["PATH"])
    return {"PATH": os.pathsep.join(map(str, paths)), STATE: str(folder)}


def create(state: Path, manifest: dict) -> str:
    """Start a job: its name."""
    name = f"{manifest['metadata']['generateName']}{len(list(state.glob('silmesh-*')))}"
    folder = state / name
    folder.mkdir()
    (folder / "job.json").write_text(json.dumps(manifest))
    (container,) = manifest["spec"]["template"]["spec"]["containers"]
    command = " ".join(f'"{word}"' for word in container["command"])
    nowhere = subprocess.DEVNULL
    subprocess.Popen(
        ["sh", "-c", RUN.format(command=command, folder=folder)],
        cwd=container["workingDir"],
        start_new_session=True,
        stdin=nowhere,
        stdout=nowhere,
        stderr=nowhere,
    )
    return f"job.batch/{name}"


def describe(folder: Path) -> dict:
    """A job as Kubernetes tells of it."""
    ended = folder / "status"
    if not ended.exists() or not ended.read_text().strip():
        return {"status": {"active": 1}}
    kind = "Complete" if ended.read_text().strip() == "0" else "Failed"
    return {"status": {"conditions": [{"type": kind, "status": "True"}]}}


def main() -> None:
    """Do what kubectl would."""
    state = Path(os.environ[STATE])
    match sys.argv[1:]:
        case ["create", *_]:
            print(create(state, json.load(sys.stdin)))
        case ["get", name, *_] if (folder := state / Path(name).name).is_dir():
            print(json.dumps(describe(folder)))
        case ["get", name, *_]:
            sys.exit(f'Error from server (NotFound): jobs.batch "{name}" not found')


if __name__ == "__main__":
    main()
