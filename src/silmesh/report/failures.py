"""Which runs of a plan came to nothing, at which stage, and why."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

LOG = re.compile(r"^ +log: (.+?) \(check log file", re.MULTILINE)  # of a job that failed
UNKNOWN = {"stage": "", "reason": "was not begun"}


def find_unfinished(
    runs: Sequence[Mapping[str, Any]], said: str, results: Path, made: Path
) -> list[dict[str, str]]:
    """The runs of a plan that failed, or that something is lacking of.

    Args:
        runs: of ``plan.json``
        said: by Snakemake, whose failed jobs name their logs
        results: folder of the runs
        made: folder of the report
    Returns:
        of each ``object``, ``variant``, ``stage`` and ``reason``
    """
    failures = _read_failures(said)
    objects = {run["object"] for run in runs}
    of_object = {log: _find_object(log, objects) for log in failures}
    found = []
    for run in runs:
        logs = {str(Path(file).with_suffix(".log")): stage for stage, file in run["stages"].items()}
        failed = [log for log in failures if log in logs]
        if not failed and _is_whole(run, results, made):
            continue
        # A job may be of a stage that has no name in the plan, of this object or of all.
        failed += [log for log in failures if of_object[log] == run["object"]]
        failed += [log for log in failures if of_object[log] is None]
        told = UNKNOWN
        if failed:
            stage = logs.get(failed[0], Path(failed[0]).parent.name)
            told = {"stage": stage, "reason": failures[failed[0]]}
        found.append({"object": run["object"], "variant": run["variant"], **told})
    return found


def _read_failures(said: str) -> dict[str, str]:
    """The last words of each failed job, by its log."""
    return {log: _read_reason(Path(log)) for log in dict.fromkeys(LOG.findall(said))}


def _read_reason(log: Path) -> str:
    """What a step said last; its own message before what a traceback ends in.

    Lines that begin with # are the command of the step, and what it used.
    """
    try:
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    own = [line.removeprefix("silmesh: ") for line in lines if line.startswith("silmesh: ")]
    said = [line for line in own or lines if line.strip() and not line.startswith("# ")]
    return said[-1] if said else f"{log} says nothing"


def _find_object(log: str, objects: set[str]) -> str | None:
    """The object that a log is named for: the one with the longest name that fits."""
    stem = Path(log).stem
    fitting = [name for name in objects if stem == name or stem.startswith(f"{name}-")]
    return max(fitting, key=len, default=None)


def _is_whole(run: Mapping[str, Any], results: Path, made: Path) -> bool:
    """Whether all is there that the report shows of a run."""
    object_, variant = run["object"], run["variant"]
    files = [results / object_ / variant / name for name in ("loss.csv", "metrics.json")]
    files.append(made / "galleries" / object_ / f"{run['judged']}.json")
    files.append(made / "cameras" / object_ / f"{run['scene']}.png")
    if run["replicate"] == 1:
        files.append(made / "pictures" / object_ / f"{variant}.png")
        files.append(made / "exhibits" / object_ / f"{variant}.json")
    return all(file.is_file() for file in files)
